"""The shape of the rings that an image shows: where, in dot radii, they begin and end."""

import numpy as np

from testfield.detect.polar import values_at
from testfield.detect.screen import circles, half_axes_of
from testfield.targets.marks import LARGEST, LEAST_GAP, LEAST_RING, RingRadii

RAYS, STEP = 48, 0.05
BRIGHT = 0.5
"""What is brighter than this part of the way from ground to dot is a ring's."""
SAME_EDGE, LEAST_RAYS = 0.12, 0.12
"""Edges within the first, in dot radii, are those of one circle; the second part of all rays must meet it."""
LEAST_DOTS, MOST_SPREAD = 3, 0.08
"""So many dots must agree, with so small a median absolute deviation of where their rings begin and end."""
MOST_DOTS = 200


def seen_shape(
    image: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray, contrast_dn: np.ndarray, background_dn: np.ndarray
) -> RingRadii | None:
    """The median shape of what surrounds n dots in an image (h, w) of bright marks, arguments as in `Centres`; None
    where they do not agree, or too few of them have a ring."""
    some = np.linspace(0, len(xy_px) - 1, min(len(xy_px), MOST_DOTS)).astype(int)
    radius = 1 + STEP * np.arange(1, int(LARGEST / STEP))
    places = circles(radius.tolist(), RAYS)
    values = values_at(image, xy_px[some], half_axes_of(moments_px2[some]), places).reshape(len(some), -1, RAYS)
    levels = (values - background_dn[some, None, None]) / contrast_dn[some, None, None]
    edges = np.array([_ring(level.T, radius) for level in levels]).reshape(-1, 2)
    edges = edges[np.isfinite(edges).all(axis=1)]
    if len(edges) < LEAST_DOTS:
        return None
    inner, outer = np.median(edges, axis=0).tolist()
    spread = float(np.median(np.abs(edges - [inner, outer]), axis=0).max())
    if spread > MOST_SPREAD or inner < 1 + LEAST_GAP or outer < inner + LEAST_RING or outer > LARGEST:
        return None
    return RingRadii(round(inner, 2), round(outer, 2))


def _ring(level: np.ndarray, radius: np.ndarray) -> tuple[float, float]:
    """Where the bright parts about one dot begin and end, from levels (RAYS, r) along rays; NaN where there are none.

    The nearest circle on which several rays become bright is the ring's inner edge. A ray beside a segment's end may
    graze it and one that misses all segments meets a neighbour, so medians of those that agree are taken."""
    begins, ends = [], []
    for ray in level:
        dark = np.flatnonzero(ray < BRIGHT)
        if not len(dark):
            continue
        lit = np.flatnonzero(ray[dark[0] :] >= BRIGHT)
        if not len(lit):
            continue
        first = dark[0] + lit[0]
        after = np.flatnonzero(ray[first:] < BRIGHT)
        if not len(after):
            continue
        last = first + after[0]
        begins.append(_crossing(ray, radius, first))
        ends.append(_crossing(ray, radius, last))
    begin, end = np.array(begins), np.array(ends)
    least = max(LEAST_RAYS * RAYS, 3)
    for candidate in np.sort(begin):
        same = np.abs(begin - candidate) < SAME_EDGE
        if same.sum() >= least:
            inner = float(np.median(begin[same]))
            outer = float(np.median(end[np.abs(begin - inner) < SAME_EDGE]))
            return inner, outer
    return np.nan, np.nan


def _crossing(ray: np.ndarray, radius: np.ndarray, k: int) -> float:
    """The radius between the samples k - 1 and k at which the level is `BRIGHT`."""
    part = (BRIGHT - ray[k - 1]) / (ray[k] - ray[k - 1])
    return float(radius[k - 1] + part * (radius[k] - radius[k - 1]))
