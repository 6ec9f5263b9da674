"""Grey levels and blur at crossing corners of squares: black and white in four quadrants, blurred by a Gaussian."""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.special import ndtr

REACH, LEAST_REACH_PX, MOST_REACH_PX = 0.35, 3.0, 9.0
"""How far around a corner pixels are used: in distances to the nearest corner, and in px."""
LEAST_SINE = 0.5
"""Of the angle between the two edges: neighbours along one line tell of one edge only."""
MOST_MISFIT = 0.08
"""Rms misfit over the contrast beyond which a corner tells nothing: it touches a tag, or is half in shade."""


def crossings(pixels: np.ndarray, xy_px: np.ndarray, most: int) -> Iterator[tuple[float, float, float]]:
    """Of up to `most` corners at (n, 2) px of an image: black and white in DN, and the sigma in px of their edges, the
    pixel's own area with it."""
    if len(xy_px) < 4:
        return
    tree = cKDTree(xy_px)
    for k in range(0, len(xy_px), max(1, len(xy_px) // most)):
        near = tree.query(xy_px[k], k=min(6, len(xy_px)))[1][1:]
        along = xy_px[near] - xy_px[k]
        length = np.linalg.norm(along, axis=1)
        reach = float(np.clip(REACH * length[0], LEAST_REACH_PX, MOST_REACH_PX))
        first = along[0] / length[0]
        sine = np.abs(first[0] * along[:, 1] - first[1] * along[:, 0]) / length
        others = np.flatnonzero(sine > LEAST_SINE)
        if len(others):
            one = _corner(pixels, xy_px[k], (first, along[others[0]] / length[others[0]]), reach)
            if one is not None:
                yield one


def _corner(
    pixels: np.ndarray, xy: np.ndarray, along: tuple[np.ndarray, np.ndarray], reach: float
) -> tuple[float, float, float] | None:
    r, (x, y) = int(np.ceil(reach)), np.rint(xy).astype(int)
    if x < r or y < r or x + r >= pixels.shape[1] or y + r >= pixels.shape[0]:
        return None
    value = pixels[y - r : y + r + 1, x - r : x + r + 1].astype(float).ravel()
    step = np.arange(-r, r + 1)
    at = np.stack(np.meshgrid(step + x, step + y), axis=-1).reshape(-1, 2) - xy
    within = np.hypot(*at.T) <= reach
    value, at = value[within], at[within]
    angles = [float(np.arctan2(d[1], d[0])) for d in along]
    low, high = np.percentile(value, (10, 90))

    def model(theta: np.ndarray) -> np.ndarray:
        a, b, turn_u, turn_v, sigma, dx, dy = theta
        parts = [
            ndtr((np.cos(t) * (at[:, 1] - dy) - np.sin(t) * (at[:, 0] - dx)) / max(sigma, 0.05))
            for t in (turn_u, turn_v)
        ]
        return np.asarray(a + (b - a) * (parts[0] * parts[1] + (1 - parts[0]) * (1 - parts[1])))

    best = None
    for a, b in ((low, high), (high, low)):
        fit = least_squares(lambda theta: model(theta) - value, [a, b, *angles, 0.8, 0.0, 0.0])
        best = fit if best is None or fit.cost < best.cost else best
    assert best is not None
    black, white = sorted(float(v) for v in best.x[:2])
    sigma, misfit = float(abs(best.x[4])), float(np.sqrt(2 * best.cost / len(value)))
    if not 0.1 < sigma < 6 or misfit > MOST_MISFIT * (white - black):
        return None
    return black, white, sigma
