"""Brown's lens before a sensor whose axes are out of square."""

from typing import Any

import numpy as np

from testfield.camera.lens import ASPECT, NUMPY, PRINCIPAL_POINT, LensModel
from testfield.camera.lenses import brown
from testfield.registry import register


def image(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Displaced coordinates and their derivatives xx, xy, yx, yy."""
    k1, k2, k3, p1, p2, shear = c
    xd, yd, xx, xy, yx, yy = brown.image(x, y, (k1, k2, k3, p1, p2), m)
    return xd + shear * yd, yd, xx + shear * yx, xy + shear * yy, yx, yy


def by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, n) by the coefficients."""
    plain = brown.by_coefficients(xy, c[:5])
    yd = brown.image(xy[..., 0], xy[..., 1], c[:5], NUMPY)[1]
    by_shear = np.stack([yd, np.zeros_like(yd)], axis=-1)[..., None]
    return np.concatenate([plain + c[5] * plain[..., [1], :] * np.array([[1.0], [0.0]]), by_shear], axis=-1)


@register("lenses", "brown_shear")
def brown_shear() -> LensModel:
    """Brown's coefficients, and by how much x grows with y (shear), both displaced and normalised."""
    return LensModel(
        coefficients=("k1", "k2", "k3", "p1", "p2", "shear"),
        image=image,
        by_coefficients=by_coefficients,
        reach=brown.reach,
        radial=brown.radial,
        radial_terms=("k1", "k2", "k3"),
        groups=(("k1",), PRINCIPAL_POINT, ("k2",), ("p1", "p2"), ASPECT, ("k3",), ("shear",)),
        examples={"": (2400, 2403, -0.2, 0.09, -0.02, 1e-3, -8e-4, 3e-3)},
        folding=(-0.5, 0, 0, 0, 0, 0.01),
    )
