"""Dots of a few pixels, or blurred all over: fitted by the forward model, and believed to be dots where they are alike
in company.

A few pixels do not tell a disc from a square. Many that are alike side by side are a pattern of targets nevertheless:
strokes of letters, texture and dirt have other sizes, shapes or levels than what lies beside them.
"""

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.contour import has_contour
from testfield.detect.knobs import ALIKE, ALL, NONE
from testfield.detect.observations import diameters
from testfield.registry import find

EVERY_PX, FAILED_PX = 6.5, 9.0
"""Dots smaller than the first are fitted by the forward model, and up to the second those that no simpler ellipse fits.
Its outlines are exact at any size, and it uses all pixels around a dot where nothing lies there."""
SMALLEST_PART = 0.95
"""A dot as small as was asked for measures a little less by chance."""
NEIGHBOURS, AGREEING, FEWEST = 8, 6, 9
"""Of so many nearest blobs so many must be alike, and of these together there are so many at least."""
SIZE, ROUGH_SIZE, LEVEL = 1.25, 1.6, 1.4
"""Ratios of sizes in every direction up to which two dots are alike, fitted ones and rough ones; and of contrasts."""
BESIDE = 3.0
"""Sizes further apart than this ratio are of other things, which say nothing of each other."""


def fit_small(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    centres: Centres,
    unclear: str = ALIKE,
) -> None:
    """Put into `centres` of dots at rough places (n, 2) with rough moments (n, 2, 2) and contrasts (n,) what the
    forward model finds of those that are small and in company; `unclear` as `UNCLEAR` of `knobs.py`."""
    small = diameters(moments_px2) < np.where(centres.ok, EVERY_PX, FAILED_PX)
    # Where the edge is as wide as the dot, its distance says nothing: simpler ellipses are a tenth too small.
    small |= centres.ok & ~has_contour(image_dn, centres.xy_px, centres.moments_px2, centres.contrast_dn)
    # What is small and alone would not be told from a square anyway, and texture is full of it.
    if unclear != ALL:
        small = in_company(xy_px, moments_px2, contrast_dn, np.ones(len(xy_px), bool), small, ROUGH_SIZE)
    rows = np.flatnonzero(small)
    if not len(rows):
        return
    fitted = find("centroids", "forward_model")(image_dn, sheet, xy_px[rows], moments_px2[rows])
    good = np.flatnonzero(fitted.ok)
    centres.put(rows[good], Centres(**{name: values[good] for name, values in vars(fitted).items()}))


def believed_dots(centres: Centres, dot: np.ndarray, rows: np.ndarray, unclear: str) -> np.ndarray:
    """(n,) which of the `rows`, whose shape pixels do not tell, are taken for dots, as `UNCLEAR` of `knobs.py` says;
    `dot` (n,) what may be one."""
    asked = np.zeros(len(dot), bool)
    asked[rows] = unclear != NONE
    if unclear != ALIKE or not len(rows):
        return asked
    return in_company(centres.xy_px, centres.moments_px2, centres.contrast_dn, dot, asked)


def in_company(
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    dot: np.ndarray,
    asked: np.ndarray,
    ratio: float = SIZE,
) -> np.ndarray:
    """(n,) which blobs of those `asked` after (a mask) are `dot`s (a mask) whose neighbours are alike: most of the
    nearest blobs of about their size, whatever these are. Rows that are not finite are nobody's neighbours.
    `ratio` is that up to which sizes are alike."""
    answer = np.zeros(len(xy_px), bool)
    area = np.nan_to_num(np.linalg.det(np.nan_to_num(moments_px2)))
    there = np.flatnonzero(np.isfinite(xy_px).all(axis=1) & (area > 0) & np.isfinite(contrast_dn) & (contrast_dn > 0))
    if not asked[there].any() or len(there) < FEWEST:
        return answer
    size, level = area[there] ** 0.25, contrast_dn[there]
    tree = cKDTree(xy_px[there])
    # More than are needed: some are of other sizes.
    gap, near = tree.query(xy_px[there], k=min(3 * NEIGHBOURS, len(there)))
    counts = np.isfinite(gap) & (near != np.arange(len(there))[:, None])
    larger = size[near] / size[:, None]
    counts &= (larger < BESIDE) & (larger > 1 / BESIDE)
    counts &= np.cumsum(counts, axis=1) <= NEIGHBOURS
    m = moments_px2[there]
    relative = np.einsum("nij,nkjl->nkil", np.linalg.inv(m), m[near])
    trace, product = np.einsum("nkii->nk", relative), np.linalg.det(relative)
    spread = np.sqrt(np.maximum(trace**2 / 4 - product, 0))
    low, high = trace / 2 - spread, trace / 2 + spread
    step = level[near] / level[:, None]
    alike = counts & dot[there][near] & (low > ratio**-2) & (high < ratio**2) & (step < LEVEL) & (step > 1 / LEVEL)
    total = counts.sum(axis=1)
    company = (
        dot[there] & (alike.sum(axis=1) >= np.ceil(AGREEING / NEIGHBOURS * total)) & (total >= min(NEIGHBOURS, FEWEST))
    )
    answer[there] = company & asked[there]
    return answer
