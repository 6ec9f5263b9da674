"""Values of an image between its pixels, and medians of few numbers, for compiled functions.

A spot's pixels are fetched into one small window first: in a large image each of its rows lies elsewhere in memory, and
who samples them ray by ray waits for most of them.
"""

import math

import numpy as np

from testfield.store.compiled import compiled

OUTSIDE, INSIDE, FETCHED = range(3)
LARGEST_REACH_PX = 30
"""Spots that reach further are sampled where they are: there are more pixels than samples."""
WINDOW_PX = 2 * LARGEST_REACH_PX + 4


@compiled
def fetch(image: np.ndarray, x: float, y: float, reach: float, window: np.ndarray) -> tuple[int, int, int]:
    """Copy into a window (`WINDOW_PX`, `WINDOW_PX`) what `between` needs within `reach` px of a place in an image
    (h, w): `FETCHED`; or `INSIDE` or `OUTSIDE` the image where that is not done; column and row of the window's first
    pixel."""
    h, w = image.shape
    if not (reach + 1 <= x < w - reach - 2 and reach + 1 <= y < h - reach - 2):
        return OUTSIDE, 0, 0
    if reach > LARGEST_REACH_PX:
        return INSIDE, 0, 0
    left, top, size = int(x - reach), int(y - reach), 2 * math.ceil(reach) + 3
    for r in range(min(size, h - top)):
        line, row = window[r], image[top + r, left : min(left + size, w)]
        for c in range(len(row)):
            line[c] = row[c]
    return FETCHED, left, top


@compiled
def between(window: np.ndarray, x: float, y: float) -> float:
    """The bilinear value at a place within a window, from its first pixel, that has pixels on all sides."""
    left, top, one = int(x), int(y), np.uint64(1)
    a, b = np.float32(x - left), np.float32(y - top)
    c, r = np.uint64(left), np.uint64(top)
    above = window[r, c] + a * (window[r, c + one] - window[r, c])
    below = window[r + one, c] + a * (window[r + one, c + one] - window[r + one, c])
    return above + b * (below - above)


@compiled
def anywhere(image: np.ndarray, x: float, y: float) -> float:
    """The bilinear value at a place in px of an image (h, w), whose outermost pixels reach half a pixel further; beyond
    that there is nothing: NaN."""
    h, w = image.shape
    if not (-0.5 <= x <= w - 0.5 and -0.5 <= y <= h - 0.5):
        return math.nan
    x, y = min(max(x, 0.0), w - 1.0), min(max(y, 0.0), h - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, w - 1), min(top + 1, h - 1)
    a, b = np.float32(x - left), np.float32(y - top)
    above = image[top, left] + a * (image[top, right] - image[top, left])
    below = image[bottom, left] + a * (image[bottom, right] - image[bottom, left])
    return above + b * (below - above)


@compiled
def sampled(
    image: np.ndarray, xy: np.ndarray, axes: np.ndarray, places: np.ndarray, window: np.ndarray, out: np.ndarray
) -> None:
    """Values at places (k, 2) in the half-axes (2, 2) of a spot at `xy` (2,) px, written into `out` (k,)."""
    reach = 0.0
    for k in range(len(places)):
        reach = max(reach, places[k, 0] * places[k, 0] + places[k, 1] * places[k, 1])
    long = 0.5 * (axes[0, 0] + axes[1, 1]) + math.sqrt(0.25 * (axes[0, 0] - axes[1, 1]) ** 2 + axes[0, 1] * axes[0, 1])
    where, left, top = fetch(image, xy[0], xy[1], math.sqrt(reach) * long, window)
    x0, y0 = xy[0] - left, xy[1] - top
    for k in range(len(places)):
        x = x0 + axes[0, 0] * places[k, 0] + axes[0, 1] * places[k, 1]
        y = y0 + axes[1, 0] * places[k, 0] + axes[1, 1] * places[k, 1]
        if where == FETCHED:
            out[k] = between(window, x, y)
        else:
            out[k] = between(image, x, y) if where == INSIDE else anywhere(image, x, y)


@compiled
def median_of(values: np.ndarray) -> float:
    """The median of those numbers that are not NaN, which are sorted on the way; NaN of none."""
    n = 0
    for k in range(len(values)):
        v = values[k]
        if not np.isnan(v):
            i = n
            while i > 0 and values[i - 1] > v:
                values[i] = values[i - 1]
                i -= 1
            values[i] = v
            n += 1
    return np.nan if n == 0 else 0.5 * (values[(n - 1) // 2] + values[n // 2])
