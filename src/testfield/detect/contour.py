"""Is a blob's edge an ellipse? Asked of the edge alone, so a shadow that falls across a dot does no harm."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from testfield.detect.screen import half_axes_of, median_known, sample

RMS_PART, WORST_PX, WORST_PART, NOISE_PX = 0.045, 0.03, 0.1, 0.5
"""An edge may lie off its ellipse by such parts of the dot's radius, and so many pixels for a noise as large as the
contrast. Blur makes a square of a few pixels so round that its edge is off by little more."""
ROUGHLY = 2.5
"""Before the fit the ellipse is a rough one, and all four may be so many times larger."""
RAYS, STEPS = 36, 33
BATCH = 128
"""Dots at a time: the samples along their rays then stay in the processor's cache."""
BEGIN, END = 0.5, 1.5
"""Where a ray looks for the edge, in dot radii."""


def is_elliptic(
    image_dn: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray, relative_noise: np.ndarray, slack: float = 1.0
) -> np.ndarray:
    """(n,) whether the edges of bright blobs in an image (h, w) lie on the ellipses of their moments, within what noise
    and real paint need: `relative_noise` (n,) of a pixel over the contrast; `slack` widens the limits. Rows that are
    not finite are no ellipses."""
    good = np.isfinite(xy_px).all(axis=1) & np.isfinite(moments_px2).all(axis=(1, 2))
    if not good.any():
        return good
    rms, worst = edge_deviation(image_dn, xy_px[good], moments_px2[good])
    radius = 2 * np.maximum(np.linalg.det(moments_px2[good]), 0) ** 0.25
    with np.errstate(invalid="ignore"):
        chance = NOISE_PX * np.nan_to_num(relative_noise[good], nan=0.0)
        good[good] = (rms < slack * (RMS_PART * radius + chance)) & (
            worst < slack * (WORST_PX + WORST_PART * radius + 3 * chance)
        )
    return good


def edge_deviation(image_dn: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square and largest distance (n,) in px of the edges of n bright dots from their ellipses.

    Along each of `RAYS` rays the edge lies at the centroid of the squared fall of the image (h, w); rays that leave
    the image are left out. The ellipses' mean error in size does not count.
    """
    rms, worst = np.empty(len(xy_px)), np.empty(len(xy_px))

    def measure(rows: slice) -> None:
        rms[rows], worst[rows] = _deviation(image_dn, xy_px[rows], half_axes_of(moments_px2[rows]))

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(measure, (slice(start, start + BATCH) for start in range(0, len(xy_px), BATCH))))
    return rms, worst


def _deviation(image_dn: np.ndarray, xy_px: np.ndarray, half_axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = len(xy_px)
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    towards = np.column_stack([np.cos(angle), np.sin(angle)]) @ np.swapaxes(half_axes, 1, 2)
    radius = np.linspace(BEGIN, END, STEPS)
    along = towards.astype(np.float32)[..., None] * radius.astype(np.float32)
    x, y = (xy_px[:, k, None, None].astype(np.float32) + along[:, :, k] for k in (0, 1))
    values = sample(image_dn, x.reshape(n, -1), y.reshape(n, -1)).reshape(n, RAYS, STEPS)
    fall = values[..., :-1] - values[..., 1:]
    np.maximum(fall, 0, out=fall)
    fall *= fall
    middle = (radius[:-1] + radius[1:]) / 2
    weighted = fall @ np.column_stack([np.ones_like(middle), middle]).astype(np.float32)
    with np.errstate(invalid="ignore", divide="ignore"):
        edge = (weighted[..., 1] / weighted[..., 0]).astype(float)
    seen = np.isfinite(edge)
    edge[~seen.any(axis=1)] = 1e9  # no edge anywhere
    off = (edge - median_known(edge)) * np.linalg.norm(towards, axis=2)
    off[~seen.any(axis=1)] = np.inf
    return np.sqrt(np.nanmean(off**2, axis=1)), np.nanmax(np.abs(off), axis=1)
