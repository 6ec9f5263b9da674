"""Which pixels of a window a fit may use: as far as an outline is felt, and clear of what may lie beyond."""

import math

import numpy as np

from testfield.detect.centre import RING_BEGINS, RING_CLEARANCE_PX
from testfield.store.compiled import compiled

BESIDE = 2.5 / 4
"""From this part of the way on which an edge is felt, a pixel lies beside the dot and no more on its edge."""
UNQUIET = 0.02
"""Scatter beside a dot, in units of its contrast, above which something may lie there."""
NOWHERE, NEAR, WIDE, BESIDE_IT = 0, 1, 2, 4
"""What a pixel is: clear of any ring, within what is felt, and beside the dot. A pixel may be several."""


@compiled
def of_dots(
    values: np.ndarray,
    inside: np.ndarray,
    centre: np.ndarray,
    to_circle: np.ndarray,
    felt_px: np.ndarray,
    contrast: np.ndarray,
    noise: np.ndarray,
) -> np.ndarray:
    """(n, m, m) for dots in windows of `values` that are `inside` the image: as far as an edge is felt, `felt_px` (n,),
    but where a ring may begin only if none does.

    `centre` (n, 2) is relative to the window's middle, `to_circle` (n, 2, 2) leads the outline to the unit circle,
    `contrast` (n,) and the noise's line tell what scatter means.
    """
    n, side = values.shape[0], values.shape[1]
    half = side // 2
    use, kind = np.zeros((n, side, side), np.bool_), np.zeros((side, side), np.uint8)
    for i in range(n):
        count, total = 0, 0.0
        for r in range(side):
            for c in range(side):
                kind[r, c] = NOWHERE
                if inside[i, r, c]:
                    q, px = _distance(c - half - centre[i, 0], r - half - centre[i, 1], to_circle, i)
                    if q <= 1:
                        kind[r, c] = NEAR | WIDE
                    elif (q - 1) * px <= felt_px[i]:
                        clear = q <= 1.1 or (RING_BEGINS - q) * px >= RING_CLEARANCE_PX
                        kind[r, c] = WIDE | NEAR if clear else WIDE
                        if (q - 1) * px > BESIDE * felt_px[i]:
                            kind[r, c] |= BESIDE_IT
                            total += values[i, r, c]
                            count += 1
        mean, scatter = total / max(count, 1), 0.0
        for r in range(side):
            for c in range(side):
                if kind[r, c] & BESIDE_IT:
                    scatter += (values[i, r, c] - mean) ** 2
        variance = noise[0] + max(noise[1] * (mean - noise[2]), 0.0)
        most = variance * (1 + 4 * math.sqrt(2 / max(count, 1))) + (UNQUIET * contrast[i]) ** 2
        asked = WIDE if scatter / max(count, 1) < most else NEAR
        for r in range(side):
            for c in range(side):
                use[i, r, c] = (kind[r, c] & asked) != 0
    return use


@compiled
def of_rings(
    inside: np.ndarray,
    centre: np.ndarray,
    to_circle: np.ndarray,
    felt_px: np.ndarray,
    clear_px: np.ndarray,
    outer: float,
    quiet: float,
) -> np.ndarray:
    """(n, m, m) for rings that end at `outer` half-axes: as far as they are felt, `felt_px` (n,), and by `clear_px`
    (n,) clear of what may lie beyond their quiet zone, which ends at `quiet` half-axes. The rest is as of `of_dots`."""
    n, side = inside.shape[0], inside.shape[1]
    half = side // 2
    use = np.zeros((n, side, side), np.bool_)
    for i in range(n):
        for r in range(side):
            for c in range(side):
                if inside[i, r, c]:
                    q, px = _distance(c - half - centre[i, 0], r - half - centre[i, 1], to_circle, i)
                    use[i, r, c] = q <= outer or ((q - outer) * px <= felt_px[i] and (quiet - q) * px >= clear_px[i])
    return use


@compiled
def _distance(dx: float, dy: float, to_circle: np.ndarray, i: int) -> tuple[float, float]:
    """The distance from the centre in half-axes, and how many px each of these is long."""
    u = to_circle[i, 0, 0] * dx + to_circle[i, 0, 1] * dy
    v = to_circle[i, 1, 0] * dx + to_circle[i, 1, 1] * dy
    q = math.sqrt(u * u + v * v)
    return q, math.sqrt(dx * dx + dy * dy) / max(q, 1e-9)
