"""Find blobs that may be dots: brighter than their surroundings, of a dot's size and an ellipse's shape."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.runs import Sums, runs_above
from testfield.store.compiled import compiled

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
SAME_PLACE, SAME_SIZE = 0.3, 0.6
"""How near to each other two blobs of the same dot are at most: parts of an octave of diameters, and octaves."""
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
    dark, slope, zero_dn = sheet.noise_line()
    factor = (NOISE_FACTOR / scale) ** 2
    width = min(window // 2, 2 * min(half_dn.shape) - 1)
    b = runs_above(level_dn, half_dn, width, (factor * dark, factor * slope, zero_dn)).sums()
    long, broad = np.maximum(b.right - b.left, b.bottom - b.top), (b.right - b.left) * (b.bottom - b.top)
    smallest_area = max(0.5 * np.pi / 4 * smallest_px**2 * FLATTEST, 6)
    keep = (b.area >= smallest_area) & (b.area <= (1.1 * window) ** 2)
    keep &= (long <= 1.1 * window) & (long >= max(0.7 * smallest_px, 3))
    # The least that an ellipse fills of its box is less where it lies across, but never this little.
    keep &= b.area >= 0.15 * broad
    b = Sums(*(values[keep] for values in vars(b).values()))
    cut = (b.left == 0) | (b.top == 0) | (b.right == w) | (b.bottom == h)

    # A filled ellipse has area 4 pi sqrt(det of moments); anything with holes, arms or corners has less.
    fullness = b.area / (4 * np.pi * np.sqrt(b.xx * b.yy - b.xy * b.xy))
    spread = np.sqrt((b.xx - b.yy) ** 2 + 4 * b.xy * b.xy)
    ratio = np.sqrt((b.xx + b.yy - spread) / (b.xx + b.yy + spread))
    good = (fullness > 1 - FULLEST_LACK) & (ratio > FLATTEST)
    moments = np.stack([np.stack([b.xx, b.xy], -1), np.stack([b.xy, b.yy], -1)], -2)
    centre = (np.column_stack([b.x, b.y]) + 0.5) * scale - 0.5
    return centre[good], moments[good] * scale**2, fullness[good], cut[good]


def _distinct(xy: np.ndarray, size: np.ndarray, fullness: np.ndarray) -> np.ndarray:
    """Indices of blobs less those that another, fuller blob of like size and place stands for."""
    n = len(xy)
    order = np.argsort(-fullness, kind="stable")
    rank = np.empty(n, int)
    rank[order] = np.arange(n)
    from_left = np.argsort(xy[:, 0], kind="stable")
    octaves = np.log2(np.maximum(size, 1))[from_left]
    units = SAME_PLACE * 2.0 ** np.floor(octaves)
    gone = _outdone(np.ascontiguousarray(xy[from_left]), octaves, units, rank[from_left])
    return np.sort(from_left[~gone])


@compiled
def _outdone(xy: np.ndarray, octaves: np.ndarray, units: np.ndarray, rank: np.ndarray) -> np.ndarray:
    """(n,) which blobs, in the order of x, have one of better rank beside them.

    Place and size in one space, in which the same dot found twice is nearer than 1: sizes by their octaves, and places
    in the smaller one's unit. Blobs of octaves that do not follow on each other are never the same.
    """
    n = len(xy)
    gone = np.zeros(n, np.bool_)
    for i in range(n):
        for j in range(i + 1, n):
            dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
            if dx > units[i]:
                break
            small, large = min(units[i], units[j]), max(units[i], units[j])
            if abs(dy) <= small and large <= 2 * small:
                more = (octaves[j] - octaves[i]) / SAME_SIZE
                if dx * dx + dy * dy <= small * small * (1 - more * more):
                    gone[j if rank[i] < rank[j] else i] = True
    return gone
