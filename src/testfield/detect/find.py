"""Find blobs that may be dots: brighter than their surroundings, of a dot's size and an ellipse's shape."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.runs import changes, empty_mask, runs_between

NOISE_FACTOR = 6.0
FLATTEST = 0.2
"""Smallest ratio of an ellipse's axes: a circle seen at 78 degrees."""
FULLEST_LACK = 0.14
"""By how much a blob may be less than the ellipse of its moments."""
WINDOW_PX, FINE_WINDOW_PX = 42, 18
"""Widths of the neighbourhoods whose means pixels are compared with; twice an odd number, since the means are taken in
the image of half the size. The threshold lies the closer to an edge's middle the more of the neighbourhood the target
fills, so that the gap between a small dot and its ring stays open; a dot wider than about 0.8 of it no longer stands
out as a whole."""
LARGEST_ON_LEVEL_PX = 28.0
"""Larger dots are looked for in images of half the size, and so on."""
BAND_ROWS = 128
"""Rows that are compared with their threshold at a time: what is in use then stays in the processor's cache."""
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
    if min(image_dn.shape) < 2:
        return Blobs(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, bool))
    levels = [image_dn, _halved(image_dn)]  # the last only serves the one before it
    while largest_px > LARGEST_ON_LEVEL_PX * 2 ** (len(levels) - 2) and min(levels[-2].shape) >= 16:
        levels.append(_halved(levels[-1]))
    jobs = [(0, FINE_WINDOW_PX), *((k, WINDOW_PX) for k in range(len(levels) - 1))]

    def look(job: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        k, window = job
        return _blobs_of_level(levels[k], levels[k + 1], sheet, smallest_px / 2**k, window, 2**k)

    with ThreadPoolExecutor(2) as pool:  # OpenCV and NumPy let go of the interpreter
        parts = list(pool.map(look, jobs))
    xy, moments, fullness, cut = (np.concatenate(column) for column in zip(*parts, strict=True))
    size = 4 * np.linalg.det(moments) ** 0.25 if len(xy) else np.zeros(0)
    keep = _distinct(xy, size, fullness)
    keep = keep[size[keep] <= 1.3 * largest_px]
    keep = keep[np.argsort(-size[keep], kind="stable")]
    return Blobs(xy[keep[:MOST_BLOBS]], moments[keep[:MOST_BLOBS]], cut[keep[:MOST_BLOBS]], len(keep[MOST_BLOBS:]))


def _halved(image: np.ndarray) -> np.ndarray:
    """Means of two by two pixels (h // 2, w // 2)."""
    h, w = image.shape[0] // 2, image.shape[1] // 2
    return cv2.resize(image[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA)


def _blobs_of_level(
    level_dn: np.ndarray, half_dn: np.ndarray, sheet: SensorSheet, smallest_px: float, window: int, scale: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centres and moments in full pixels, fullness and whether cut, of the blobs in an image reduced by `scale`;
    `half_dn` is that image halved."""
    h, w = level_dn.shape
    threshold = _threshold(half_dn, sheet, window, NOISE_FACTOR / scale)
    line, bright = empty_mask(BAND_ROWS, w)
    found = []
    for top in range(0, h, BAND_ROWS):
        n = min(BAND_ROWS, h - top)
        rows = slice(top, top + n)
        cv2.compare(level_dn[rows], _doubled(threshold, rows, w), cv2.CMP_GT, dst=bright[:n])
        found.append(changes(line[: n * (w + 1) + 1]) + top * (w + 1))
    runs = runs_between(np.concatenate(found), w)
    area = runs.area()
    smallest_area = max(0.5 * np.pi / 4 * smallest_px**2 * FLATTEST, 6)
    keep = (area >= smallest_area) & (area <= (1.1 * window) ** 2)
    runs, area = runs.only(keep), area[keep]
    left, upper, right, lower = runs.box()
    width, height = right - left, lower - upper
    longer = np.maximum(width, height)
    keep = (longer <= 1.1 * window) & (longer >= max(0.7 * smallest_px, 3))
    # The least that an ellipse fills of its box is less where it lies across, but never this little.
    keep &= area >= 0.15 * width * height
    runs, area = runs.only(keep), area[keep]
    cut = ((left == 0) | (upper == 0) | (right == w) | (lower == h))[keep]

    x, y, xx, xy, yy = runs.moments()
    # A filled ellipse has area 4 pi sqrt(det of moments); anything with holes, arms or corners has less.
    fullness = area / (4 * np.pi * np.sqrt(xx * yy - xy * xy))
    spread = np.sqrt((xx - yy) ** 2 + 4 * xy * xy)
    ratio = np.sqrt((xx + yy - spread) / (xx + yy + spread))
    good = (fullness > 1 - FULLEST_LACK) & (ratio > FLATTEST)
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    centre = (np.column_stack([x, y]) + 0.5) * scale - 0.5
    return centre[good], moments[good] * scale**2, fullness[good], cut[good]


def _threshold(half_dn: np.ndarray, sheet: SensorSheet, window: int, noise_factor: float) -> np.ndarray:
    """The mean of a neighbourhood of `window` px of the full image, and so many times its noise, for each pixel of an
    image of half the size: it is smooth."""
    h, w = half_dn.shape
    width = min(window // 2, 2 * min(h, w) - 1)
    mean = cv2.blur(half_dn, (width, width), borderType=cv2.BORDER_REFLECT)
    step = window // 9
    coarse = cv2.resize(mean, (-(-w // step), -(-h // step)), interpolation=cv2.INTER_LINEAR)
    noise = np.sqrt(sheet.variance_dn2(coarse)).astype(np.float32)
    return cv2.scaleAdd(cv2.resize(noise, (w, h), interpolation=cv2.INTER_LINEAR), noise_factor, mean)


def _doubled(half: np.ndarray, rows: slice, w: int) -> np.ndarray:
    """Some rows, from an even one on, of the image of width `w` of which `half` was halved; an odd last row or column
    repeats the one before."""
    first, last = max(rows.start // 2 - 1, 0), min(rows.stop // 2 + 1, half.shape[0])
    even_w = 2 * half.shape[1]
    full = cv2.resize(half[first:last], (even_w, 2 * (last - first)), interpolation=cv2.INTER_LINEAR)
    odd_row, odd_column = max(rows.stop - 2 * last, 0), w - even_w
    if odd_row or odd_column:
        full = cv2.copyMakeBorder(full, 0, odd_row, 0, odd_column, cv2.BORDER_REPLICATE)
    return full[rows.start - 2 * first : rows.stop - 2 * first]


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
