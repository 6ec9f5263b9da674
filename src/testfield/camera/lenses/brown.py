"""Brown (1971): three radial and two decentring coefficients."""

from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from testfield.camera.lens import ASPECT, PRINCIPAL_POINT, LensModel, NamesElsewhere, smallest_positive_root
from testfield.registry import register


def image(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Displaced coordinates and their derivatives xx, xy, yx, yy."""
    k1, k2, k3, p1, p2 = c
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    off = x * y * slope + 2 * p1 * x + 2 * p2 * y
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
        off,
        off,
        radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )


def by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, n) by the coefficients."""
    x, y = xy[..., 0], xy[..., 1]
    r2, off = x * x + y * y, 2 * x * y
    answer = np.empty((*xy.shape[:-1], 2, 5))
    grown = r2
    for k in range(3):
        answer[..., 0, k], answer[..., 1, k] = x * grown, y * grown
        grown = grown * r2
    answer[..., 0, 3] = answer[..., 1, 4] = off
    answer[..., 0, 4], answer[..., 1, 3] = r2 + 2 * x * x, r2 + 2 * y * y
    return answer


def reach(c: np.ndarray) -> float:
    """The radius beyond which the model folds back."""
    return float(np.sqrt(smallest_positive_root(Polynomial([1, 3 * c[0], 5 * c[1], 7 * c[2]]))))


def radial(r: Any, c: Any) -> tuple[Any, Any]:
    """The radial part of a radius and its derivative."""
    k1, k2, k3 = c[:3]
    r2 = r * r
    return r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))), 1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3))


@register("lenses", "brown")
def brown() -> LensModel:
    """Three radial (k1 k2 k3) and two decentring coefficients (p1 p2), in OpenCV's normalised convention."""
    return LensModel(
        coefficients=("k1", "k2", "k3", "p1", "p2"),
        image=image,
        by_coefficients=by_coefficients,
        reach=reach,
        radial=radial,
        radial_terms=("k1", "k2", "k3"),
        groups=(("k1",), PRINCIPAL_POINT, ("k2",), ("p1", "p2"), ASPECT, ("k3",)),
        in_opencv=NamesElsewhere("", ("k1", "k2", "p1", "p2", "k3")),
        in_colmap=NamesElsewhere("OPENCV", ("k1", "k2", "p1", "p2")),
        examples={
            "weak": (8000, 8001, -0.08, 0.1, 0, 2e-4, -1e-4),
            "strong": (2400, 2403, -0.2, 0.09, -0.02, 1e-3, -8e-4),
        },
        folding=(-0.5, 0, 0, 0, 0),
    )
