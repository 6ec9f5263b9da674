"""Sums over the pixels of dots that are brighter than half way from their surroundings."""

import math

import numpy as np

from testfield.detect.centre import RING_CLEARANCE_PX, WINDOW
from testfield.store.compiled import compiled

TIGHT = 1.25
"""How far from its middle, in half-axes of its blob, a dot is looked for before it is known where it ends."""
INNER, OUTER = 0.6, 1.2
"""Pixels up to the first are the dot's, and beyond the second its surroundings'; in half-axes."""
LEAST_PIXELS = 6
SUMS = 14


@compiled
def grey_sums(image: np.ndarray, xy: np.ndarray, shape: np.ndarray, half: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """(n, 14) of an image (h, w) about n rough centres `xy` (n, 2), which are rounded.

    The level beside a dot and the level on it; the sums of 1, x, y, x^2, xy, y^2 over the pixels above their mean, each
    times by how much it exceeds it; and these sums each time with 1. `shape` (n, 2, 2) are the quadratic forms of the
    squared distance in half-axes, `half` (n,) the windows' half-widths, and `ring` (n,) how many half-axes away a
    ring may begin that pixels must keep clear of, 0 where none comes so near.
    """
    h, w = image.shape
    found = np.zeros((len(xy), SUMS))
    for i in range(len(xy)):
        middle_x, middle_y, size = int(np.rint(xy[i, 0])), int(np.rint(xy[i, 1])), int(half[i])
        top, bottom = max(middle_y - size, 0), min(middle_y + size + 1, h)
        left, right = max(middle_x - size, 0), min(middle_x + size + 1, w)
        if top >= bottom or left >= right:
            continue
        values = image[top:bottom, left:right]
        a, b = xy[i, 0] - left, xy[i, 1] - top
        form = (shape[i, 0, 0], shape[i, 0, 1], shape[i, 1, 1])
        if ring[i] > 0:
            form = _form_above_half(values, a, b, form)
        outer, inner, outer_count, inner_count = 0.0, 0.0, 0, 0
        for r in range(bottom - top):
            first, last = span(form, a, r - b, WINDOW, right - left)
            begin, end = span(form, a, r - b, OUTER, right - left)
            for side in ((first, begin), (end, last)):
                for c in range(side[0], side[1]):
                    if ring[i] == 0 or _clear(form, c - a, r - b, ring[i]):
                        outer += values[r, c]
                        outer_count += 1
            begin, end = span(form, a, r - b, INNER, right - left)
            inner_count += end - begin
            for c in range(begin, end):
                inner += values[r, c]
        if outer_count == 0:
            # The gap is too narrow for a pixel of its own: its darkest one is as near as one gets.
            outer, outer_count = np.inf, 1
            for r in range(bottom - top):
                first, last = span(form, a, r - b, WINDOW, right - left)
                for c in range(first, last):
                    outer = min(outer, values[r, c])
        black, white = outer / outer_count, inner / max(inner_count, 1)
        threshold = 0.5 * (black + white)
        found[i, 0], found[i, 1] = black, white
        for r in range(bottom - top):
            first, last = span(form, a, r - b, WINDOW, right - left)
            y = float(r + top - middle_y)
            sum_0, sum_1, sum_2, count_0, count_1, count_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for c in range(first, last):
                weight = values[r, c] - threshold
                if weight > 0 and (ring[i] == 0 or _clear(form, c - a, r - b, ring[i])):
                    x = float(c + left - middle_x)
                    sum_0 += weight
                    sum_1 += weight * x
                    sum_2 += weight * x * x
                    count_0 += 1
                    count_1 += x
                    count_2 += x * x
            for at, one, along, squares in ((2, sum_0, sum_1, sum_2), (8, count_0, count_1, count_2)):
                found[i, at] += one
                found[i, at + 1] += along
                found[i, at + 2] += one * y
                found[i, at + 3] += squares
                found[i, at + 4] += along * y
                found[i, at + 5] += one * y * y
    return found


@compiled
def span(form: tuple[float, float, float], a: float, dy: float, radius: float, width: int) -> tuple[int, int]:
    """Of `width` pixels of a row `dy` below an ellipse's middle, in which that lies at `a`, those from the first to
    before the second number are within `radius` half-axes; where there are none, both lie beside the middle."""
    half = form[1] * dy / form[0]
    room = half * half - (form[2] * dy * dy - radius * radius) / form[0]
    reach = math.sqrt(room) if room >= 0 else -0.5
    first = min(max(math.ceil(a - half - reach), 0), width)
    return first, max(min(math.floor(a - half + reach) + 1, width), first)


@compiled
def _clear(form: tuple[float, float, float], dx: float, dy: float, ring: float) -> bool:
    """Whether a pixel keeps clear of a ring: as `usable` of `centre.py`."""
    q = math.sqrt(dx * (form[0] * dx + 2 * form[1] * dy) + form[2] * dy * dy)
    return q <= 1.1 or (ring - q) * math.sqrt(dx * dx + dy * dy) >= RING_CLEARANCE_PX * q


@compiled
def _form_above_half(
    values: np.ndarray, a: float, b: float, form: tuple[float, float, float]
) -> tuple[float, float, float]:
    """The form of what is brighter than the half threshold within a dot's blob alone.

    A blob is found above its surroundings' mean, so that of a small dot is wider than the dot, by a pixel or two; taken
    for the dot it would reach into the ring.
    """
    rows, columns = values.shape
    white, count, black = 0.0, 0, np.inf
    for r in range(rows):
        first, last = span(form, a, r - b, TIGHT, columns)
        for c in range(first, last):
            black = min(black, values[r, c])
        first, last = span(form, a, r - b, INNER, columns)
        count += last - first
        for c in range(first, last):
            white += values[r, c]
    threshold = 0.5 * (black + white / max(count, 1))
    n, x, y, xx, xy, yy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(rows):
        first, last = span(form, a, r - b, TIGHT, columns)
        for c in range(first, last):
            if values[r, c] > threshold:
                dx, dy = c - a, r - b
                n, x, y, xx, xy, yy = n + 1, x + dx, y + dy, xx + dx * dx, xy + dx * dy, yy + dy * dy
    if n < LEAST_PIXELS:
        return form
    x, y = x / n, y / n
    xx, xy, yy = 4 * (xx / n - x * x + 1 / 12), 4 * (xy / n - x * y), 4 * (yy / n - y * y + 1 / 12)
    determinant = xx * yy - xy * xy
    return yy / determinant, -xy / determinant, xx / determinant
