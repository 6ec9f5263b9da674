"""Find blobs that may be dots: brighter than their surroundings, of a dot's size and an ellipse's shape."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from testfield.camera.images import SensorSheet

NOISE_FACTOR = 6.0
FLATTEST = 0.2
"""Smallest ratio of an ellipse's axes: a circle seen at 78 degrees."""
FULLEST_LACK = 0.14
"""By how much a blob may be less than the ellipse of its moments."""
WINDOW_PX, FINE_WINDOW_PX = 41, 15
"""Widths of the neighbourhoods whose means pixels are compared with. The threshold lies the closer to an edge's middle
the more of the neighbourhood the target fills, so that the gap between a small dot and its ring stays open; a dot
wider than about 0.8 of it no longer stands out as a whole."""
LARGEST_ON_LEVEL_PX = 28.0
"""Larger dots are looked for in images of half the size, and so on."""
MOST_BLOBS = 50_000
"""More are not measured, the largest come first: a photograph of gravel must not take hours."""


@dataclass(frozen=True)
class Blobs:
    """Rough places of n dots: centres `xy_px` (n, 2), second moments `moments_px2` (n, 2, 2); `cut` (n,) where the
    image's edge cuts them; `left_out` how many more there were than are looked at."""

    xy_px: np.ndarray
    moments_px2: np.ndarray
    cut: np.ndarray
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.xy_px)


def find_blobs(image_dn: np.ndarray, sheet: SensorSheet, smallest_px: float, largest_px: float) -> Blobs:
    """Blobs of `smallest_px` to `largest_px` diameter that are about elliptic.

    `image_dn` (h, w) float32 with bright marks. A pixel belongs to a blob where it exceeds the mean of its
    neighbourhood by more than noise explains, which neither uneven light nor a bright background changes. The image
    is halved as often as the largest dot needs; the time is linear in its pixels.
    """
    levels = [(image_dn, smallest_px, FINE_WINDOW_PX, 1), (image_dn, smallest_px, WINDOW_PX, 1)]
    level, scale = image_dn, 1
    while largest_px > LARGEST_ON_LEVEL_PX * scale and min(level.shape) >= 16:
        scale *= 2
        even = level[: level.shape[0] // 2 * 2, : level.shape[1] // 2 * 2]
        level = cv2.resize(even, (even.shape[1] // 2, even.shape[0] // 2), interpolation=cv2.INTER_AREA)
        levels.append((level, smallest_px / scale, WINDOW_PX, scale))
    with ThreadPoolExecutor(2) as pool:  # OpenCV and NumPy let go of the interpreter
        parts = list(pool.map(lambda job: _blobs_of_level(job[0], sheet, *job[1:]), levels))
    xy, moments, fullness, cut = (np.concatenate(column) for column in zip(*parts, strict=True))
    size = 4 * np.linalg.det(moments) ** 0.25 if len(xy) else np.zeros(0)
    keep = _distinct(xy, size, fullness)
    keep = keep[size[keep] <= 1.3 * largest_px]
    keep = keep[np.argsort(-size[keep], kind="stable")]
    return Blobs(xy[keep[:MOST_BLOBS]], moments[keep[:MOST_BLOBS]], cut[keep[:MOST_BLOBS]], len(keep[MOST_BLOBS:]))


def _blobs_of_level(
    level_dn: np.ndarray, sheet: SensorSheet, smallest_px: float, window: int, scale: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centres and moments in full pixels, fullness and whether cut, of the blobs in an image reduced by `scale`."""
    window = min(window, 2 * min(level_dn.shape) - 1)
    mean = cv2.blur(level_dn, (window, window), borderType=cv2.BORDER_REFLECT)
    h, w = level_dn.shape
    # The mean is smooth, so its noise is computed at some places only.
    coarse = cv2.resize(mean, (-(-w // 4), -(-h // 4)), interpolation=cv2.INTER_LINEAR)
    noise = np.sqrt(sheet.variance_dn2(coarse)).astype(np.float32)
    threshold = cv2.scaleAdd(cv2.resize(noise, (w, h), interpolation=cv2.INTER_LINEAR), NOISE_FACTOR / scale, mean)
    bright = cv2.compare(level_dn, threshold, cv2.CMP_GT)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright, connectivity=4)
    x0, y0, width, height, area = stats.T
    smallest_area = max(0.5 * np.pi / 4 * smallest_px**2 * FLATTEST, 6)
    keep = (area >= smallest_area) & (np.maximum(width, height) <= 1.1 * window)
    keep &= np.maximum(width, height) >= max(0.7 * smallest_px, 3)
    # The least that an ellipse fills of its box is less where it lies across, but never this little.
    keep &= area >= 0.15 * width * height
    keep[0] = False
    n = int(keep.sum())
    if n == 0:
        return np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, bool)

    # Moments of all kept blobs in one sweep over their pixels.
    index = np.flatnonzero(bright.ravel())
    label = labels.ravel()[index]
    index, label = index[keep[label]], label[keep[label]]
    rows, columns = index // w, index % w
    blob = (np.cumsum(keep) - 1)[label]
    size = np.bincount(blob, minlength=n)
    cx, cy = (np.bincount(blob, weights=v, minlength=n) / size for v in (columns, rows))
    dx, dy = columns - cx[blob], rows - cy[blob]
    xx, xy, yy = (np.bincount(blob, weights=v, minlength=n) / size for v in (dx * dx, dx * dy, dy * dy))
    xx, yy = xx + 1 / 12, yy + 1 / 12  # a pixel is a square, not a point
    # A filled ellipse has area 4 pi sqrt(det of moments); anything with holes, arms or corners has less.
    fullness = size / (4 * np.pi * np.sqrt(xx * yy - xy * xy))
    spread = np.sqrt((xx - yy) ** 2 + 4 * xy * xy)
    ratio = np.sqrt((xx + yy - spread) / (xx + yy + spread))
    good = (fullness > 1 - FULLEST_LACK) & (ratio > FLATTEST)
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    edge = ((x0 == 0) | (y0 == 0) | (x0 + width == w) | (y0 + height == h))[keep]
    centre = (np.column_stack([cx, cy]) + 0.5) * scale - 0.5
    return centre[good], moments[good] * scale**2, fullness[good], edge[good]


def _distinct(xy: np.ndarray, size: np.ndarray, fullness: np.ndarray) -> np.ndarray:
    """Indices of blobs less those that another, fuller blob of like size and place stands for."""
    from scipy.spatial import cKDTree

    if len(xy) < 2:
        return np.arange(len(xy))
    order = np.argsort(-fullness, kind="stable")
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    # Place and size in one space, in which the same dot found twice is nearer than a fifth: sizes by their logarithm.
    octave = np.floor(np.log2(np.maximum(size, 1)))
    gone = np.zeros(len(xy), bool)
    for k in np.unique(octave):
        here = np.flatnonzero((octave == k) | (octave == k + 1))
        step = 2.0**k
        space = np.column_stack([xy[here] / (0.3 * step), np.log2(np.maximum(size[here], 1)) / 0.6])
        pairs = cKDTree(space).query_pairs(1.0, output_type="ndarray")
        a, b = here[pairs[:, 0]], here[pairs[:, 1]]
        gone[np.where(rank[a] < rank[b], b, a)] = True
    return np.flatnonzero(~gone)
