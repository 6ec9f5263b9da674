"""The forward model: a circle seen through the lens, blurred and gathered by pixels, fitted to the raw image.

Twelve parameters a dot: centre, shape (three), blur, contrast and background, each with its gradient. Pixel values are
exact (`disc.py`), so there is no size and no tilt for which the model is not true. With a camera the outline lives on
the plane before the lens, where the image of a circle is an ellipse, and is led through the lens; without one it is an
ellipse in the image. All but the gradients are uncorrelated with the centre by symmetry, and the gradients are known
from the neighbours (`light.py`), so the centre's covariance is that of a dot of which everything else is known.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from testfield.camera import lens
from testfield.camera.images import SensorSheet
from testfield.camera.interior import Interior
from testfield.camera.project import plane_of, project_camera
from testfield.detect.centre import RING_BEGINS, RING_CLEARANCE_PX, Centres
from testfield.detect.disc import LEAST_BLUR_PX, MOST_BLUR_PX, disc_in_pixels, ellipse_outline, outline_points
from testfield.detect.forward_windows import (
    AXX,
    AXY,
    AYY,
    BACKGROUND,
    BACKGROUND_X,
    BACKGROUND_Y,
    BLUR,
    CLEAR_OF_BLUR,
    CONTRAST,
    CONTRAST_X,
    CONTRAST_Y,
    CX,
    CY,
    GRADIENTS,
    Batch,
    half_axes,
    reach,
    root,
    window_batches,
)
from testfield.detect.light import local_gradients
from testfield.registry import register

ROUNDS = 12
FIRST_BLUR_PX = 0.6
_HARMLESS = np.array([0, 0, 2.0, 0, 2.0, 1.0, -1.0, 0, 0, 0, 0, 0])
"""Parameters that keep a lost dot from disturbing the others of its batch; its contrast says that it is lost."""
UNQUIET = 0.02
"""Scatter beside a dot, in units of its contrast, above which something may lie there."""
WORST_PX = 0.5
"""Standard uncertainty at which a dot counts as not measured."""
CONTRADICTION = 18.5
"""Chi-squared of four degrees of freedom, at 0.1 %, above which a dot's own gradients refuse its neighbours'."""


@register("centroids", "forward_model")
def forward_model(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    interior: Interior | None = None,
) -> Centres:
    """The circle through the lens, blurred and gathered by pixels, fitted to the raw image: at the physical limit.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks. With `interior`
    the outline is a circle's seen through that lens, else an ellipse. Centres are those of the image's area."""
    n = len(xy_px)
    found = Centres.empty(n)
    if n == 0:
        return found
    theta, variance, good = _start(xy_px, moments_px2), np.zeros((n, 8)), np.zeros(n, bool)
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(min(os.cpu_count() or 1, 4)) as pool:
        # First without gradients, which gives every dot's contrast; then with what the contrasts say of the light.
        batches = list(window_batches(image_dn, theta))
        for batch, fit in zip(batches, pool.map(lambda b: _refine(b, sheet, interior, None), batches), strict=True):
            theta[batch.rows], good[batch.rows] = batch.theta, fit.converged
            theta[batch.rows, :2] += batch.middle
            variance[batch.rows] = np.einsum("nii->ni", inverse(fit.normal))
        light = _light(theta, variance, good)
        batches = list(window_batches(image_dn, theta))
        for batch, fit in zip(batches, pool.map(lambda b: _refine(b, sheet, interior, light), batches), strict=True):
            found.put(batch.rows, _centres(batch, fit, sheet, interior))
    return found


def _start(xy: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(n, 12) parameters from blobs; centres in px. Levels are left to the first step, for they are linear."""
    theta = np.zeros((len(xy), 12))
    axes = root(4 * moments)
    theta[:, :2] = xy
    theta[:, AXX], theta[:, AXY], theta[:, AYY] = axes[:, 0, 0], axes[:, 0, 1], axes[:, 1, 1]
    theta[:, BLUR] = FIRST_BLUR_PX
    theta[:, CONTRAST] = np.nan
    return theta


@dataclass(frozen=True)
class _Placement:
    """How an outline drawn about the window's middle comes to lie in the image.

    Without a camera as drawn. With one it is drawn on the plane before the lens, in the pixels that the lens makes of
    that plane at the rough centre: `at` (n, 2) that centre there, `drawn` (n, 2) on the drawing, `to_plane` (n, 2, 2).
    """

    interior: Interior
    middle: np.ndarray
    at: np.ndarray
    drawn: np.ndarray
    to_plane: np.ndarray

    def outline(self, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (n, k, 2) relative to the window's middle, and (n, k, 2, 2) their derivatives by the drawing."""
        plane = self.at[:, None, :] + np.einsum("nij,nkj->nki", self.to_plane, drawn - self.drawn[:, None, :])
        pixels = project_camera(self.interior, np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1))
        slope = lens.jacobian_xy(self.interior.lens, plane, self.interior.coefficients)
        slope = self.interior.parameters[:2, None] * slope @ self.to_plane[:, None]
        return pixels - self.middle[:, None, :], slope


@dataclass(frozen=True)
class _Fit:
    """What a batch's fit gives beside its parameters: `normal` (n, 12, 12) of the pixels, `known` (n, 4, 4) of the
    neighbours, `use`, `model` (n, m, m), `converged` (n,)."""

    normal: np.ndarray
    known: np.ndarray
    use: np.ndarray
    model: np.ndarray
    converged: np.ndarray


def _refine(
    batch: Batch, sheet: SensorSheet, interior: Interior | None, light: tuple[np.ndarray, np.ndarray] | None
) -> _Fit:
    """Gauss and Newton's iteration with weights of the model's own variance; changes `batch.theta`.

    Without `light` there are no gradients, and the fit stops where it is good enough to tell the contrast.
    """
    theta, values = batch.theta, batch.values
    n, free = len(theta), 8 if light is None else 12
    expected, known = np.zeros((n, 4)), np.zeros((n, 4, 4))
    if light is not None:
        expected, known = light[0][batch.rows], light[1][batch.rows].copy()
        theta[:, GRADIENTS] = expected
    place = _placement(batch, interior)
    if np.isnan(theta[:, CONTRAST]).any():
        _set_levels(batch, place)
    safe = theta.copy()
    good = sound(batch, theta)
    theta[~good] = safe[~good] = _HARMLESS
    for k in range(ROUNDS):
        model, jacobian = dot_model(batch, theta, place)
        if k < 4:
            use = batch.inside & _usable(batch, theta, sheet)
        # The model's own value is a better guess of a pixel's mean than the noisy pixel.
        weight = use / sheet.variance_dn2(model)
        normal, gradient = normal_matrix(jacobian[:, :free], weight, values - model)
        total, right = normal, gradient
        if light is not None:
            off = expected - theta[:, GRADIENTS]
            if k == 1:
                _drop_contradicted(normal, gradient - np.einsum("nij,nj->ni", normal[:, :, GRADIENTS], off), known)
            total, right = normal.copy(), gradient.copy()
            total[:, GRADIENTS, GRADIENTS] += known
            right[:, GRADIENTS] += np.einsum("nij,nj->ni", known, off)
        covariance = inverse(total)
        step = np.einsum("nij,nj->ni", covariance, right)
        longest = np.abs(step[:, : BLUR + 1]).max(axis=1)
        limit = np.minimum(1, 0.5 * np.maximum(theta[:, BLUR], 0.5) / np.maximum(longest, 1e-12))
        theta[:, :free] += np.where(good[:, None], step * limit[:, None], 0)
        theta[:, BLUR] = theta[:, BLUR].clip(LEAST_BLUR_PX, MOST_BLUR_PX)
        good &= sound(batch, theta)
        theta[~good] = safe[~good]
        sigma = np.sqrt(np.maximum(np.einsum("nii->ni", covariance[:, :2, :2]), 0))
        near = (0.5 if light is None else 0.02) * sigma + 1e-6
        converged = good & (limit == 1) & (np.abs(step[:, :2]) < near).all(axis=1)
        if k and np.all(converged | ~good):
            break
    return _Fit(normal, known, use, model, converged)


def _set_levels(batch: Batch, place: _Placement | None) -> None:
    """Contrast and background (both linear) that fit best with the shape as it is."""
    theta = batch.theta
    theta[:, CONTRAST], theta[:, BACKGROUND] = 1, 0
    theta[~sound(batch, theta)] = _HARMLESS
    _, jacobian = dot_model(batch, theta, place)
    normal, right = normal_matrix(jacobian[:, [CONTRAST, BACKGROUND]], batch.inside.astype(float), batch.values)
    theta[:, [CONTRAST, BACKGROUND]] = np.einsum("nij,nj->ni", inverse(normal), right)


def normal_matrix(jacobian: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrices (n, p, p) and their right sides (n, p)."""
    flat = jacobian.reshape(*jacobian.shape[:2], -1)
    weighted = flat * weight.reshape(len(flat), 1, -1)
    return weighted @ np.swapaxes(flat, 1, 2), (weighted @ residual.reshape(len(flat), -1, 1))[..., 0]


def inverse(normal: np.ndarray) -> np.ndarray:
    """Inverses of normal matrices, whatever their parameters' units; what the data do not tell stays as it is."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
    unit = np.nan_to_num(normal * scale[:, :, None] * scale[:, None, :])
    return np.linalg.pinv(unit, 1e-11, hermitian=True) * scale[:, :, None] * scale[:, None, :]


def sound(batch: Batch, theta: np.ndarray) -> np.ndarray:
    """(n,) whether parameters still describe a dot within its window."""
    finite = np.isfinite(theta).all(axis=1)
    axes = np.where(finite[:, None, None], half_axes(theta), np.eye(2))
    low, high = np.linalg.eigvalsh(axes).T
    within = np.abs(theta[:, :2]).max(axis=1) < 0.6 * batch.half
    return finite & (low > 0.1) & (high < 1.2 * batch.half) & within & (theta[:, CONTRAST] > 0)


def _usable(batch: Batch, theta: np.ndarray, sheet: SensorSheet) -> np.ndarray:
    """(n, m, m) which pixels a fit may use: as far as an edge is felt, but where a ring may begin only if none does."""
    offset = np.arange(-batch.half, batch.half + 1)
    dx = (offset - theta[:, [CX]])[:, None, :]
    dy = (offset - theta[:, [CY]])[:, :, None]
    to_circle = np.linalg.inv(half_axes(theta))
    u = to_circle[:, 0, 0, None, None] * dx + to_circle[:, 0, 1, None, None] * dy
    v = to_circle[:, 1, 0, None, None] * dx + to_circle[:, 1, 1, None, None] * dy
    q = np.sqrt(u * u + v * v)
    length = np.sqrt(dx * dx + dy * dy)
    px_per_q = length / np.maximum(q, 1e-9)
    felt = reach(theta)[1][:, None, None]
    wide = (q - 1) * px_per_q <= felt
    narrow = wide & (((RING_BEGINS - q) * px_per_q >= RING_CLEARANCE_PX) | (q <= 1.1))
    beyond = batch.inside & wide & ((q - 1) * px_per_q > 2.5 / CLEAR_OF_BLUR * felt)
    count = np.maximum(beyond.sum(axis=(1, 2)), 1)
    mean = (batch.values * beyond).sum(axis=(1, 2)) / count
    scatter = (beyond * (batch.values - mean[:, None, None]) ** 2).sum(axis=(1, 2)) / count
    noise = sheet.variance_dn2(mean) * (1 + 4 * np.sqrt(2 / count))
    quiet = scatter < noise + (UNQUIET * theta[:, CONTRAST]) ** 2
    return np.where(quiet[:, None, None], wide, narrow)


def _placement(batch: Batch, interior: Interior | None) -> _Placement | None:
    if interior is None:
        return None
    drawn = batch.theta[:, :2].copy()
    at = plane_of(interior, drawn + batch.middle)
    slope = interior.parameters[:2, None] * lens.jacobian_xy(interior.lens, at, interior.coefficients)
    return _Placement(interior, batch.middle, at, drawn, np.linalg.inv(slope))


def _outline(batch: Batch, theta: np.ndarray, place: _Placement | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outlines (n, k, 2) relative to the window's middle, their tangents, and derivatives (n, 5, k, 2) by shape."""
    largest = float(reach(theta)[0].max())
    count = outline_points(largest, float(theta[:, BLUR].min()))
    drawn, tangent, by_shape = ellipse_outline(half_axes(theta), count)
    drawn = drawn + theta[:, None, :2]
    if place is None:
        return drawn, tangent, np.broadcast_to(by_shape, (len(theta), *by_shape.shape))
    pixels, slope = place.outline(drawn)
    return (
        pixels,
        np.einsum("nkij,nkj->nki", slope, tangent),
        np.einsum("nkij,pkj->npki", slope, by_shape),
    )


def dot_model(batch: Batch, theta: np.ndarray, place: _Placement | None) -> tuple[np.ndarray, np.ndarray]:
    """Pixel values (n, m, m) and their derivatives (n, 12, m, m)."""
    outline, tangent, by_shape = _outline(batch, theta, place)
    offset = np.arange(-batch.half, batch.half + 1.0)
    grid = np.broadcast_to(offset, (len(theta), len(offset)))
    disc = disc_in_pixels(outline, tangent, by_shape, theta[:, BLUR], grid, grid)
    column = [theta[:, k, None, None] for k in range(12)]
    dx, dy = offset - column[CX], offset[:, None] - column[CY]
    # Blurred, x times the disc becomes x times the disc's image plus the blur's variance times its slope.
    spread = column[BLUR] ** 2 + 1 / 12
    lit_x, lit_y = (d * disc.value - spread * disc.by_shape[:, k] for k, d in ((CX, dx), (CY, dy)))
    lit = column[CONTRAST] + column[CONTRAST_X] * dx + column[CONTRAST_Y] * dy
    jacobian = np.empty((len(theta), 12, len(offset), len(offset)))
    jacobian[:, :BLUR] = lit[:, None] * disc.by_shape
    for k in (0, 1):
        jacobian[:, CX + k] -= column[CONTRAST_X + k] * disc.value + column[BACKGROUND_X + k]
    jacobian[:, BLUR] = lit * disc.by_blur
    jacobian[:, CONTRAST], jacobian[:, BACKGROUND] = disc.value, 1
    jacobian[:, CONTRAST_X], jacobian[:, CONTRAST_Y] = lit_x, lit_y
    jacobian[:, BACKGROUND_X], jacobian[:, BACKGROUND_Y] = dx, dy
    value = column[BACKGROUND] + column[BACKGROUND_X] * dx + column[BACKGROUND_Y] * dy
    value = value + column[CONTRAST] * disc.value + column[CONTRAST_X] * lit_x + column[CONTRAST_Y] * lit_y
    return value, jacobian


def _light(theta: np.ndarray, variance: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expected gradients (n, 4) of contrast and background in DN a px, and their inverse covariances (n, 4, 4)."""
    expected, known = np.zeros((len(theta), 4)), np.zeros((len(theta), 4, 4))
    for k, name in ((0, CONTRAST), (2, BACKGROUND)):
        part = slice(k, k + 2)
        expected[:, part], known[:, part, part] = local_gradients(
            theta[:, :2], theta[:, name], variance[:, name], good, half_axes(theta)
        )
    return expected, known


def _drop_contradicted(normal: np.ndarray, gradient: np.ndarray, known: np.ndarray) -> None:
    """Forget what neighbours say where a dot's own pixels contradict it: at a shadow's or a board's edge."""
    rest = slice(0, CONTRAST_X)
    eliminate = normal[:, GRADIENTS, rest] @ inverse(normal[:, rest, rest])
    information = normal[:, GRADIENTS, GRADIENTS] - eliminate @ normal[:, rest, GRADIENTS]
    score = gradient[:, GRADIENTS] - np.einsum("nij,nj->ni", eliminate, gradient[:, rest])
    # The score at the neighbours' gradients, in units of its covariance when both are right.
    own = np.einsum("ni,nij,nj->n", score, inverse(information), score)
    both = np.einsum("ni,nij,nj->n", score, inverse(information + known), score)
    known[own - both > CONTRADICTION] = 0


def _centres(batch: Batch, fit: _Fit, sheet: SensorSheet, interior: Interior | None) -> Centres:
    theta, use = batch.theta, fit.use
    normal = fit.normal.copy()
    normal[:, GRADIENTS, GRADIENTS] += fit.known
    covariance = inverse(normal)[:, :2, :2]
    residual = batch.values - fit.model
    variance = sheet.variance_dn2(fit.model)
    count = use.sum(axis=(1, 2))
    freedom = np.maximum(count - 8, 1)
    chi2 = (use * residual**2 / variance).sum(axis=(1, 2)) / freedom
    # What the model leaves unexplained, beyond chance, is doubt about the centre too.
    covariance = covariance * np.where(chi2 > 1 + 3 * np.sqrt(2 / freedom), chi2, 1.0)[:, None, None]
    excess = (use * (residual**2 - variance)).sum(axis=(1, 2)) / np.maximum(count, 1)
    misfit = np.sqrt(np.maximum(excess, 0)) / theta[:, CONTRAST]
    axes = half_axes(theta)
    with np.errstate(invalid="ignore"):
        ok = fit.converged & (count > 12) & (np.einsum("nii->n", covariance) < WORST_PX**2)
    return Centres(
        _centroid(batch, interior) + batch.middle,
        covariance,
        axes @ axes / 4,
        theta[:, CONTRAST],
        theta[:, BACKGROUND],
        chi2,
        misfit,
        ok,
    )


def _centroid(batch: Batch, interior: Interior | None) -> np.ndarray:
    """(n, 2) centres of area of the outlines, relative to the windows' middles."""
    if interior is None:
        return batch.theta[:, :2]
    outline, tangent, _ = _outline(batch, batch.theta, _placement(batch, interior))
    origin = outline.mean(axis=1)
    x, y = np.moveaxis(outline - origin[:, None, :], -1, 0)
    dx, dy = np.moveaxis(tangent, -1, 0)
    area = (x * dy - y * dx).sum(axis=1) / 2
    return origin + np.column_stack([(x * x * dy).sum(axis=1), -(y * y * dx).sum(axis=1)]) / (2 * area[:, None])
