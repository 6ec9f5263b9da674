"""What lens models are, and what all of them share: a direction on the normalised image plane is displaced, and back.

Each model is one formula in plain arithmetic, `image(x, y, c, m)`, that NumPy and the renderer's kernels both evaluate
(`m` supplies `sqrt` and `atan2`); it returns the displaced coordinates and their four derivatives. A fisheye's formula
takes a ray, whose angle may exceed 90 degrees, and has two derivatives more, by its third component.

Each stands in one file of `camera/lenses` and is found by the name under which that file registers it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from testfield.registry import find, names

PRINCIPAL_POINT, ASPECT = ("cx", "cy"), ("aspect",)


@dataclass(frozen=True)
class NamesElsewhere:
    """What another tool calls a lens model: its `name`, empty where it has none, and those of the coefficients that it
    knows, in its order."""

    name: str
    coefficients: tuple[str, ...]


@dataclass(frozen=True)
class LensModel:
    """A lens model.

    `coefficients` names, in order; `image` the formula; `by_coefficients` (..., 2) normalised coordinates and the
    coefficients to (..., 2, n) derivatives; `reach` the normalised radius beyond which the model folds back, infinity
    where it never does; `radial` (r, coefficients) to the image's radius and its derivative of the radial part alone.

    A lens `by_angle` is one whose formula is of the angle from the axis, which may exceed 90 degrees: its `image` and
    `by_coefficients` take the ray's third component too, `radial` the angle, and `last_angle` is the one at which the
    image's radius is largest.

    For a calibration: `radial_terms` are those coefficients of the radial part by which the image's radius is linear,
    lowest order first, so that they can be fitted before anything else is known; `as_pinhole` (n,) are coefficients at
    which the lens is nearest to a pinhole, zero each where not given; `groups` are the parameters in the order in which
    a free network is asked for them, those together that are known together, `cx`, `cy` and `aspect` (of fy to fx)
    among them, one coefficient after another where not given. `in_opencv` and `in_colmap` are its names there.

    For the certificate: `examples` of lenses for 4096 x 3000 px by name, each fx and fy in px and the coefficients;
    `folding` (n,) coefficients with which the image folds back within a radius of 5.
    """

    coefficients: tuple[str, ...]
    image: Callable[..., tuple[Any, ...]]
    by_coefficients: Callable[[np.ndarray, np.ndarray], np.ndarray]
    reach: Callable[[np.ndarray], float]
    radial: Callable[[Any, Any], tuple[Any, Any]]
    last_angle: Callable[[np.ndarray], float] | None = None
    radial_terms: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    as_pinhole: tuple[float, ...] = ()
    in_opencv: NamesElsewhere | None = None
    in_colmap: NamesElsewhere | None = None
    examples: Mapping[str, tuple[float, ...]] = field(default_factory=dict, hash=False)
    folding: tuple[float, ...] | None = None

    @property
    def by_angle(self) -> bool:
        """Whether its formula is of the angle from the axis."""
        return self.last_angle is not None

    @property
    def parameter_groups(self) -> tuple[tuple[str, ...], ...]:
        """All parameters in the order in which a free network is asked for them, the focal lengths first."""
        alone = tuple((name,) for name in self.coefficients)
        return (("fx", "fy"), *(self.groups or (*alone[:1], PRINCIPAL_POINT, ASPECT, *alone[1:])))

    @property
    def pinhole(self) -> np.ndarray:
        """(n,) coefficients at which the lens is nearest to a pinhole."""
        return np.array(self.as_pinhole or [0.0] * len(self.coefficients))


def lens_model(name: str) -> LensModel:
    """The lens model of a name. Raises `TestfieldError` where there is none."""
    return _made(find("lenses", name))


def lens_names() -> list[str]:
    """Names of all lens models, sorted."""
    return names("lenses")


def all_coefficients() -> set[str]:
    """Names of the coefficients of all lens models."""
    return {name for model in lens_names() for name in lens_model(model).coefficients}


@cache
def _made(make: Callable[[], LensModel]) -> LensModel:
    return make()


class NUMPY:
    """What a formula takes its functions from where it is evaluated by NumPy."""

    sqrt, atan2 = np.sqrt, np.arctan2


NEWTON_STEPS, BRACKETED_STEPS = 30, 80
FARTHEST = 1e6


def distort(model: LensModel, xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Displaced normalised coordinates (..., 2)."""
    return np.stack(model.image(xy[..., 0], xy[..., 1], c, NUMPY)[:2], axis=-1)


def jacobian_xy(model: LensModel, xy: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, 2) of `distort` by the normalised coordinates."""
    _, _, xx, xy_, yx, yy = model.image(xy[..., 0], xy[..., 1], c, NUMPY)[:6]
    return np.stack([np.stack([xx, xy_], -1), np.stack([yx, yy], -1)], -2)


def image_of_rays(model: LensModel, rays: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displaced coordinates (..., 2) of rays (..., 3), their derivatives (..., 2, 3) by the rays, and which of them
    (...,) lie in the lens' domain: before the camera and where the model has not folded back."""
    image, by_rays = formula_of_rays(model, rays, c)
    x, y, z = np.moveaxis(rays, -1, 0)
    with np.errstate(all="ignore"):
        if model.last_angle is not None:
            return image, by_rays, np.arctan2(np.hypot(x, y), z) < model.last_angle(c)
        (ux, uy), (vx, vy) = np.moveaxis(by_rays[..., :2], (-2, -1), (0, 1)) * z
        good = (z > 0) & (np.hypot(x / z, y / z) < model.reach(c)) & (ux * vy - uy * vx > 0)
    return image, by_rays, good


def formula_of_rays(model: LensModel, rays: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displaced coordinates (..., 2) of rays (..., 3) and their derivatives (..., 2, 3), whatever the formula gives."""
    x, y, z = rays[..., 0], rays[..., 1], rays[..., 2]
    image, by_rays = np.empty((*rays.shape[:-1], 2)), np.empty((*rays.shape[:-1], 2, 3))
    with np.errstate(all="ignore"):
        if model.by_angle:
            u, v, ux, uy, vx, vy, uz, vz = model.image(x, y, c, NUMPY, z)
        else:
            x, y = x / z, y / z
            u, v, *slopes = model.image(x, y, c, NUMPY)
            ux, uy, vx, vy = (slope / z for slope in slopes)
            uz, vz = -(ux * x + uy * y), -(vx * x + vy * y)
    image[..., 0], image[..., 1] = u, v
    for k, (of_u, of_v) in enumerate(((ux, vx), (uy, vy), (uz, vz))):
        by_rays[..., 0, k], by_rays[..., 1, k] = of_u, of_v
    return image, by_rays


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
        ex, ey, xx, xy, yx, yy = model.image(x, y, c, NUMPY)
        ex, ey = ex - xd, ey - yd
        determinant = xx * yy - xy * yx
        dx, dy = (yy * ex - xy * ey) / determinant, (xx * ey - yx * ex) / determinant
        x, y = x - dx, y - dy
        if not np.any(np.abs(dx) + np.abs(dy) > 1e-15 * (1 + np.abs(x) + np.abs(y))):
            break
    ex, ey, xx, xy, yx, yy = model.image(x, y, c, NUMPY)
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


def smallest_positive_root(polynomial: Polynomial) -> float:
    """The smallest real root above zero, infinity where there is none."""
    roots = polynomial.trim().roots()
    positive = [root.real for root in np.atleast_1d(roots) if abs(root.imag) < 1e-9 and root.real > 1e-12]
    return min(positive, default=np.inf)
