"""OpenCV's rational model with thin prisms."""

from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from testfield.camera.lens import ASPECT, PRINCIPAL_POINT, LensModel, NamesElsewhere, smallest_positive_root
from testfield.registry import register


def image(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Displaced coordinates and their derivatives xx, xy, yx, yy."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = c
    r2 = x * x + y * y
    above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = above / below
    # Twice the derivative by r^2 of everything that depends on the radius alone.
    slope = 2 * ((k1 + r2 * (2 * k2 + r2 * 3 * k3)) - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / below
    prism_x, prism_y = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2),
        radial + x * x * slope + 2 * p1 * y + 6 * p2 * x + x * prism_x,
        x * y * slope + 2 * p1 * x + 2 * p2 * y + y * prism_x,
        x * y * slope + 2 * p1 * x + 2 * p2 * y + x * prism_y,
        radial + y * y * slope + 6 * p1 * y + 2 * p2 * x + y * prism_y,
    )


def by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, n) by the coefficients."""
    k1, k2, _, _, k3, k4, k5, k6 = c[:8]
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
    up, down, zero = 1 / below, -radial / below, np.zeros_like(x)

    def row(v: np.ndarray, p1: np.ndarray, p2: np.ndarray, prism: list[np.ndarray]) -> np.ndarray:
        grow = [v * up * r2, v * up * r2**2, p1, p2, v * up * r2**3]
        return np.stack([*grow, v * down * r2, v * down * r2**2, v * down * r2**3, *prism], -1)

    return np.stack(
        [
            row(x, 2 * x * y, r2 + 2 * x * x, [r2, r2**2, zero, zero]),
            row(y, r2 + 2 * y * y, 2 * x * y, [zero, zero, r2, r2**2]),
        ],
        axis=-2,
    )


def radial(r: Any, c: Any) -> tuple[Any, Any]:
    """The radial part of a radius and its derivative."""
    k1, k2, _, _, k3, k4, k5, k6 = c[:8]
    r2 = r * r
    below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    ratio = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
    slope = 2 * ((k1 + r2 * (2 * k2 + r2 * 3 * k3)) - ratio * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / below
    return r * ratio, ratio + r2 * slope


def reach(c: np.ndarray) -> float:
    """The radius beyond which the model folds back."""
    above, below = Polynomial([1, c[0], c[1], c[4]]), Polynomial([1, c[5], c[6], c[7]])
    s = Polynomial([0, 1])
    # d(r A/B)/dr = 0 in s = r^2, and the pole of A/B.
    turn = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    return float(np.sqrt(min(smallest_positive_root(turn), smallest_positive_root(below))))


@register("lenses", "rational")
def rational() -> LensModel:
    """OpenCV's twelve coefficients: radial as a ratio (k1 to k6), decentring (p1 p2), thin prisms (s1 to s4)."""
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
    return LensModel(
        coefficients=names,
        image=image,
        by_coefficients=by_coefficients,
        reach=reach,
        radial=radial,
        radial_terms=("k1", "k2", "k3"),
        groups=(("k1",), PRINCIPAL_POINT, ("k2",), ("p1", "p2"), ASPECT, *((name,) for name in names[4:])),
        in_opencv=NamesElsewhere("rational", names),
        in_colmap=NamesElsewhere("FULL_OPENCV", names[:8]),
        examples={"": (2600, 2610, -0.31, 0.08, 4e-4, -3e-4, 4e-3, -0.02, 0.01, 2e-3, 1e-3, -2e-4, -8e-4, 1e-4)},
        folding=(0, 0, 0, 0, 0, -0.25, 0, 0, 0, 0, 0, 0),
    )
