"""The corners of a dark quadrangle where straight lines along its sides meet.

An outline in whole pixels is a pixel or two off, and blur rounds its corners: more than a cell of a small tag. The
sides between them are straight and long, and where brightness rises across them is known to a fraction of a pixel.
"""

import cv2
import numpy as np

SAMPLES, FIRST, LAST = 24, 0.1, 0.9
"""Places along a side, and the parts of it between which they lie: corners are of two sides."""
STEPS = 16
"""Steps of brightness across a side."""
REACH_CELLS, LEAST_REACH_PX, MOST_REACH_PX = 1.2, 1.5, 4.0
"""How far across a side its edge is looked for."""
ROUNDS, OUTLIER, LEAST_PX = 3, 2.5, 0.1
"""A place counts where its edge is within so many standard deviations of the line, or so many px."""
FEWEST = 6
"""Places that make a line."""
AT_ONCE = 256
"""Quadrangles at a time, for the memory of their samples."""


def straightened(image: np.ndarray, quads: np.ndarray, cells: int) -> np.ndarray:
    """(n, 4, 2) px the corners where the sides meet, of dark quadrangles (n, 4, 2), clockwise, of so many `cells` a
    side in an image (h, w) uint8; as they were where the sides are no lines."""
    parts = [_straightened(image, quads[k : k + AT_ONCE], cells) for k in range(0, len(quads), AT_ONCE)]
    return np.concatenate(parts) if parts else quads


def _straightened(image: np.ndarray, quads: np.ndarray, cells: int) -> np.ndarray:
    along = np.roll(quads, -1, axis=1) - quads
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-6)
    along = along / length[..., None]
    outwards = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    reach = np.clip(REACH_CELLS * length.min(axis=1) / cells, LEAST_REACH_PX, MOST_REACH_PX)
    part = np.linspace(FIRST, LAST, SAMPLES)
    off = np.linspace(-1, 1, STEPS + 1)
    # (n, 4, samples, steps + 1, 2)
    on_side = quads[:, :, None] + (part[:, None] * length[:, :, None, None]) * along[:, :, None]
    at = on_side[:, :, :, None] + (reach[:, None, None, None] * off)[..., None] * outwards[:, :, None, None]
    flat = at.reshape(len(quads) * 4 * SAMPLES, STEPS + 1, 2).astype(np.float32)
    value = np.concatenate(
        [
            cv2.remap(image, some[..., 0], some[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for some in np.array_split(flat, len(flat) // 30_000 + 1)  # OpenCV counts rows in 16 bits
        ]
    ).astype(float)
    rise = np.maximum(np.diff(value, axis=1), 0) ** 2
    weight = rise.sum(axis=1)
    middle = (off[1:] + off[:-1]) / 2
    edge = (rise @ middle / np.maximum(weight, 1e-9)).reshape(len(quads), 4, SAMPLES) * reach[:, None, None]
    begin, slope, good = _lines(part, edge, weight.reshape(edge.shape))
    # Each side as its two ends, moved; lines of neighbouring sides are then met.
    first = quads + begin[..., None] * outwards
    second = np.roll(quads, -1, axis=1) + (begin + slope)[..., None] * outwards
    line = np.cross(_with_one(first), _with_one(second))
    corner = np.cross(np.roll(line, 1, axis=1), line)
    with np.errstate(divide="ignore", invalid="ignore"):
        corner = corner[..., :2] / corner[..., 2:]
        moved = np.abs(corner - quads).max(axis=(1, 2))
    keep = good.all(axis=1) & (moved < 2 * reach)
    return np.where(keep[:, None, None], corner, quads)


def _lines(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value at 0 and slope (n, 4) of lines through y (n, 4, k) at x (k,) without outliers, and which are lines."""
    used = weight > 0
    begin = slope = np.zeros(y.shape[:2])
    for _ in range(ROUNDS):
        w = weight * used
        total = np.maximum(w.sum(axis=2), 1e-9)
        mean_x, mean_y = (w * x).sum(axis=2) / total, (w * y).sum(axis=2) / total
        dx = x - mean_x[..., None]
        slope = (w * dx * y).sum(axis=2) / np.maximum((w * dx * dx).sum(axis=2), 1e-9)
        begin = mean_y - slope * mean_x
        off = np.abs(y - begin[..., None] - slope[..., None] * x)
        ranked = np.sort(np.where(weight > 0, off, np.inf), axis=2)
        half = (weight > 0).sum(axis=2)[..., None] // 2
        median = np.take_along_axis(ranked, np.minimum(half, off.shape[2] - 1), axis=2)
        used = (weight > 0) & (off <= np.maximum(OUTLIER * 1.4826 * median, LEAST_PX))
    return begin, slope, used.sum(axis=2) >= FEWEST


def _with_one(xy: np.ndarray) -> np.ndarray:
    return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
