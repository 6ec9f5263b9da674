"""A quick look at every blob: is it bright inside, and darker all around? What is not costs no fit."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from testfield.detect.by_place import by_place
from testfield.detect.sampling import WINDOW_PX, median_of, sampled
from testfield.store.compiled import compiled

RAYS = 24
INSIDE, RIM = (0.4, 0.75), (1.35, 1.6)
"""Radii, in dot radii, at which the dot and the gap around it are sampled; less where a ring begins before 2."""
DARKER = 0.5
"""What lies around must be darker than this part of the way from the surroundings to the dot, in every direction."""
LEAST_SIGMAS = 4.0


def may_be_dots(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    noise_dn: np.ndarray,
    ring_begins: float = 2.0,
) -> np.ndarray:
    """(n,) whether blobs at `xy_px` (n, 2) of moments (n, 2, 2) are bright spots on darker ground in all directions.

    `image_dn` (h, w) float32 of bright marks; `contrast_dn` and `noise_dn` (n,); a ring may begin at `ring_begins` dot
    radii. Directions that lead out of the
    image are not asked. Blobs without finite numbers are none.
    """
    answer = np.isfinite(xy_px).all(1) & np.isfinite(moments_px2).all((1, 2)) & (contrast_dn > LEAST_SIGMAS * noise_dn)
    asked = np.flatnonzero(answer)
    gap = min(ring_begins - 1, 1.0)
    rim = [1 + gap * (radius - 1) for radius in RIM]
    axes, places = half_axes_of(moments_px2[asked]), circles((*rim, *INSIDE), RAYS)
    image = np.ascontiguousarray(image_dn, np.float32)
    answer[asked] = by_place(partial(_spots, image, places), xy_px[asked], axes, contrast_dn[asked], noise_dn[asked])
    return answer


@compiled
def _spots(
    image: np.ndarray,
    places: np.ndarray,
    xy: np.ndarray,
    axes: np.ndarray,
    contrast: np.ndarray,
    noise: np.ndarray,
) -> np.ndarray:
    """Of spots whose `places` are those of the rims and the insides, one circle behind the other."""
    rays = len(places) // 4
    answer = np.zeros(len(xy), np.bool_)
    values, sorting = np.empty(4 * rays, np.float32), np.empty(rays, np.float32)
    near, rim, inner, inside = values[:rays], values[rays : 2 * rays], values[2 * rays : 3 * rays], values[3 * rays :]
    window = np.empty((WINDOW_PX, WINDOW_PX), np.float32)
    for i in range(len(xy)):
        sampled(image, xy[i], axes[i], places, window, values)
        known = 0
        for k in range(rays):
            if near[k] < rim[k] or np.isnan(near[k]):
                rim[k] = near[k]
            known += not np.isnan(rim[k])
            sorting[k] = rim[k]
        if known <= rays / 2:
            continue
        ground = median_of(sorting)
        for k in range(rays):
            sorting[k] = inner[k]
        middle = median_of(sorting)
        step, doubt = middle - ground, 3 * noise[i]
        most = DARKER * step + doubt
        good = step > 0.3 * contrast[i]
        for k in range(rays):
            # What is not known compares with nothing, and is not asked.
            if rim[k] - ground >= most or abs(inner[k] - middle) >= most or inside[k] <= middle - most:
                good = False
        answer[i] = good
    return answer


def circles(radii: Sequence[float], count: int) -> np.ndarray:
    """(r * count, 2) places on circles, on each at equal angles clockwise in the image, the first half a step from
    +x."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    return np.concatenate([radius * np.column_stack([np.cos(angle), np.sin(angle)]) for radius in radii])


def half_axes_of(moments_px2: np.ndarray) -> np.ndarray:
    """Symmetric (n, 2, 2) that maps the unit circle onto the ellipse of the moments without turning it.

    Of a positive matrix the root is the matrix plus the root of its determinant, over the root of its trace plus twice
    that; of others what is negative counts as nothing.
    """
    m = 4 * np.asarray(moments_px2, float)
    determinant, trace = m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] ** 2, m[:, 0, 0] + m[:, 1, 1]
    positive = (determinant > 0) & (trace > 0)
    root = np.sqrt(np.where(positive, determinant, 1))
    axes = (m + root[:, None, None] * np.eye(2)) / np.sqrt(np.where(positive, trace + 2 * root, 1))[:, None, None]
    others = np.flatnonzero(~positive)
    if len(others):
        values, vectors = np.linalg.eigh(m[others])
        axes[others] = (vectors * np.sqrt(np.maximum(values, 0))[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return axes
