"""What a lens does to light besides bending it: depth of field, diffraction, vignetting."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Optics:
    """`aperture_mm` diameter of the entrance pupil and `focus_mm` depth of the plane seen sharply, 0 for a pinhole;
    `airy_px` wavelength x f-number in px, 0 without diffraction; `vignetting` coefficients of r^2, r^4, r^6 with r in
    half-diagonals of the image; `natural_vignetting` whether light falls off with the fourth power of the field
    angle's cosine.
    """

    aperture_mm: float = 0.0
    focus_mm: float = 0.0
    airy_px: float = 0.0
    vignetting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    natural_vignetting: bool = False


PINHOLE = Optics()


def entrance_pupil_mm(principal_distance_mm: float, f_number: float, focus_mm: float) -> float:
    """Diameter of the entrance pupil of a thin lens whose principal distance is that of the focused image.

    Gauss' equation 1 / f = 1 / c + 1 / s gives the focal length f for principal distance c and focus s.
    """
    return principal_distance_mm * focus_mm / (principal_distance_mm + focus_mm) / f_number


def blur_circle_px(optics: Optics, focal_px: float, depth_mm: np.ndarray) -> np.ndarray:
    """Diameter in px of the blur circle of points at depths along the optical axis: D c |1/s - 1/z| in the image.

    Thin lens (e.g. Kraus, Photogrammetrie 1, section 3.1.6): c is the principal distance, D the entrance pupil.
    """
    if optics.aperture_mm == 0:
        return np.zeros_like(depth_mm)
    return optics.aperture_mm * focal_px * np.abs(1 / optics.focus_mm - 1 / depth_mm)
