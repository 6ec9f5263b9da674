"""The ellipse model: a blurred, unevenly lit ellipse fitted to the raw pixels with the sensor's noise.

Ten parameters a dot: centre, shape (the matrix of the edge's quadratic form), contrast and its gradient, background,
width of the edge. By symmetry the centre is uncorrelated with all but the gradient, so modelling the rest costs it
nothing (METHODS section 6.1), and its covariance is the inverse normal matrix.
"""

import numpy as np
from scipy.special import ndtr

from testfield.camera.images import InvertedSheet, SensorSheet
from testfield.detect.centre import Centres, half_widths, usable, windows
from testfield.registry import register

ITERATIONS = 14
RESHAPE = (3, 6)
"""Iterations at which the usable pixels are chosen again."""
SETTLED_PX, SLOW_PX, SETTLED = 1e-4, 1e-3, 0.1
"""The iteration has ended where its step is below the first; or below the second, if that is no more than this part of
the stated uncertainty."""
CX, CY, GXX, GXY, GYY, CONTRAST, BACKGROUND, SLOPE_X, SLOPE_Y, BLUR = range(10)


@register("centroids", "ellipse_model")
def ellipse_model(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """A blurred, unevenly lit ellipse fitted to the raw pixels with the sensor's noise.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for rows, values, x, y, inside in windows(image_dn, xy_px, half_widths(moments_px2)):
        found.put(rows, _fit(values, x, y, inside, sheet, xy_px[rows], moments_px2[rows]))
    return found


def _fit(
    values: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    inside: np.ndarray,
    sheet: SensorSheet,
    xy: np.ndarray,
    moments: np.ndarray,
) -> Centres:
    n = len(values)
    shape = np.linalg.inv(4 * moments)
    origin = np.rint(xy)
    x, y = x - origin[:, :1], y - origin[:, 1:]
    dx, dy = x - (xy - origin)[:, :1], y - (xy - origin)[:, 1:]
    q = np.sqrt(_form(shape, dx, dy))
    use = inside & usable(q, dx, dy)
    core, outer = use & (q < 0.6), use & (q > 1.2)
    theta = np.zeros((n, 10))
    theta[:, [CX, CY]] = xy - origin
    theta[:, GXX], theta[:, GXY], theta[:, GYY] = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
    theta[:, BACKGROUND] = _mean(values, outer)
    theta[:, CONTRAST] = _mean(values, core) - theta[:, BACKGROUND]
    theta[:, BLUR] = 0.7
    # The same light falls on a dot and on the ground around it: their slopes are in proportion to their levels.
    ground = above_black(theta[:, BACKGROUND], sheet) / np.maximum(np.abs(theta[:, CONTRAST]), 1e-9)
    ground = np.nan_to_num(np.clip(ground, -20, 20))
    weight = use / sheet.variance_dn2(values)

    limit, step = np.ones(n), np.zeros((n, 10))
    good = np.isfinite(theta).all(axis=1) & (theta[:, CONTRAST] > 0)
    theta[~good] = np.array([0, 0, 0.1, 0, 0.1, 100, sheet.black_level_dn, 0, 0, 0.7])
    for k in range(ITERATIONS):
        if k in RESHAPE:
            # The rough blob may be too large by its blur; what the fit may use follows from the fit itself.
            dx, dy = x - theta[:, [CX]], y - theta[:, [CY]]
            use = inside & usable(np.sqrt(np.maximum(_form(_shape(theta), dx, dy), 0)), dx, dy)
        model, jacobian = _model(theta, ground, x, y)
        if k:  # the model's own value is a better guess of a pixel's mean than the noisy pixel
            weight = use / sheet.variance_dn2(model)
        normal, gradient = _normal(jacobian, weight, values - model)
        step = _solve(normal, gradient, good)
        limit = np.minimum(1, 0.5 / np.maximum(np.abs(step[:, [CX, CY, BLUR]]).max(axis=1), 1e-12))
        theta = theta + limit[:, None] * step
        theta[:, BLUR] = np.clip(theta[:, BLUR], 0.2, 6)
        positive = (theta[:, GXX] > 0) & (theta[:, GXX] * theta[:, GYY] > theta[:, GXY] ** 2)
        good &= positive & np.isfinite(theta).all(axis=1) & (np.abs(theta[:, :2]).max(axis=1) < x.max())
        theta[~good] = np.array([0, 0, 0.1, 0, 0.1, 100, sheet.black_level_dn, 0, 0, 0.7])
        settled = (np.abs(step[:, [CX, CY]]).max(axis=1) < SETTLED_PX) & (limit == 1)
        if k > RESHAPE[-1] and np.all(settled | ~good):
            break

    model, jacobian = _model(theta, ground, x, y)
    residual = values - model
    normal, _ = _normal(jacobian, weight, residual)
    covariance = np.full((n, 2, 2), np.nan)
    covariance[good] = np.linalg.pinv(_scaled(normal[good])[0], hermitian=True)[:, :2, :2]
    scale = _scaled(normal)[1]
    covariance *= scale[:, :2, None] * scale[:, None, :2]
    freedom = np.maximum(use.sum(axis=1) - 10, 1)
    chi2 = (weight * residual**2).sum(axis=1) / freedom
    # What the model leaves unexplained, beyond chance, is doubt about the centre too.
    covariance *= np.where(chi2 > 1 + 3 * np.sqrt(2 / freedom), chi2, 1.0)[:, None, None]
    excess = (use * (residual**2 - sheet.variance_dn2(model))).sum(axis=1) / np.maximum(use.sum(axis=1), 1)
    misfit = np.sqrt(np.maximum(excess, 0)) / theta[:, CONTRAST]
    # Of a drawing without blur the steps grow small slowly: they have ended when they are small beside the doubt.
    with np.errstate(invalid="ignore"):
        doubt = np.sqrt(np.einsum("nii->n", covariance) / 2)
        last = np.abs(step[:, [CX, CY]]).max(axis=1)
        converged = good & (last < np.clip(SETTLED * doubt, SETTLED_PX, SLOW_PX)) & (limit == 1)
    return Centres(
        theta[:, :2] + origin,
        covariance,
        np.linalg.inv(_shape(theta)) / 4,
        theta[:, CONTRAST],
        theta[:, BACKGROUND],
        chi2,
        misfit,
        converged,
    )


def _shape(theta: np.ndarray) -> np.ndarray:
    """(n, 2, 2) matrices of the edges' quadratic forms."""
    return theta[:, [GXX, GXY, GXY, GYY]].reshape(-1, 2, 2)


def _form(shape: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    return shape[:, 0, :1] * dx * dx + 2 * shape[:, 0, 1:] * dx * dy + shape[:, 1, 1:] * dy * dy


def _mean(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return (values * mask).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)


def above_black(level_dn: np.ndarray, sheet: SensorSheet) -> np.ndarray:
    """Levels as parts of the light: above black, and of an inverted image below it."""
    if isinstance(sheet, InvertedSheet):
        return level_dn - (sheet.largest_dn - sheet.black_level_dn)
    return level_dn - sheet.black_level_dn


def _model(theta: np.ndarray, ground: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixel values (n, k) and their derivatives (n, 10, k); `ground` (n,) the ground's level in contrasts.

    The distance to the edge is taken to first order, (1 - q) / |grad q|; its change with the parameters where it
    matters, at the edge, is -dq / |grad q|.
    """
    cx, cy, gxx, gxy, gyy, contrast, background, slope_x, slope_y, blur = (theta[:, k, None] for k in range(10))
    dx, dy = x - cx, y - cy
    gx, gy = gxx * dx + gxy * dy, gxy * dx + gyy * dy
    q = np.sqrt(np.maximum(dx * gx + dy * gy, 1e-12))
    length = np.maximum(np.sqrt(gx * gx + gy * gy) / q, 1e-9)
    z = (1 - q) / (length * blur)
    inside = ndtr(z)
    density = np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
    lit = contrast + slope_x * dx + slope_y * dy
    sloping = inside + ground[:, None]
    by_q = -lit * density / (length * blur)  # derivative of the value by q
    jacobian = np.stack(
        [
            -by_q * gx / q - slope_x * sloping,
            -by_q * gy / q - slope_y * sloping,
            by_q * dx * dx / (2 * q),
            by_q * dx * dy / q,
            by_q * dy * dy / (2 * q),
            inside,
            np.ones_like(inside),
            dx * sloping,
            dy * sloping,
            -lit * density * z / blur,
        ],
        axis=1,
    )
    value = background + contrast * inside + (slope_x * dx + slope_y * dy) * sloping
    return value, jacobian


def _normal(jacobian: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    weighted = jacobian * weight[:, None, :]
    return weighted @ np.swapaxes(jacobian, 1, 2), (weighted @ residual[..., None])[..., 0]


def _scaled(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrices with unit diagonal, and the scale that was taken out."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
    return normal * scale[:, :, None] * scale[:, None, :], scale


def _solve(normal: np.ndarray, gradient: np.ndarray, good: np.ndarray) -> np.ndarray:
    scaled, scale = _scaled(normal)
    step = np.zeros_like(gradient)
    damped = scaled[good] + 1e-9 * np.eye(10)
    step[good] = np.linalg.solve(damped, (gradient * scale)[good][..., None])[..., 0] * scale[good]
    return step
