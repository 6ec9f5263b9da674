"""Kannala and Brandt (2006), as OpenCV's fisheye: a polynomial of the angle from the axis."""

from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from testfield.camera.lens import ASPECT, PRINCIPAL_POINT, LensModel, NamesElsewhere, smallest_positive_root
from testfield.registry import register


def image(x: Any, y: Any, c: Any, m: Any, z: Any = 1.0) -> tuple[Any, ...]:
    """Displaced coordinates and their derivatives xx, xy, yx, yy."""
    r2 = x * x + y * y + 1e-24
    r = m.sqrt(r2)
    image, by_angle = radial(m.atan2(r, 0 * r + z), c)
    scale = image / r
    turn = by_angle / (z * z + r2)
    slope = (z * turn - scale) / r2
    off = x * y * slope
    return x * scale, y * scale, scale + x * x * slope, off, off, scale + y * y * slope, -x * turn, -y * turn


def radial(angle: Any, c: Any) -> tuple[Any, Any]:
    """The radial part of a radius and its derivative."""
    k1, k2, k3, k4 = c
    a2 = angle * angle
    return (
        angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))),
        1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4))),
    )


def by_coefficients(ray: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, n) by the coefficients."""
    r = np.hypot(ray[..., 0], ray[..., 1])
    angle = np.arctan2(r, ray[..., 2] if ray.shape[-1] == 3 else 1.0)
    unit = ray[..., :2] / np.maximum(r, 1e-12)[..., None]
    return unit[..., :, None] * np.stack([angle**n for n in (3, 5, 7, 9)], -1)[..., None, :]


def last_angle(c: np.ndarray) -> float:
    """The angle at which the image's radius is largest."""
    root = smallest_positive_root(Polynomial([1, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3]]))
    return float(min(np.sqrt(root), np.pi))


def reach(c: np.ndarray) -> float:
    """The radius beyond which the model folds back."""
    angle = last_angle(c)
    return float(np.tan(angle)) if angle < np.pi / 2 else np.inf


@register("lenses", "fisheye")
def fisheye() -> LensModel:
    """Kannala and Brandt's polynomial of the angle from the axis (k1 to k4), for fields up to 180 degrees and more."""
    names = ("k1", "k2", "k3", "k4")
    return LensModel(
        coefficients=names,
        image=image,
        by_coefficients=by_coefficients,
        reach=reach,
        radial=radial,
        last_angle=last_angle,
        radial_terms=names,
        groups=(("k1",), PRINCIPAL_POINT, ("k2",), ASPECT, ("k3",), ("k4",)),
        as_pinhole=(1 / 3, 2 / 15, 17 / 315, 62 / 2835),  # the tangent's series
        in_opencv=NamesElsewhere("fisheye", names),
        in_colmap=NamesElsewhere("OPENCV_FISHEYE", names),
        examples={"": (1700, 1702, 0.02, -6e-3, 2e-3, -4e-4)},
        folding=(-0.3, 0, 0, 0),
    )
