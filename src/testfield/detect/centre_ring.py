"""The centre of a coded dot, fitted together with its ring.

A ring's blurred edge reaches into the gap around its dot, and a card of its own has light of its own. Both are in the
model once the code has been read: the ring's segments, in the dot's light, blurred like the dot. Over the whole ring a
gradient of the light shows twenty times as clearly as on the dot, so no neighbour is asked.

The ring lies where its own homography leads it: eight parameters that begin at the dot's affine map and stay near it.
So neither perspective nor a badly printed ring pulls the dot's centre.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from testfield.camera.images import InvertedSheet, SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.centre_forward import FIRST_BLUR_PX, WORST_PX, dot_outline, sound
from testfield.detect.disc import LEAST_BLUR_PX, MOST_BLUR_PX
from testfield.detect.dot_equations import DOT, Equations
from testfield.detect.forward_windows import (
    AXX,
    AXY,
    AYY,
    BACKGROUND,
    BLUR,
    CLEAR_OF_BLUR,
    CONTRAST,
    Batch,
    half_axes,
    root,
    window_batches,
)
from testfield.detect.normal_equations import inverse
from testfield.detect.ring_equations import BENT, PARAMETERS, TWISTED, ring_equations
from testfield.detect.ring_pixels import bright_segments, ring_nodes, ring_outline
from testfield.detect.used_pixels import of_rings
from testfield.targets.marks import RingRadii

TURNS = [(i, j) for i in range(3) for j in range(3) if (i, j) != (2, 2)]
"""Entries of the homography's departure from the dot's affine map, in dot radii."""
NEAR_AFFINE = 1 / np.square([0.03, 0.03, 0.05, 0.03, 0.03, 0.05, 0.02, 0.02])
"""Inverse variances of these entries: how the code was read leaves a turn of a few hundredths open, and perspective
moves the ring of a target by a few hundredths of its radius."""
MOST_BENT = 0.1
"""Standard deviation of the light's curvature, in units of the contrast."""
MOST_TWISTED = 0.03
"""Standard deviation of the irradiance's cubic terms: shade that a card nearby throws falls off within its breadth."""
NEAR_EDGE = 3.5
"""Standard deviations of pixel and blur by which pixels keep clear of what may be printed beyond the quiet zone."""
LONGEST_TURN, STILL = 0.1, 1e-3
"""Largest step of an entry, and the step below which a ring lies still."""
ROUNDS = 10
HOLLOW = 0.5
"""Radii from a dot's centre within which a photograph's dot may have a hole, with the blur of its edge."""
PATCH = 3
"""Side in px of the patches by whose means image and model are compared: a wrong edge is one or two pixels wide."""


@dataclass(frozen=True)
class Rings:
    """n targets as read: `affine` (n, 2, 2) from their planes (x right, y up, in dot radii) to px, `words` (n,) as
    the first segment begins at +x; `bits`, `radii` of the code."""

    affine: np.ndarray
    words: np.ndarray
    bits: int
    radii: RingRadii


@dataclass(frozen=True)
class Fitted:
    """n dots measured with their rings. `chi2` and `misfit` of the `centres` are those of dot, gap and ring together.

    Where image and model differ most: `patch` (n,) the mean of a patch of pixels as a fraction of the contrast, and
    `patch_sigmas` (n,) in standard deviations of its noise."""

    centres: Centres
    patch: np.ndarray
    patch_sigmas: np.ndarray


def fit_with_rings(
    image_dn: np.ndarray, sheet: SensorSheet, rough: Centres, rings: Rings, hollow: bool = False
) -> Fitted:
    """Dots of rings that were read, n rows, measured again from `rough` in an image (h, w) of bright marks. `hollow`
    where nothing is to be said of what a dot has in its middle: many a maker's has a hole or a cross there."""
    n = len(rings.words)
    found = Fitted(Centres.empty(n), np.full(n, np.inf), np.full(n, np.inf))
    if n == 0:
        return found
    theta = np.zeros((n, DOT))
    axes = root(4 * rough.moments_px2)
    theta[:, :2] = rough.xy_px
    theta[:, AXX], theta[:, AXY], theta[:, AYY] = axes[:, 0, 0], axes[:, 0, 1], axes[:, 1, 1]
    theta[:, BLUR], theta[:, CONTRAST], theta[:, BACKGROUND] = FIRST_BLUR_PX, rough.contrast_dn, rough.background_dn
    batches = list(window_batches(image_dn, theta, rings.radii.outer))
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(min(os.cpu_count() or 1, 4)) as pool:
        for batch, part in zip(batches, pool.map(lambda b: _fit(b, sheet, rings, hollow), batches), strict=True):
            found.centres.put(batch.rows, part.centres)
            found.patch[batch.rows], found.patch_sigmas[batch.rows] = part.patch, part.patch_sigmas
    return found


@dataclass
class _Ring:
    """A batch's rings: `bright` (n, bits); `start` (n, 3, 3) the dots' affine maps from disc coordinates (clockwise) to
    px about the windows' middles; `contrast` (n,) in units of the dots'; `turn` (n, 8) departures; `bent` (n, 6) the
    light's curvature in DN and `twisted` (n, 4) the irradiance's cubic terms, at `reach_px` (n,) from the centre;
    `dark_dn` is what a pixel without light has."""

    bright: np.ndarray
    start: np.ndarray
    contrast: np.ndarray
    turn: np.ndarray
    bent: np.ndarray
    twisted: np.ndarray
    reach_px: np.ndarray
    dark_dn: float

    def some(self, rows: np.ndarray) -> "_Ring":
        """Those of some of the batch's dots."""
        own = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "dark_dn"}
        return replace(self, **own)

    @property
    def known(self) -> np.ndarray:
        """(n, 18) the parameters that have a prior."""
        return np.concatenate([self.turn, self.bent, self.twisted], axis=1)

    def homography(self) -> np.ndarray:
        departure = np.repeat(np.eye(3)[None], len(self.start), axis=0)
        for k, (i, j) in enumerate(TURNS):
            departure[:, i, j] += self.turn[:, k]
        return self.start @ departure


def _begin(batch: Batch, sheet: SensorSheet, rings: Rings) -> _Ring:
    n = len(batch.rows)
    start = np.repeat(np.eye(3)[None], n, axis=0)
    start[:, :2, :2] = rings.affine[batch.rows] * [1, -1]
    start[:, :2, 2] = batch.theta[:, :2]
    bright = bright_segments(rings.words[batch.rows], rings.bits)
    reach_px = rings.radii.outer * np.abs(np.linalg.eigvalsh(half_axes(batch.theta))).max(axis=1)
    upside_down = isinstance(sheet, InvertedSheet)
    dark_dn = sheet.largest_dn - sheet.black_level_dn if upside_down else sheet.black_level_dn
    bare = np.zeros((n, len(TURNS))), np.zeros((n, 6)), np.zeros((n, 4))
    return _Ring(bright, start, np.ones(n), *bare, reach_px, float(dark_dn))


def _fit(batch: Batch, sheet: SensorSheet, rings: Rings, hollow: bool = False) -> Fitted:
    """Gauss and Newton's iteration with weights of the model's own variance."""
    theta, values, ring = batch.theta, batch.values, _begin(batch, sheet, rings)
    prior = np.zeros((len(theta), PARAMETERS))
    prior[:, DOT + 1 : BENT] = NEAR_AFFINE
    prior[:, BENT:TWISTED] = 1 / np.square(MOST_BENT * theta[:, [CONTRAST]])
    prior[:, TWISTED:] = 1 / MOST_TWISTED**2
    good = sound(batch, theta) & np.isfinite(ring.start).all(axis=(1, 2))
    safe = theta.copy()
    begun, use, left = good.copy(), np.zeros_like(batch.inside), good.copy()
    model, covariance = np.zeros_like(values), np.zeros((len(theta), PARAMETERS, PARAMETERS))
    for k in range(ROUNDS):
        rows = np.flatnonzero(left)
        if not len(rows):
            break
        part, own = batch.some(rows), ring.some(rows)
        if k < 4:
            use[rows] = _usable(part, rings.radii, HOLLOW if hollow else 0.0)
        equations = _equations(part, use[rows], own, rings, sheet)
        normal, right = equations.normal, equations.right
        normal[:, np.arange(PARAMETERS), np.arange(PARAMETERS)] += prior[rows]
        right[:, DOT + 1 :] -= prior[rows, DOT + 1 :] * own.known
        model[rows], covariance[rows] = equations.model, inverse(normal)
        step = np.einsum("nij,nj->ni", covariance[rows], right)
        longest = np.abs(step[:, : BLUR + 1]).max(axis=1) / (0.5 * np.maximum(part.theta[:, BLUR], 0.5))
        longest = np.maximum(longest, np.abs(step[:, DOT + 1 : BENT]).max(axis=1) / LONGEST_TURN)
        step *= np.minimum(1, 1 / np.maximum(longest, 1e-12))[:, None]
        theta[rows] += step[:, :DOT]
        theta[:, BLUR] = theta[:, BLUR].clip(LEAST_BLUR_PX, MOST_BLUR_PX)
        ring.contrast[rows] += step[:, DOT]
        ring.turn[rows] += step[:, DOT + 1 : BENT]
        ring.bent[rows] += step[:, BENT:TWISTED]
        ring.twisted[rows] += step[:, TWISTED:]
        good &= sound(batch, theta) & np.isfinite(ring.turn).all(axis=1)
        theta[~good] = safe[~good]
        sigma = np.sqrt(np.maximum(np.einsum("nii->ni", covariance[rows, :2, :2]), 0))
        still = np.abs(step[:, DOT + 1 : BENT]).max(axis=1) < STILL
        settled = (k > 0) & still & (longest < 1) & (np.abs(step[:, :2]) < 0.02 * sigma + 1e-6).all(axis=1)
        left[rows] = ~settled
        left &= good
    residual, variance = np.where(use, values - model, 0), np.where(use, sheet.variance_dn2(model), 0)
    centres = _centres(batch, use, residual, variance, covariance[:, :2, :2], good & ~left)
    patch = _worst_patch(residual, variance, theta[:, CONTRAST])
    # What was never compared with its model does not agree with it.
    return Fitted(centres, *(np.where(begun, values, np.inf) for values in patch))


def _worst_patch(residual: np.ndarray, variance: np.ndarray, contrast: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) and (n,) as in `Fitted`, from windows (n, m, m) that are zero where no pixel is used."""
    mean, spread = (
        np.array([cv2.blur(window, (PATCH, PATCH), borderType=cv2.BORDER_CONSTANT) for window in part])
        for part in (residual, variance)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        sigmas = np.where(spread > 0, np.abs(mean) / np.sqrt(spread / PATCH**2), 0).max(axis=(1, 2))
        size = np.abs(mean).max(axis=(1, 2)) / contrast
    return np.nan_to_num(size, nan=np.inf), np.nan_to_num(sigmas, nan=np.inf)


def _equations(batch: Batch, use: np.ndarray, ring: _Ring, rings: Rings, sheet: SensorSheet) -> Equations:
    theta, homography = batch.theta, ring.homography()
    radius_px = float(np.abs(np.linalg.eigvalsh(half_axes(theta))).max())
    nodes = ring_nodes(rings.bits, rings.radii, radius_px, float(theta[:, BLUR].min()))
    return ring_equations(
        batch.values,
        use,
        np.concatenate([theta, ring.contrast[:, None], ring.known], axis=1),
        dot_outline(theta),
        ring_outline(nodes, ring.bright, homography),
        ring.start,
        homography,
        ring.reach_px,
        ring.dark_dn,
        sheet.noise_line(),
    )


def _usable(batch: Batch, radii: RingRadii, hollow: float) -> np.ndarray:
    """(n, m, m) pixels as far as the ring is felt, clear of what may lie beyond its quiet zone, and none of the dot's
    middle up to `hollow` radii and the blur of what may be there."""
    theta, blur = batch.theta, np.hypot(batch.theta[:, BLUR], 0.29)
    to_circle = np.linalg.inv(half_axes(theta))
    felt_px, clear_px = CLEAR_OF_BLUR * blur, NEAR_EDGE * blur
    use = of_rings(batch.inside, theta, to_circle, felt_px, clear_px, radii.outer, radii.quiet)
    if hollow:
        side = use.shape[1]
        grid = np.arange(side) - side // 2
        at = np.stack(np.meshgrid(grid, grid), axis=-1) - theta[:, None, None, :2]
        use &= np.square(np.einsum("nij,nrcj->nrci", to_circle, at)).sum(axis=-1) > hollow**2
    return use


def _centres(
    batch: Batch,
    use: np.ndarray,
    residual: np.ndarray,
    variance: np.ndarray,
    covariance: np.ndarray,
    converged: np.ndarray,
) -> Centres:
    theta = batch.theta
    count = use.sum(axis=(1, 2))
    freedom = np.maximum(count - PARAMETERS, 1)
    chi2 = (residual**2 / np.where(use, variance, 1)).sum(axis=(1, 2)) / freedom
    covariance = covariance * np.where(chi2 > 1 + 3 * np.sqrt(2 / freedom), chi2, 1.0)[:, None, None]
    excess = (residual**2 - variance).sum(axis=(1, 2)) / np.maximum(count, 1)
    misfit = np.sqrt(np.maximum(excess, 0)) / theta[:, CONTRAST]
    axes = half_axes(theta)
    with np.errstate(invalid="ignore"):
        ok = converged & (count > 2 * PARAMETERS) & (np.einsum("nii->n", covariance) < WORST_PX**2)
    return Centres(
        theta[:, :2] + batch.middle,
        covariance,
        axes @ axes / 4,
        theta[:, CONTRAST],
        theta[:, BACKGROUND],
        chi2,
        misfit,
        ok,
    )
