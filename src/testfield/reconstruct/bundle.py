"""All points and the cameras together, the calibration with its covariance as what was known before.

Many points seen by the same cameras say something of the cameras too: with v = J dx + G dtheta + noise for every point,
the points are eliminated, dtheta is found with its prior, and the points follow. More than point by point (METHODS
section 1.6, last sentence).
"""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Solved, Trials, estimate_of, settle, solve, to_meet
from testfield.reconstruct.gls import CORRELATED
from testfield.reconstruct.ml import REPROJECTION
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import sights_of
from testfield.registry import register
from testfield.targets.field import Field


@register("reconstructors", "bundle", trials=Trials(REPROJECTION, screened_by=CORRELATED, moves_cameras=True))
def bundle(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """Points and cameras in one adjustment, the calibration's covariance as the cameras' prior."""
    # Which rays are wrong is asked with the cameras' correlation; the rest is one linear step from the ML points.
    sights = sights_of(observations, calibration, field)
    sound = settle(to_meet(sights, calibration), calibration, CORRELATED)
    solved = replace(solve(sound.sights, calibration, REPROJECTION), rejected=sound.rejected)
    estimate = estimate_of(solved, sights, calibration)
    information, right = information_of_cameras(solved)
    posterior = posterior_of(calibration.covariance, information)
    moved = (estimate.by_calibration @ (posterior @ right)).reshape(-1, 3)
    return replace(estimate, xyz_mm=estimate.xyz_mm + moved).points("bundle", posterior)


def information_of_cameras(solved: Solved) -> tuple[np.ndarray, np.ndarray]:
    """What the residuals of all points tell of the calibration's unknowns: normal matrix (P, P) and right side (P,)."""
    n, k = solved.sights.there.shape
    unknowns = solved.rays.by_calibration.shape[-1]
    whitening = np.linalg.inv(np.linalg.cholesky(solved.sights.cov_px2))
    whitening = np.where(solved.sights.there[..., None, None], whitening, 0)
    J = (whitening @ solved.rays.by_point).reshape(n, 2 * k, 3)
    G = (whitening @ solved.rays.by_calibration).reshape(n, 2 * k, unknowns)
    v = np.einsum("nkij,nkj->nki", whitening, solved.rays.residual_px).reshape(n, 2 * k)
    # Square to what the point itself explains.
    basis = np.linalg.qr(J)[0]
    left = G - basis @ (np.swapaxes(basis, 1, 2) @ G)
    flat = left.reshape(2 * n * k, unknowns)
    return flat.T @ flat, flat.T @ v.ravel()


def posterior_of(prior: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Covariance after information was added to a prior that may be singular."""
    size = len(prior)
    posterior = np.linalg.solve(np.eye(size) + prior @ information, prior)
    return 0.5 * (posterior + posterior.T)
