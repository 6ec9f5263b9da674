"""Lens models by name: how a direction on the normalised image plane is displaced, and back.

Each model is one formula in plain arithmetic, `image(x, y, c, m)`, that NumPy and the renderer's kernels both evaluate
(`m` supplies `sqrt` and `atan2`); it returns the displaced coordinates and their four derivatives. A fisheye's formula
takes a ray, whose angle may exceed 90 degrees, and has two derivatives more, by its third component. The rest of this
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
    where it never does; `radial` (r, coefficients) to the image's radius and its derivative of the radial part alone.

    A lens `by_angle` is one whose formula is of the angle from the axis, which may exceed 90 degrees: its `image` and
    `by_coefficients` take the ray's third component too, `radial` the angle, and `last_angle` is the one at which the
    image's radius is largest.
    """

    coefficients: tuple[str, ...]
    image: Callable[..., tuple[Any, ...]]
    by_coefficients: Callable[[np.ndarray, np.ndarray], np.ndarray]
    reach: Callable[[np.ndarray], float]
    radial: Callable[[Any, Any], tuple[Any, Any]]
    last_angle: Callable[[np.ndarray], float] | None = None

    @property
    def by_angle(self) -> bool:
        """Whether its formula is of the angle from the axis."""
        return self.last_angle is not None


class _NumPy:
    sqrt, atan2 = np.sqrt, np.arctan2


NEWTON_STEPS, BRACKETED_STEPS = 30, 80
FARTHEST = 1e6


def distort(model: LensModel, xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Displaced normalised coordinates (..., 2)."""
    return np.stack(model.image(xy[..., 0], xy[..., 1], c, _NumPy)[:2], axis=-1)


def jacobian_xy(model: LensModel, xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, 2) of `distort` by the normalised coordinates."""
    _, _, xx, xy_, yx, yy = model.image(xy[..., 0], xy[..., 1], c, _NumPy)[:6]
    return np.stack([np.stack([xx, xy_], -1), np.stack([yx, yy], -1)], -2)


def image_of_rays(model: LensModel, rays: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displaced coordinates (..., 2) of rays (..., 3), their derivatives (..., 2, 3) by the rays, and which of them
    (...,) lie in the lens' domain: before the camera and where the model has not folded back."""
    x, y, z = np.moveaxis(rays, -1, 0)
    with np.errstate(all="ignore"):
        if model.last_angle is not None:
            u, v, ux, uy, vx, vy, uz, vz = model.image(x, y, c, _NumPy, z)
            good = np.arctan2(np.hypot(x, y), z) < model.last_angle(c)
        else:
            u, v, ux, uy, vx, vy = model.image(x / z, y / z, c, _NumPy)
            good = (z > 0) & (np.hypot(x / z, y / z) < model.reach(c)) & (ux * vy - uy * vx > 0)
            ux, uy, vx, vy = ux / z, uy / z, vx / z, vy / z
            uz, vz = -(ux * x + uy * y) / z, -(vx * x + vy * y) / z
    by_rays = np.stack([np.stack([ux, uy, uz], -1), np.stack([vx, vy, vz], -1)], -2)
    return np.stack([u, v], axis=-1), by_rays, good


def rays_of_image(model: LensModel, displaced: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Inverse of `image_of_rays`: rays (..., 3), NaN where there is none; with a third component of one where they lie
    before the camera, of length one beyond 90 degrees."""
    if model.last_angle is None:
        xy = undistort(model, displaced, c)
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
    r = np.hypot(displaced[..., 0], displaced[..., 1])
    angle = bracketed(lambda a: model.radial(a, c), r, model.last_angle(c))
    side = displaced * (np.sin(angle) / np.where(r > 0, r, 1.0))[..., None]
    ray = np.concatenate([side, np.cos(angle)[..., None]], axis=-1)
    return np.asarray(ray / np.where(ray[..., 2:] > 1 / FARTHEST, ray[..., 2:], 1.0))


def undistort(model: LensModel, displaced: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Inverse of `distort`: (..., 2) in, (..., 2) out, NaN where there is no inverse.

    Newton's method; where it fails it begins again from the inverse of the radial part, which is bracketed and so
    always found. A result beyond the model's reach, or one that does not return to where it began within 1e-12, is NaN.
    """
    if model.last_angle is not None:
        ray = rays_of_image(model, displaced, c)
        return np.where(ray[..., 2:] == 1, ray[..., :2], np.nan)
    with np.errstate(all="ignore"):
        xy, good = _newton(model, displaced, displaced, c)
        left = ~good & np.isfinite(displaced).all(axis=-1)
        if left.any():
            r = np.hypot(displaced[left][..., 0], displaced[left][..., 1])
            reach = min(model.reach(c), FARTHEST)
            radius = bracketed(lambda radius: model.radial(radius, c), r, reach)
            radius = np.where(np.isfinite(radius), radius, 0.999 * reach)
            xy[left], good[left] = _newton(model, displaced[left], displaced[left] * (radius / r)[..., None], c)
    return np.where(good[..., None], xy, np.nan)


def _newton(model: LensModel, displaced: np.ndarray, start: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undisplaced coordinates (..., 2) by Newton's method, and where (...,) they are right."""
    (xd, yd), (x, y) = np.moveaxis(displaced, -1, 0), np.moveaxis(start, -1, 0)
    for _ in range(NEWTON_STEPS):
        ex, ey, xx, xy, yx, yy = model.image(x, y, c, _NumPy)
        ex, ey = ex - xd, ey - yd
        determinant = xx * yy - xy * yx
        dx, dy = (yy * ex - xy * ey) / determinant, (xx * ey - yx * ex) / determinant
        x, y = x - dx, y - dy
        if not np.any(np.abs(dx) + np.abs(dy) > 1e-15 * (1 + np.abs(x) + np.abs(y))):
            break
    ex, ey, xx, xy, yx, yy = model.image(x, y, c, _NumPy)
    good = (np.abs(ex - xd) < 1e-12) & (np.abs(ey - yd) < 1e-12) & (np.hypot(x, y) < model.reach(c))
    return np.stack([x, y], axis=-1), good & (xx * yy - xy * yx > 0)


def bracketed(
    rising: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], value: np.ndarray, end: float
) -> np.ndarray:
    """Where a function that rises from 0 at 0 up to `end` has the values (...,), NaN where it has not.

    `rising` gives the function and its derivative. Newton's method, and bisection where a step would leave the bracket.
    """
    low, high = np.zeros_like(value), np.full_like(value, end)
    at = np.minimum(value, 0.999 * end)
    with np.errstate(all="ignore"):
        for _ in range(BRACKETED_STEPS):
            off, slope = rising(at)
            off = off - value
            low, high = np.where(off <= 0, at, low), np.where(off > 0, at, high)
            step = at - off / slope
            new = np.where((step >= low) & (step <= high), step, (low + high) / 2)
            settled = (np.abs(new - at) <= 4e-16 * at) | ~np.isfinite(value)
            at = new
            if settled.all():
                break
        return np.where(value <= rising(np.full_like(value, end))[0], at, np.nan)


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


def _brown_radial(r: Any, c: Any) -> tuple[Any, Any]:
    k1, k2, k3 = c[:3]
    r2 = r * r
    return r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))), 1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3))


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


def _rational_radial(r: Any, c: Any) -> tuple[Any, Any]:
    k1, k2, _, _, k3, k4, k5, k6 = c[:8]
    r2 = r * r
    below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    ratio = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
    slope = 2 * ((k1 + r2 * (2 * k2 + r2 * 3 * k3)) - ratio * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / below
    return r * ratio, ratio + r2 * slope


def _rational_reach(c: np.ndarray) -> float:
    above, below = Polynomial([1, c[0], c[1], c[4]]), Polynomial([1, c[5], c[6], c[7]])
    s = Polynomial([0, 1])
    # d(r A/B)/dr = 0 in s = r^2, and the pole of A/B.
    turn = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    return float(np.sqrt(min(_smallest_positive_root(turn), _smallest_positive_root(below))))


# ------------------------------------------------------------------ Kannala and Brandt (2006), as OpenCV's fisheye
def _fisheye(x: Any, y: Any, c: Any, m: Any, z: Any = 1.0) -> tuple[Any, ...]:
    r2 = x * x + y * y + 1e-24
    r = m.sqrt(r2)
    image, by_angle = _fisheye_radial(m.atan2(r, 0 * r + z), c)
    scale = image / r
    turn = by_angle / (z * z + r2)
    slope = (z * turn - scale) / r2
    off = x * y * slope
    return x * scale, y * scale, scale + x * x * slope, off, off, scale + y * y * slope, -x * turn, -y * turn


def _fisheye_radial(angle: Any, c: Any) -> tuple[Any, Any]:
    k1, k2, k3, k4 = c
    a2 = angle * angle
    return (
        angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))),
        1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4))),
    )


def _fisheye_by_coefficients(ray: np.ndarray, c: np.ndarray) -> np.ndarray:
    r = np.hypot(ray[..., 0], ray[..., 1])
    angle = np.arctan2(r, ray[..., 2] if ray.shape[-1] == 3 else 1.0)
    unit = ray[..., :2] / np.maximum(r, 1e-12)[..., None]
    return unit[..., :, None] * np.stack([angle**n for n in (3, 5, 7, 9)], -1)[..., None, :]


def _fisheye_last_angle(c: np.ndarray) -> float:
    root = _smallest_positive_root(Polynomial([1, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3]]))
    return float(min(np.sqrt(root), np.pi))


def _fisheye_reach(c: np.ndarray) -> float:
    angle = _fisheye_last_angle(c)
    return float(np.tan(angle)) if angle < np.pi / 2 else np.inf


MODELS = {
    "brown": LensModel(("k1", "k2", "k3", "p1", "p2"), _brown, _brown_by_coefficients, _brown_reach, _brown_radial),
    "brown_shear": LensModel(
        ("k1", "k2", "k3", "p1", "p2", "shear"), _brown_shear, _brown_shear_by_coefficients, _brown_reach, _brown_radial
    ),
    "rational": LensModel(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
        _rational,
        _rational_by_coefficients,
        _rational_reach,
        _rational_radial,
    ),
    "fisheye": LensModel(
        ("k1", "k2", "k3", "k4"), _fisheye, _fisheye_by_coefficients, _fisheye_reach, _fisheye_radial,
        _fisheye_last_angle,
    ),
}  # fmt: skip
"""Lens models by the name a scene or a calibration gives."""
