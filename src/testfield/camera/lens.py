"""Lens models by name: how a direction on the normalised image plane is displaced, and back.

Each model is one formula in plain arithmetic, `image(x, y, c, m)`, that NumPy and the renderer's kernels both evaluate
(`m` supplies `sqrt` and `atan2`); it returns the displaced coordinates and their four derivatives. The rest of this
file is what all models share.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial


@dataclass(frozen=True)
class LensModel:
    """A lens model.

    `coefficients` names, in order; `image` the formula; `by_coefficients` (..., 2) normalised coordinates and the
    coefficients to (..., 2, n) derivatives; `reach` the normalised radius beyond which the model folds back, infinity
    where it never does; `start` a first guess of the undisplaced coordinates.
    """

    coefficients: tuple[str, ...]
    image: Callable[[Any, Any, Any, Any], tuple[Any, Any, Any, Any, Any, Any]]
    by_coefficients: Callable[[np.ndarray, np.ndarray], np.ndarray]
    reach: Callable[[np.ndarray], float]
    start: Callable[[Any, Any, Any], tuple[Any, Any]] = lambda x, y, m: (x, y)


class _NumPy:
    sqrt, atan2, minimum, tan = np.sqrt, np.arctan2, np.minimum, np.tan


def distort(model: LensModel, xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Displaced normalised coordinates (..., 2)."""
    return np.stack(model.image(xy[..., 0], xy[..., 1], c, _NumPy)[:2], axis=-1)


def jacobian_xy(model: LensModel, xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, 2) of `distort` by the normalised coordinates."""
    _, _, xx, xy_, yx, yy = model.image(xy[..., 0], xy[..., 1], c, _NumPy)
    return np.stack([np.stack([xx, xy_], -1), np.stack([yx, yy], -1)], -2)


def undistort(model: LensModel, displaced: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Inverse of `distort` by Newton's method: (..., 2) in, (..., 2) out, NaN where there is no inverse.

    A result beyond the model's reach, or one that does not return to where it began within 1e-12, is NaN.
    """
    xd, yd = displaced[..., 0], displaced[..., 1]
    with np.errstate(all="ignore"):
        x, y = model.start(xd, yd, _NumPy)
        for _ in range(30):
            ex, ey, xx, xy, yx, yy = model.image(x, y, c, _NumPy)
            ex, ey = ex - xd, ey - yd
            determinant = xx * yy - xy * yx
            dx, dy = (yy * ex - xy * ey) / determinant, (xx * ey - yx * ex) / determinant
            x, y = x - dx, y - dy
            if not np.any(np.abs(dx) + np.abs(dy) > 1e-15 * (1 + np.abs(x) + np.abs(y))):
                break
        ex, ey, *_ = model.image(x, y, c, _NumPy)
        good = (np.abs(ex - xd) < 1e-12) & (np.abs(ey - yd) < 1e-12) & (np.hypot(x, y) < model.reach(c))
    return np.where(good[..., None], np.stack([x, y], axis=-1), np.nan)


def _smallest_positive_root(polynomial: Polynomial) -> float:
    roots = polynomial.trim().roots()
    positive = [root.real for root in np.atleast_1d(roots) if abs(root.imag) < 1e-9 and root.real > 1e-12]
    return min(positive, default=np.inf)


# ------------------------------------------------------------------ Brown (1971)
def _brown(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
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


def _brown_by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    return np.stack(
        [
            np.stack([x * r2, x * r2**2, x * r2**3, 2 * x * y, r2 + 2 * x * x], -1),
            np.stack([y * r2, y * r2**2, y * r2**3, r2 + 2 * y * y, 2 * x * y], -1),
        ],
        axis=-2,
    )


def _brown_reach(c: np.ndarray) -> float:
    return float(np.sqrt(_smallest_positive_root(Polynomial([1, 3 * c[0], 5 * c[1], 7 * c[2]]))))


# ------------------------------------------------------------------ Brown with the sensor's axes out of square
def _brown_shear(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    k1, k2, k3, p1, p2, shear = c
    xd, yd, xx, xy, yx, yy = _brown(x, y, (k1, k2, k3, p1, p2), m)
    return xd + shear * yd, yd, xx + shear * yx, xy + shear * yy, yx, yy


def _brown_shear_by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    plain = _brown_by_coefficients(xy, c[:5])
    yd = _brown(xy[..., 0], xy[..., 1], c[:5], _NumPy)[1]
    by_shear = np.stack([yd, np.zeros_like(yd)], axis=-1)[..., None]
    return np.concatenate([plain + c[5] * plain[..., [1], :] * np.array([[1.0], [0.0]]), by_shear], axis=-1)


# ------------------------------------------------------------------ OpenCV's rational and thin-prism model
def _rational(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
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


def _rational_by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
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


def _rational_reach(c: np.ndarray) -> float:
    above, below = Polynomial([1, c[0], c[1], c[4]]), Polynomial([1, c[5], c[6], c[7]])
    s = Polynomial([0, 1])
    # d(r A/B)/dr = 0 in s = r^2, and the pole of A/B.
    turn = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    return float(np.sqrt(min(_smallest_positive_root(turn), _smallest_positive_root(below))))


# ------------------------------------------------------------------ Kannala and Brandt (2006), as OpenCV's fisheye
def _fisheye(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    k1, k2, k3, k4 = c
    r2 = x * x + y * y + 1e-24
    r = m.sqrt(r2)
    angle = m.atan2(r, 0 * r + 1)
    a2 = angle * angle
    image = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    by_angle = 1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))
    scale = image / r
    slope = (by_angle / (1 + r2) - scale) / r2
    return x * scale, y * scale, scale + x * x * slope, x * y * slope, x * y * slope, scale + y * y * slope


def _fisheye_by_coefficients(xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    r = np.hypot(xy[..., 0], xy[..., 1])
    angle = np.arctan(r)
    unit = xy / np.maximum(r, 1e-12)[..., None]
    return unit[..., :, None] * np.stack([angle**n for n in (3, 5, 7, 9)], -1)[..., None, :]


def _fisheye_reach(c: np.ndarray) -> float:
    angle = np.sqrt(_smallest_positive_root(Polynomial([1, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3]])))
    return float(np.tan(angle)) if angle < np.pi / 2 else np.inf


def _fisheye_start(x: Any, y: Any, m: Any) -> tuple[Any, Any]:
    r = m.sqrt(x * x + y * y + 1e-24)
    scale = m.tan(m.minimum(r, 1.5)) / r
    return x * scale, y * scale


MODELS = {
    "brown": LensModel(("k1", "k2", "k3", "p1", "p2"), _brown, _brown_by_coefficients, _brown_reach),
    "brown_shear": LensModel(
        ("k1", "k2", "k3", "p1", "p2", "shear"), _brown_shear, _brown_shear_by_coefficients, _brown_reach
    ),
    "rational": LensModel(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
        _rational,
        _rational_by_coefficients,
        _rational_reach,
    ),
    "fisheye": LensModel(("k1", "k2", "k3", "k4"), _fisheye, _fisheye_by_coefficients, _fisheye_reach, _fisheye_start),
}
"""Lens models by the name a scene or a calibration gives."""
