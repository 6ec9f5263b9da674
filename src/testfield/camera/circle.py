"""The image of a circle: a detector sees the area of a disc, not the projection of its centre.

The difference (eccentricity, METHODS section 6.4) leaves almost no trace in reprojection residuals and yet moves
the focal length, so it is modelled: the contour is projected through the whole lens and its area integrated.
"""

from dataclasses import dataclass

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project_camera

CONTOUR_POINTS = 16
"""The contour's coordinates are nearly trigonometric polynomials of degree one; 16 points leave under 1e-9 px."""


@dataclass(frozen=True)
class DiscImage:
    """Image of n discs.

    `centroid_px` (n, 2) centre of area, `area_px2` (n,), `moments_px2` (n, 2, 2) second central moments over the
    area divided by it: a disc of radius r px has r^2/4 times the identity.
    """

    centroid_px: np.ndarray
    area_px2: np.ndarray
    moments_px2: np.ndarray

    @property
    def diameter_px(self) -> np.ndarray:
        """(n,) diameter of the circle of equal area."""
        return np.sqrt(4 / np.pi * self.area_px2)


def plane_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (n, 3) that span the planes with the given unit normals (n, 3)."""
    helper = np.where(np.abs(normal[:, :1]) < 0.7, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal, first)


def disc_image(
    interior: Interior, poses: Poses, centre_mm: np.ndarray, normal: np.ndarray, radius_mm: np.ndarray
) -> DiscImage:
    """Image of discs through the full lens model.

    `centre_mm`, `normal` (n, 3) in the world, `radius_mm` (n,), disc i seen from camera-from-world pose i.
    NaN where part of a contour lies outside the lens' domain.
    """
    first, second = plane_axes(normal)
    angle = 2 * np.pi * np.arange(CONTOUR_POINTS) / CONTOUR_POINTS
    rim = np.cos(angle)[:, None] * first[:, None, :] + np.sin(angle)[:, None] * second[:, None, :]
    return contour_image(interior, poses, centre_mm[:, None, :] + radius_mm[:, None, None] * rim)


def disc_centre_px(
    interior: Interior, poses: Poses, centre_mm: np.ndarray, normal: np.ndarray, radius_mm: np.ndarray
) -> np.ndarray:
    """(n, 2) centres of area of discs' images; arguments as of `disc_image`."""
    return disc_image(interior, poses, centre_mm, normal, radius_mm).centroid_px


def contour_image(interior: Interior, poses: Poses, contour_mm: np.ndarray) -> DiscImage:
    """Image of what closed smooth contours enclose, through the full lens model.

    `contour_mm` (n, CONTOUR_POINTS, 3) in the world, at even steps of a contour's angle; contour i seen from
    camera-from-world pose i.
    """
    camera = np.einsum("nij,nkj->nki", poses.R, contour_mm) + poses.t_mm[:, None, :]
    contour = project_camera(interior, camera)
    origin = contour.mean(axis=1)
    x, y = np.moveaxis(contour - origin[:, None, :], -1, 0)

    # Green's theorem along the contour; the trapezoid rule is spectrally accurate on a closed smooth curve.
    dx, dy = _derivative(x), _derivative(y)
    step = 2 * np.pi / CONTOUR_POINTS
    signed = 0.5 * step * (x * dy - y * dx).sum(1)
    cx = 0.5 * step * (x * x * dy).sum(1) / signed
    cy = -0.5 * step * (y * y * dx).sum(1) / signed
    x, y = x - cx[:, None], y - cy[:, None]
    xx = step / 3 * (x**3 * dy).sum(1) / signed
    yy = -step / 3 * (y**3 * dx).sum(1) / signed
    xy = 0.25 * step * (x * x * y * dy - x * y * y * dx).sum(1) / signed
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    return DiscImage(origin + np.column_stack([cx, cy]), np.abs(signed), moments)


def _derivative(values: np.ndarray) -> np.ndarray:
    """Spectral derivative by the contour's angle of periodic samples (n, CONTOUR_POINTS)."""
    spectrum = np.fft.rfft(np.nan_to_num(values), axis=1)
    order = np.arange(spectrum.shape[1])
    order[-1] = 0  # the Nyquist term has no derivative on the grid
    derived = np.fft.irfft(1j * order * spectrum, n=CONTOUR_POINTS, axis=1)
    return np.where(np.isnan(values), np.nan, derived)
