"""The weighted least squares that all linear reconstructions share, vectorised over points (METHODS 1.2 to 1.6).

A method is a rule for weights. With D the lines of a ray (two directions square to it), C its origin and W the weights,
the point is (sum D^T W D)^-1 sum D^T W D C, iterated while weights and discs depend on it. Whatever the weights, its
covariance is the sandwich: gain on the pixels' noise, and on the calibration's error, which all points share.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.rays import meet_all
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights, rays_of, sights_of
from testfield.targets.field import Field

PASSES = 8
SETTLED_MM = 1e-10
REJECT_SIGMA = 6.0

Weights = Callable[[Sights, Rays, Calibration], np.ndarray]
"""Weights of the lines of n points: (n, k, 2, 2) where rays are independent, (n, 2k, 2k) where they are not."""


@dataclass(frozen=True)
class Method:
    """A reconstruction by name: its `weights`, and whether it compares in the image (`reprojected`) instead of along
    the lines of the measured pixels, which differs in second order."""

    name: str
    weights: Weights
    reprojected: bool = False


@dataclass(frozen=True)
class Trials:
    """How the points of thousands of trials are met again at once (`uncertainty/rays.py`), told at registration.

    By a `method`, with those rays that `screened_by` finds sound, absent the same method. With `moves_cameras` the
    residuals of all points move the cameras too, and with them the points.
    """

    method: Method
    screened_by: Method | None = None
    moves_cameras: bool = False


@dataclass(frozen=True)
class Solved:
    """Points of sights: `xyz_mm` (n, 3), the `rays` linearised there, and the `gain` (n, 3, 2k) on their pixels."""

    sights: Sights
    xyz_mm: np.ndarray
    rays: Rays
    gain: np.ndarray
    rejected: np.ndarray


@dataclass(frozen=True)
class Estimate:
    """n points `code` at `xyz_mm` (n, 3): `own` (n, 3, 3) is what their pixels' noise leaves of each, and
    `by_calibration` (3n, P) how they follow the calibration; `rays`, `residual_rms_px`, `rejected` (n,). `states_u`
    whether the calibration states a covariance: without one, none can be stated of the points."""

    code: np.ndarray
    xyz_mm: np.ndarray
    own: np.ndarray
    by_calibration: np.ndarray
    rays: np.ndarray
    residual_rms_px: np.ndarray
    rejected: np.ndarray
    states_u: bool = True

    def points(self, name: str, covariance: np.ndarray) -> Points:
        """The points as they are handed on, of a calibration with this covariance (P, P)."""
        n = len(self.code)
        if not self.states_u:
            nothing = np.full((3 * n, 3 * n), np.nan)
            return Points(name, self.code, self.xyz_mm, nothing, self.rays, self.residual_rms_px, self.rejected)
        joint = self.by_calibration @ covariance @ self.by_calibration.T
        blocks = joint.reshape(n, 3, n, 3)
        blocks[np.arange(n), :, np.arange(n)] += self.own
        return Points(
            method=name,
            code=self.code,
            xyz_mm=self.xyz_mm,
            cov_xyz_mm2=joint,
            rays=self.rays,
            residual_rms_px=self.residual_rms_px,
            rejected=self.rejected,
        )


def reconstruct(observations: Observations, calibration: Calibration, field: Field, method: Method) -> Points:
    """Loose targets of the field as points with their joint covariance; rays that contradict others are rejected."""
    sights = sights_of(observations, calibration, field)
    solved = settle(to_meet(sights, calibration), calibration, method)
    return estimate_of(solved, sights, calibration).points(method.name, calibration.covariance)


def to_meet(sights: Sights, calibration: Calibration) -> Sights:
    """Sights of those points that the calibration did not adjust itself."""
    return sights.take(~np.isin(sights.code, calibration.point_code))


def estimate_of(solved: Solved, sights: Sights, calibration: Calibration) -> Estimate:
    """Points that were met, and those among `sights` that the calibration adjusted itself, by code.

    The latter are taken over: to meet them again would count their pixels twice, once in the cameras.
    """
    own, by_calibration = sandwich(solved)
    met = solved.sights.code
    taken = sights.take(np.isin(sights.code, calibration.point_code))
    row = {int(code): k for k, code in enumerate(calibration.point_code)}
    at = calibration.point_mm[np.array([row[int(code)] for code in taken.code], int)]
    rays = rays_of(taken, calibration, at)
    code = np.concatenate([met, taken.code])
    order = np.argsort(code)
    unit = np.zeros((3 * len(at), len(calibration.labels)))
    if calibration.states_u:
        unit[np.arange(len(unit)), calibration.point_unknowns(taken.code)] = 1
    flat = np.concatenate([by_calibration, unit]).reshape(len(code), 3, len(calibration.labels))[order]
    return Estimate(
        code=code[order],
        xyz_mm=np.concatenate([solved.xyz_mm, at])[order],
        own=np.concatenate([own, np.zeros((len(at), 3, 3))])[order],
        by_calibration=flat.reshape(3 * len(code), len(calibration.labels)),
        rays=np.concatenate([solved.sights.rays, taken.rays])[order],
        residual_rms_px=np.concatenate([_rms(solved.sights, solved.rays), _rms(taken, rays)])[order],
        rejected=np.concatenate([solved.rejected, np.zeros(len(at), int)])[order],
        states_u=calibration.states_u,
    )


def settle(sights: Sights, calibration: Calibration, method: Method) -> Solved:
    """Points of all sights of which two rays agree or more, the others left out.

    Raises `TestfieldError` where the calibration is so poor that rays or their covariances are of no use.
    """
    try:
        return _settle(sights, calibration, method)
    except np.linalg.LinAlgError as error:
        raise TestfieldError(
            f"points cannot be met: the calibration gives no usable rays ({error})",
            f"reconstructor {method.name}",
            "look at the calibration's residuals and uncertainty; more views or more boards make it better",
        ) from error


def _settle(sights: Sights, calibration: Calibration, method: Method) -> Solved:
    started = sights.rays
    while True:
        solved = solve(sights, calibration, method)
        size = _sizes(solved, calibration)
        # A wrong ray drags the others along: only the worst of each point goes in one round.
        bad = (size > REJECT_SIGMA) & (size >= size.max(axis=1, keepdims=True, initial=0))
        if not bad.any():
            return Solved(sights, solved.xyz_mm, solved.rays, solved.gain, started - sights.rays)
        # Of two rays that disagree neither can be told to be the wrong one.
        sights = sights.without(bad)
        keep = sights.places(calibration) >= 2
        sights, started = sights.take(keep), started[keep]


def solve(sights: Sights, calibration: Calibration, method: Method) -> Solved:
    """Points of all sights with all their rays."""
    n, k = sights.there.shape
    camera = calibration.camera_of_image[sights.station]
    xyz = meet_all(calibration.interiors, camera, calibration.stations, sights.station, sights.there, sights.xy_px)
    for _ in range(PASSES):
        rays = rays_of(sights, calibration, xyz)
        rays = rays.reprojected() if method.reprojected else rays
        W, flat = method.weights(sights, rays, calibration), rays.lines.reshape(n, 2 * k, 3)
        if W.ndim == 4:
            weighted = (np.swapaxes(rays.lines, -1, -2) @ W).transpose(0, 2, 1, 3).reshape(n, 3, 2 * k)
        else:
            weighted = np.swapaxes(flat, 1, 2) @ W
        factor = np.linalg.solve(weighted @ flat, weighted)
        step = np.einsum("nij,nj->ni", factor, rays.misclosure.reshape(n, 2 * k))
        xyz = xyz + step
        if np.abs(step).max(initial=0) < SETTLED_MM:
            break
    split = factor.reshape(n, 3, k, 2)
    gain = np.einsum("nikl,nklm->nikm", split, rays.to_line).reshape(n, 3, 2 * k)
    return Solved(sights, xyz, rays, gain, np.zeros(n, int))


def pixel_covariance(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """(n, k, 2, 2) covariance of each ray's residual in px: its own noise, and what the calibration leaves unknown."""
    n, k = sights.there.shape
    flat = rays.by_calibration.reshape(2 * n * k, len(calibration.labels))
    half = (flat @ calibration.covariance).reshape(rays.by_calibration.shape)
    return sights.cov_px2 + half @ np.swapaxes(rays.by_calibration, -1, -2)


def sandwich(solved: Solved) -> tuple[np.ndarray, np.ndarray]:
    """What pixels' noise leaves of each point, (n, 3, 3), and how points follow the calibration, (3n, P)."""
    n, k = solved.sights.there.shape
    split = solved.gain.reshape(n, 3, k, 2)
    half = np.einsum("nikl,nklm->nikm", split, solved.sights.cov_px2).reshape(n, 3, 2 * k)
    own = half @ np.swapaxes(solved.gain, 1, 2)
    unknowns = solved.rays.by_calibration.shape[-1]
    by_calibration = solved.gain @ solved.rays.by_calibration.reshape(n, 2 * k, unknowns)
    return own, -by_calibration.reshape(3 * n, unknowns)


def _rms(sights: Sights, rays: Rays) -> np.ndarray:
    return np.sqrt((rays.residual_px**2).sum(axis=(1, 2)) / np.maximum(sights.rays, 1))


def _sizes(solved: Solved, calibration: Calibration) -> np.ndarray:
    """(n, k) residuals in standard deviations of pixel and calibration, zero where there is no ray.

    A method with other weights than the rays deserve moves the point towards bad rays and leaves good ones with
    residuals that are larger than their own noise; what a residual has beyond it is no sign of a wrong ray.
    """
    n, k = solved.sights.there.shape
    own = np.linalg.cholesky(pixel_covariance(solved.sights, solved.rays, calibration))
    white = np.where(solved.sights.there[..., None, None], np.linalg.inv(own), 0)
    J = (white @ solved.rays.by_point).reshape(n, 2 * k, 3)
    gain = (solved.gain.reshape(n, 3, k, 2).swapaxes(1, 2) @ own).swapaxes(1, 2).reshape(n, 3, 2 * k)
    left = (np.eye(2 * k) - J @ gain).reshape(n, k, 2, 2 * k)
    spread, axes = np.linalg.eigh(left @ np.swapaxes(left, -1, -2))
    residual = np.einsum("nkji,nkjl,nkl->nki", axes, white, solved.rays.residual_px)
    return np.sqrt((residual**2 / np.maximum(spread, 1)).sum(axis=-1))
