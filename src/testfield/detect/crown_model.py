"""The forward model of concentric crowns in perspective: what a pixel sees of them, and its fit to pixels.

A tag's plane is seen by x = t + B u / (1 + v u), B lower triangular, u in radii of the outer circle: t is where its
centre is seen, which is not the centre of any of its ellipses, and B how the plane is seen there, wherever it is.
Edges are blurred by a Gaussian that stands for optics, pixel and what the camera moved during the exposure, and are
straight within it except for their mean bend. Its variance along an edge's normal at an angle f is blur^2 +
E cos(2 f) + D sin(2 f), for a camera that moves blurs one way.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from testfield.camera.images import SensorSheet

SHAPE = 7
"""The first parameters: b11, b21, b22, t (2) in px, v (2)."""
BLUR, BLACK, CONTRAST, LIGHT_X, LIGHT_Y, ALONG_ROWS, DIAGONALLY = range(SHAPE, SHAPE + 7)
UNEVEN = slice(ALONG_ROWS, DIAGONALLY + 1)
"""What blurs along the rows more than down the columns, and along one diagonal more than the other, in px^2."""
ALL = SHAPE + 7
"""Number of all parameters."""
ROUNDS = 25
SETTLED_PX = 1e-4
FIRST_BLUR_PX, LEAST_BLUR_PX, MOST_BLUR_PX = 0.8, 0.25, 5.0
BENDS = 1.5e-5
"""Standard uncertainty of a centre, in diameters, for what a lens bends within a tag: found of rendered tags of 52 to
82 px, whose actual errors were 1.2 times what noise alone states."""
BEYOND_PX, BEYOND = 3.0, 0.12
"""How far beyond the outer circle pixels are looked at, where the paper must be white: in px and in radii."""
LEAST_PIXELS = 60


@dataclass(frozen=True)
class FittedCrowns:
    """One tag: `theta` the parameters, `xy_px` (2,) where its centre is seen, `cov_px2` (2, 2), `chi2` misfit per
    degree of freedom, `misfit` rms residual beyond noise as a part of the contrast."""

    theta: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    chi2: float
    misfit: float


def matrix(theta: np.ndarray) -> np.ndarray:
    """(3, 3) homography from the tag's plane to px."""
    b11, b21, b22, x, y, p, q = theta[:SHAPE]
    return np.array([[b11 + x * p, x * q, x], [b21 + y * p, b22 + y * q, y], [p, q, 1.0]])


def shape_of(H: np.ndarray) -> np.ndarray:
    """(7,) parameters of a homography (3, 3), turned about the tag's centre so that B is lower triangular."""
    H = H / H[2, 2]
    B, v = H[:2, :2] - np.outer(H[:2, 2], H[2, :2]), H[2, :2]
    angle = np.arctan2(B[0, 1], B[0, 0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    B, v = B @ turn, v @ turn
    return np.array([B[0, 0], B[1, 0], B[1, 1], H[0, 2], H[1, 2], v[0], v[1]])


@dataclass(frozen=True)
class _Places:
    """Of pixels (n,): `rho` radii in radii of the tag, `slope` how much a radius grows by px, and `by_shape` (n, 7) by
    the parameters of the shape; `twice` (n, 2) cosine and sine of twice the angle of an edge's normal."""

    rho: np.ndarray
    slope: np.ndarray
    by_shape: np.ndarray
    twice: np.ndarray


def _places(theta: np.ndarray, xy_px: np.ndarray) -> _Places:
    b11, b21, b22, x0, y0, p, q = theta[:SHAPE]
    x, y = xy_px[:, 0] - x0, xy_px[:, 1] - y0
    # (B - (x - t) v) u = x - t, solved for u; its change is its inverse times (-dB u - dt (1 + v u) + (x - t) dv u).
    m11, m12, m21, m22 = b11 - x * p, -x * q, b21 - y * p, b22 - y * q
    determinant = m11 * m22 - m12 * m21
    u, v = (m22 * x - m12 * y) / determinant, (m11 * y - m21 * x) / determinant
    rho = np.sqrt(u * u + v * v + 1e-12)
    hx, hy = (u * m22 - v * m21) / (determinant * rho), (v * m11 - u * m12) / (determinant * rho)
    along, square = hx * x + hy * y, np.maximum(hx * hx + hy * hy, 1e-30)
    twice = np.column_stack([(hx * hx - hy * hy) / square, 2 * hx * hy / square])
    w = 1 + p * u + q * v
    by_shape = np.column_stack([-hx * u, -hy * u, -hy * v, -hx * w, -hy * w, along * u, along * v])
    return _Places(rho, np.maximum(np.abs(w) * np.sqrt(square), 1e-9), by_shape, twice)


def _modelled(theta: np.ndarray, radii: np.ndarray, xy_px: np.ndarray, middle: np.ndarray) -> tuple:
    """Values (n,) above the sensor's black of pixels (n, 2), of a tag with edges at `radii`, and their derivatives
    (n, 14); how fast radii grow and which way edges run is taken as constant in the latter."""
    at = _places(theta, xy_px)
    blur = np.sqrt(np.maximum(theta[BLUR] ** 2 + at.twice @ theta[UNEVEN], LEAST_BLUR_PX**2))
    distance = (radii - at.rho[:, None]) / at.slope[:, None]
    bend = at.slope[:, None] / (2 * radii)
    z = (distance - blur[:, None] ** 2 * bend) / blur[:, None]
    sign = (-1.0) ** (np.arange(len(radii)) + 1)
    white = 1 + ndtr(z) @ sign
    dense = np.exp(-0.5 * z * z) * (sign / np.sqrt(2 * np.pi))
    by_rho = -dense.sum(axis=1) / (at.slope * blur)
    by_blur = (dense * (-distance / blur[:, None] ** 2 - bend)).sum(axis=1) / blur
    offset = xy_px - middle
    light = 1 + offset @ theta[LIGHT_X : LIGHT_Y + 1]
    level = theta[BLACK] + theta[CONTRAST] * white
    factor = light * theta[CONTRAST]
    by_variance = factor * by_blur  # twice the derivative by the variance
    slopes = np.column_stack(
        [
            (factor * by_rho)[:, None] * at.by_shape,
            by_variance * theta[BLUR],
            light,
            light * white,
            level[:, None] * offset,
            by_variance[:, None] * at.twice / 2,
        ]
    )
    return light * level, slopes


def window(theta: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(n, 2) pixels of an image (h, w) that see the tag or what is next to it."""
    size = np.abs(theta[[0, 1, 2]]).sum() * 1.3 + BEYOND_PX + 1
    low = np.maximum(np.floor(theta[3:5] - size), 0).astype(int)
    high = np.minimum(np.ceil(theta[3:5] + size), np.array(shape[::-1]) - 1).astype(int)
    at = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True))), axis=-1).reshape(-1, 2)
    if not len(at):
        return at
    places = _places(theta, at.astype(float))
    return at[(places.rho - 1) / places.slope < np.maximum(BEYOND_PX, BEYOND / places.slope)]


def fit_crowns(
    image_dn: np.ndarray, sheet: SensorSheet, start: np.ndarray, radii: np.ndarray, rounds: int = ROUNDS
) -> FittedCrowns | None:
    """A tag with edges at `radii` in an image (h, w) of `sheet`, from its shape (7,) or all parameters; None where
    nothing can be fitted."""
    at = window(start, image_dn.shape)
    if len(at) < LEAST_PIXELS:
        return None
    xy, middle = at.astype(float), start[3:5].copy()
    values = image_dn[at[:, 1], at[:, 0]].astype(float) - sheet.black_level_dn
    theta = np.zeros(ALL)
    theta[: len(start)] = start
    if len(start) == SHAPE:
        theta[BLUR], theta[CONTRAST] = FIRST_BLUR_PX, 1.0
        shown = _modelled(theta, radii, xy, middle)[0]
        theta[CONTRAST], theta[BLACK] = np.polyfit(shown, values, 1)
    size = float(np.hypot(*theta[:2]))
    steps = np.array(
        [1, 1, 1, 1, 1, 1 / size, 1 / size, 1, abs(theta[CONTRAST]), abs(theta[CONTRAST]), 0.01, 0.01, 1, 1]
    )
    with np.errstate(all="ignore"):
        for _ in range(rounds):
            model, slopes = _modelled(theta, radii, xy, middle)
            weight = 1 / sheet.variance_dn2(model + sheet.black_level_dn)
            scaled = slopes * steps
            if not np.isfinite(scaled).all():
                return None
            inverse = np.linalg.pinv(scaled.T @ (scaled * weight[:, None]), rcond=1e-13, hermitian=True)
            step = inverse @ (scaled.T @ ((values - model) * weight)) * steps
            step[:5] = step[:5].clip(-0.1 * size, 0.1 * size)
            step[5:7] = step[5:7].clip(-0.05, 0.05)
            step[BLUR] = step[BLUR].clip(-0.3, 0.5)
            theta = theta + step
            theta[BLUR] = theta[BLUR].clip(LEAST_BLUR_PX, MOST_BLUR_PX)
            # No way is blurred less than least.
            most = theta[BLUR] ** 2 - LEAST_BLUR_PX**2
            theta[UNEVEN] *= min(1.0, most / max(float(np.hypot(*theta[UNEVEN])), 1e-12))
            if np.abs(step[:5]).max() < SETTLED_PX:
                break
        model = _modelled(theta, radii, xy, middle)[0]
    residual = values - model
    variance = 1 / weight
    chi2 = float((residual**2 * weight).sum() / max(len(at) - len(theta), 1))
    misfit = float(np.sqrt(max((residual**2 - variance).mean(), 0)) / max(abs(theta[CONTRAST]), 1e-9))
    covariance = (inverse * np.outer(steps, steps))[3:5, 3:5]
    if not (np.isfinite(theta).all() and np.isfinite(chi2)):
        return None
    covariance = covariance + (BENDS * 2 * size) ** 2 * np.eye(2)
    doubt = chi2 if chi2 > 1 + 3 * np.sqrt(2 / len(at)) else 1.0
    return FittedCrowns(theta, theta[3:5].copy(), covariance * doubt, chi2, misfit)
