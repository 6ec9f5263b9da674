"""The forward model of a corner: two straight edges that cross or meet, blurred, fitted to the raw pixels.

A blurred pixel sees of the plane on one side of a line the normal distribution of its distance, and of a quadrant
between two lines the bivariate normal distribution of both distances, whose correlation is the cosine between the
lines' normals. Crossing edges (checkerboards) and an edge that turns (tags) are sums of these. Nine parameters a
corner: its place, the lines' directions, blur, black, contrast, and the light's gradient, none of them known from
elsewhere, so the covariance is that of a corner of which nothing else is known. The pixel's own area counts as part
of the Gaussian blur.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from testfield.camera.images import SensorSheet

HALF_PX = 9
"""Half-width of the window: farther out, a lens bends edges by what can be measured."""
CX, CY, ALONG_X, ALONG_Y, BLUR, BLACK, CONTRAST, LIGHT_X, LIGHT_Y = range(9)
ROUNDS = 20
FIRST_BLUR_PX, LEAST_BLUR_PX, MOST_BLUR_PX = 0.7, 0.25, 6.0
SETTLED_PX = 1e-5
FARTHEST_PX = 3.0
"""A corner that ends up farther from where it was looked for is another one."""
LEAST_PIXELS, LEAST_A_SIDE = 30, 8
"""Pixels that a fit needs, in all and on either side of the middle between black and white: where a neighbour leaves
only one side, what is seen of the edge is its tail."""
LEAST_CONTRAST = 5.0
"""Contrast over noise below which nothing is measured."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


@dataclass(frozen=True)
class FittedCorners:
    """Measured corners, n rows: `xy_px` (n, 2), `cov_px2` (n, 2, 2), `contrast_dn` (n,), negative where crossing edges
    have black where white was expected, `white_dn` (n,) level of white, `blur_px` (n,) sigma with the pixel's
    area, `chi2` (n,) misfit per degree of freedom, `misfit` (n,) rms residual beyond noise as a fraction of the
    contrast, `ok` (n,) whether it was measured."""

    xy_px: np.ndarray
    cov_px2: np.ndarray
    contrast_dn: np.ndarray
    white_dn: np.ndarray
    blur_px: np.ndarray
    chi2: np.ndarray
    misfit: np.ndarray
    ok: np.ndarray


def offsets_px() -> np.ndarray:
    """(k, 2) x and y of a window's pixels from its middle one."""
    side = np.arange(-HALF_PX, HALF_PX + 1)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def fit_corners(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    xy_px: np.ndarray,
    axes_px: np.ndarray,
    crossing: np.ndarray,
    use: np.ndarray,
) -> FittedCorners:
    """Corners near (n, 2) px in an image (h, w).

    `axes_px` (n, 2, 2) has as columns the directions of the two edges in the image, u and v. Where `crossing` (n,),
    both go through the corner, and white is the quadrant between u and v and the one opposite; elsewhere the quadrant
    between u and v is black and all else white. `use` (n, k) which pixels of `offsets_px` around the nearest pixel may
    be used; those beyond the image's edge are not.
    """
    n, (height, width) = len(xy_px), image_dn.shape
    middle = np.rint(np.nan_to_num(xy_px)).astype(int)
    at = middle[:, None] + offsets_px()
    use = use & (at >= 0).all(axis=2) & (at < [width, height]).all(axis=2)
    values = image_dn[at[..., 1].clip(0, height - 1), at[..., 0].clip(0, width - 1)].astype(float)
    theta, start = _start(values - sheet.black_level_dn, use, xy_px - middle, axes_px, crossing)
    moved, normal = np.full(n, np.inf), np.tile(np.eye(9), (n, 1, 1))
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            model, slope = _model(theta, crossing)
            variance = sheet.variance_dn2(model + sheet.black_level_dn)
            weight = np.where(use, 1 / variance, 0.0)
            residual = values - sheet.black_level_dn - model
            right = np.einsum("nkp,nk->np", slope, weight * residual)
            normal = np.swapaxes(slope * weight[..., None], 1, 2) @ slope
            step = _solve(normal, right[..., None])[..., 0]
            step[:, :2] = step[:, :2].clip(-1, 1)
            step[:, ALONG_X : ALONG_Y + 1] = step[:, ALONG_X : ALONG_Y + 1].clip(-0.2, 0.2)
            step[:, BLUR] = step[:, BLUR].clip(-0.3, 0.5)
            moved = np.abs(step[:, :2]).max(axis=1)
            if (moved[np.isfinite(moved)] < SETTLED_PX).all():
                break
            theta = theta + np.nan_to_num(step)
            theta[:, BLUR] = theta[:, BLUR].clip(LEAST_BLUR_PX, MOST_BLUR_PX)
        count = use.sum(axis=1)
        freedom = np.maximum(count - 9, 1)
        chi2 = (weight * residual**2).sum(axis=1) / freedom
        covariance = _solve(normal, np.tile(np.eye(9), (n, 1, 1)))[:, :2, :2]
        # What the model leaves unexplained, beyond chance, is doubt about the corner too.
        covariance = covariance * np.where(chi2 > 1 + 3 * np.sqrt(2 / freedom), chi2, 1.0)[:, None, None]
        excess = (use * (residual**2 - variance)).sum(axis=1) / np.maximum(count, 1)
        misfit = np.sqrt(np.maximum(excess, 0)) / np.abs(theta[:, CONTRAST])
        noise = np.sqrt(sheet.variance_dn2(sheet.black_level_dn + theta[:, BLACK] + theta[:, CONTRAST] / 2))
        bright = use & ((model - theta[:, BLACK, None]) / theta[:, CONTRAST, None] > 0.5)
        either = np.minimum(bright.sum(axis=1), count - bright.sum(axis=1))
        ok = (
            (count >= LEAST_PIXELS)
            & (either >= LEAST_A_SIDE)
            & (moved < 0.01)
            & (np.hypot(*(theta[:, :2] - start).T) < FARTHEST_PX)
        )
        ok &= np.isfinite(covariance).all(axis=(1, 2)) & (np.einsum("nii->n", covariance) < 1)
        ok &= np.abs(theta[:, CONTRAST]) > LEAST_CONTRAST * noise
    white = sheet.black_level_dn + np.maximum(theta[:, BLACK], theta[:, BLACK] + theta[:, CONTRAST])
    return FittedCorners(theta[:, :2] + middle, covariance, theta[:, CONTRAST], white, theta[:, BLUR], chi2, misfit, ok)


def _start(
    light: np.ndarray, use: np.ndarray, xy: np.ndarray, axes: np.ndarray, crossing: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 9) first parameters and the centres (n, 2) they begin from; the levels are linear and so fitted at once."""
    n = len(xy)
    theta = np.zeros((n, 9))
    theta[:, :2] = np.nan_to_num(xy)
    # Each line's normal, a quarter turn on from its direction, shall point into the quadrant between u and v.
    turn = np.sign(axes[:, 0, 0] * axes[:, 1, 1] - axes[:, 1, 0] * axes[:, 0, 1])
    u, v = axes[:, :, 0] * turn[:, None], -axes[:, :, 1] * turn[:, None]
    theta[:, ALONG_X], theta[:, ALONG_Y] = np.arctan2(u[:, 1], u[:, 0]), np.arctan2(v[:, 1], v[:, 0])
    theta[:, BLUR], theta[:, CONTRAST] = FIRST_BLUR_PX, 1.0
    part = _model(theta, crossing)[0]
    count = np.maximum(use.sum(axis=1), 1)
    mean, level = ((use * v).sum(axis=1) / count for v in (part, light))
    spread = (use * (part - mean[:, None]) ** 2).sum(axis=1)
    contrast = (use * (part - mean[:, None]) * light).sum(axis=1) / np.maximum(spread, 1e-9)
    theta[:, CONTRAST], theta[:, BLACK] = contrast, level - contrast * mean
    return theta, theta[:, :2].copy()


def _model(theta: np.ndarray, crossing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixel values (n, k) above the sensor's black, and their derivatives (n, k, 9)."""
    offset = offsets_px()
    x, y = offset[:, 0] - theta[:, :1], offset[:, 1] - theta[:, 1:2]
    a, b, s = (theta[:, k : k + 1] for k in (ALONG_X, ALONG_Y, BLUR))
    ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
    h, k = (ca * y - sa * x) / s, (cb * y - sb * x) / s
    rho = np.cos(a - b).clip(-0.999, 0.999)
    both, by_h, by_k, by_rho = _both(h, k, rho)
    one = crossing[:, None]
    below_h, below_k, dense_h, dense_k = ndtr(h), ndtr(k), _density(h), _density(k)
    part = np.where(one, 1 - below_h - below_k + 2 * both, 1 - both)
    part_h = np.where(one, 2 * by_h - dense_h, -by_h)
    part_k = np.where(one, 2 * by_k - dense_k, -by_k)
    part_rho = np.where(one, 2 * by_rho, -by_rho)
    black, contrast = theta[:, BLACK : BLACK + 1], theta[:, CONTRAST : CONTRAST + 1]
    light = 1 + theta[:, LIGHT_X : LIGHT_X + 1] * x + theta[:, LIGHT_Y : LIGHT_Y + 1] * y
    level = black + contrast * part
    turn = np.sin(a - b)
    by_part = light * contrast
    slope = np.stack(
        [
            by_part * (part_h * sa + part_k * sb) / s - level * theta[:, LIGHT_X : LIGHT_X + 1],
            by_part * -(part_h * ca + part_k * cb) / s - level * theta[:, LIGHT_Y : LIGHT_Y + 1],
            by_part * (part_h * -(sa * y + ca * x) / s - part_rho * turn),
            by_part * (part_k * -(sb * y + cb * x) / s + part_rho * turn),
            by_part * -(part_h * h + part_k * k) / s,
            light,
            light * part,
            level * x,
            level * y,
        ],
        axis=-1,
    )
    return light * level, slope


def _both(h: np.ndarray, k: np.ndarray, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bivariate normal distribution at (h, k) of correlation rho, and its derivatives by the three.

    By the integral of its density over the correlation (Drezner and Wesolowsky 1990), with the arc sine as variable.
    """
    half = np.arcsin(rho) / 2
    total = np.zeros_like(h)
    square, product = h * h + k * k, 2 * h * k
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        sine = np.sin(half * (1 + node))
        total += weight * np.exp(-(square - product * sine) / (2 * (1 - sine * sine)))
    both = ndtr(h) * ndtr(k) + total * half / (2 * np.pi)
    rest = np.sqrt(1 - rho * rho)
    dense = np.exp(-(square - product * rho) / (2 * rest * rest)) / (2 * np.pi * rest)
    return both, _density(h) * ndtr((k - rho * h) / rest), _density(k) * ndtr((h - rho * k) / rest), dense


def _density(z: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi))


def _solve(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions of normal equations at unit diagonal; NaN where one is singular."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-30))
    unit = np.nan_to_num(normal * scale[:, :, None] * scale[:, None, :])
    singular = ~(np.linalg.cond(unit) < 1e12)
    unit[singular] = np.eye(unit.shape[1])
    solution = scale[:, :, None] * np.linalg.solve(unit, scale[:, :, None] * np.nan_to_num(right))
    solution[singular] = np.nan
    return solution
