"""Marks of one board look alike: one that is smaller than its neighbours, or of another shape, is partly hidden.

What is left of a small dot behind a dark edge is nearly an ellipse again, and fits one within its noise. Only its board
knows how large it should be. Neighbours are asked, not the sheet: a board bends, a lens distorts, and they with it.
"""

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.plane_image import fit_plane, fitted_to, rough_lens
from testfield.camera.rough_lens import RoughLens

NEIGHBOURS, LEAST = 8, 3
UNLIKE = 0.2
"""Difference of second moments from the neighbours', as a fraction of these, from which a mark is another's shape."""
SIGMAS = 8.0
"""The same in standard deviations of the mark's size, which is about as well known as its centre."""


def unlike_neighbours(
    xy_mm: np.ndarray,
    diameter_mm: np.ndarray,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    cov_px2: np.ndarray,
    middle_px: np.ndarray | None = None,
) -> np.ndarray:
    """(n,) which marks of one board, at `xy_mm` (n, 2) on its sheet with `diameter_mm` (n,), were seen at `xy_px`
    (n, 2) with second moments (n, 2, 2) that their neighbours contradict; `cov_px2` (n, 2, 2) of the centres;
    `middle_px` (2,) of the image."""
    n = len(xy_mm)
    unlike = np.zeros(n, bool)
    if n <= LEAST + 1:
        return unlike
    view, middle = (xy_mm, xy_px), xy_px.mean(axis=0) if middle_px is None else middle_px
    lens = RoughLens.pinhole(middle, float(np.linalg.norm(xy_px - middle, axis=1).max()))
    if not fit_plane(view, lens)[1].all():
        lens = rough_lens([view], middle)
    image = fitted_to(view, lens)
    if image is None:
        return unlike
    back = np.linalg.inv(image.maps(xy_mm))
    flat = back @ moments_px2 @ np.swapaxes(back, 1, 2) / np.square(diameter_mm)[:, None, None]
    _, near = cKDTree(xy_mm).query(xy_mm, k=min(NEIGHBOURS + 1, n))
    usual = np.median(flat[near[:, 1:]], axis=1)
    size = np.trace(usual, axis1=1, axis2=2)
    radius_px = np.sqrt(2 * np.trace(moments_px2, axis1=1, axis2=2))
    noise = np.sqrt(np.trace(cov_px2, axis1=1, axis2=2)) / radius_px
    with np.errstate(invalid="ignore"):
        # Of a centre whose uncertainty nobody states, the noise is NaN.
        return np.linalg.norm(flat - usual, axis=(1, 2)) > np.fmax(UNLIKE, SIGMAS * noise) * size
