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
from testfield.detect.centre import Centres
from testfield.detect.disc import LEAST_BLUR_PX, MOST_BLUR_PX, ellipse_outline, outline_points
from testfield.detect.dot_equations import Equations, dot_equations
from testfield.detect.forward_windows import (
    AXX,
    AXY,
    AYY,
    BACKGROUND,
    BLUR,
    CONTRAST,
    CONTRAST_X,
    GRADIENTS,
    Batch,
    half_axes,
    reach,
    root,
    window_batches,
)
from testfield.detect.light import local_gradients
from testfield.detect.normal_equations import inverse
from testfield.detect.used_pixels import of_dots
from testfield.registry import register

ROUNDS = 12
FIRST_BLUR_PX = 0.6
EVEN_NOISE = 1.0, 0.0, 0.0
"""The noise line of pixels that are all alike."""
_HARMLESS = np.array([0, 0, 2.0, 0, 2.0, 1.0, -1.0, 0, 0, 0, 0, 0])
"""Parameters that keep a lost dot from disturbing the others of its batch; its contrast says that it is lost."""
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
    theta, variance, good = start(xy_px, moments_px2), np.zeros((n, 8)), np.zeros(n, bool)
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(min(os.cpu_count() or 1, 4)) as pool:
        # First without gradients, which gives every dot's contrast; then with what the contrasts say of the light.
        batches = list(window_batches(image_dn, theta))
        for batch, fit in zip(batches, pool.map(lambda b: refine(b, sheet, interior, None), batches), strict=True):
            theta[batch.rows], good[batch.rows] = batch.theta, fit.converged
            theta[batch.rows, :2] += batch.middle
            variance[batch.rows] = np.einsum("nii->ni", inverse(fit.normal))
        light = _light(theta, variance, good)
        batches = list(window_batches(image_dn, theta))
        for batch, fit in zip(batches, pool.map(lambda b: refine(b, sheet, interior, light), batches), strict=True):
            found.put(batch.rows, _centres(batch, fit, sheet, interior))
    return found


def start(xy: np.ndarray, moments: np.ndarray) -> np.ndarray:
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

    def of(self, rows: np.ndarray) -> "_Placement":
        """That of some of the dots."""
        return _Placement(self.interior, self.middle[rows], self.at[rows], self.drawn[rows], self.to_plane[rows])

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


def refine(
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
    use, left = np.zeros_like(batch.inside), good.copy()
    found = Equations(np.zeros_like(values), np.zeros((n, 12, 12)), np.zeros((n, 12)))
    normal, gradient = found.normal[:, :free, :free], found.right[:, :free]
    for k in range(ROUNDS):
        rows = np.flatnonzero(left)
        if not len(rows):
            break
        part = batch.some(rows)
        if k < 4:
            use[rows] = _usable(part, sheet)
        outline = dot_outline(part.theta, place and place.of(rows))
        found.renew(rows, dot_equations(part.values, use[rows], part.theta, outline, sheet.noise_line()))
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
        theta[:, :free] += np.where(left[:, None], step * limit[:, None], 0)
        theta[:, BLUR] = theta[:, BLUR].clip(LEAST_BLUR_PX, MOST_BLUR_PX)
        good &= sound(batch, theta)
        theta[~good] = safe[~good]
        sigma = np.sqrt(np.maximum(np.einsum("nii->ni", covariance[:, :2, :2]), 0))
        near = (0.5 if light is None else 0.02) * sigma + 1e-6
        settled = (k > 0) & (limit == 1) & (np.abs(step[:, :2]) < near).all(axis=1)
        # What has settled stays: it takes no time, and how often a dot is stepped does not depend on the others.
        left &= good & ~settled
    return _Fit(normal, known, use, found.model, good & ~left)


def _set_levels(batch: Batch, place: _Placement | None) -> None:
    """Contrast and background (both linear) that fit best with the shape as it is."""
    theta = batch.theta
    theta[:, CONTRAST], theta[:, BACKGROUND] = 1, 0
    theta[~sound(batch, theta)] = _HARMLESS
    equations = dot_equations(batch.values, batch.inside, theta, dot_outline(theta, place), EVEN_NOISE)
    levels = slice(CONTRAST, BACKGROUND + 1)
    theta[:, levels] += np.einsum(
        "nij,nj->ni", inverse(equations.normal[:, levels, levels]), equations.right[:, levels]
    )


def sound(batch: Batch, theta: np.ndarray) -> np.ndarray:
    """(n,) whether parameters still describe a dot within its window."""
    finite = np.isfinite(theta).all(axis=1)
    axes = np.where(finite[:, None, None], half_axes(theta), np.eye(2))
    low, high = np.linalg.eigvalsh(axes).T
    within = np.abs(theta[:, :2]).max(axis=1) < 0.6 * batch.half
    return finite & (low > 0.1) & (high < 1.2 * batch.half) & within & (theta[:, CONTRAST] > 0)


def _usable(batch: Batch, sheet: SensorSheet) -> np.ndarray:
    """(n, m, m) which pixels a fit may use."""
    theta, noise = batch.theta, np.array(sheet.noise_line())
    to_circle, felt_px = np.linalg.inv(half_axes(theta)), reach(theta)[1]
    return of_dots(batch.values, batch.inside, theta, to_circle, felt_px, theta[:, CONTRAST].copy(), noise)


def _placement(batch: Batch, interior: Interior | None) -> _Placement | None:
    if interior is None:
        return None
    drawn = batch.theta[:, :2].copy()
    at = plane_of(interior, drawn + batch.middle)
    slope = interior.parameters[:2, None] * lens.jacobian_xy(interior.lens, at, interior.coefficients)
    return _Placement(interior, batch.middle, at, drawn, np.linalg.inv(slope))


def dot_outline(theta: np.ndarray, place: _Placement | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    outline, tangent, _ = dot_outline(batch.theta, _placement(batch, interior))
    origin = outline.mean(axis=1)
    x, y = np.moveaxis(outline - origin[:, None, :], -1, 0)
    dx, dy = np.moveaxis(tangent, -1, 0)
    area = (x * dy - y * dx).sum(axis=1) / 2
    return origin + np.column_stack([(x * x * dy).sum(axis=1), -(y * y * dx).sum(axis=1)]) / (2 * area[:, None])
