"""Generalised least squares: image noise and the calibration's covariance, cameras correlated (METHODS section 1.6)."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Trials, reconstruct
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights
from testfield.registry import register
from testfield.targets.field import Field


def all_together(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """(n, 2k, 2k) inverses of blockdiag(t^2 Sigma_u) + G Sigma_theta G^T, the lines of a point all together."""
    n, k = sights.there.shape
    unknowns = len(calibration.labels)
    G = (rays.to_line @ rays.by_calibration).reshape(n, 2 * k, unknowns)
    half = (G.reshape(2 * n * k, unknowns) @ calibration.covariance).reshape(G.shape)
    covariance = half @ np.swapaxes(G, 1, 2)
    own = rays.to_line @ sights.cov_px2 @ np.swapaxes(rays.to_line, -1, -2)
    own = np.where(sights.there[..., None, None], own, np.eye(2))
    blocks = covariance.reshape(n, k, 2, k, 2)
    blocks[:, np.arange(k), :, np.arange(k)] += np.moveaxis(own, 1, 0)
    return np.linalg.inv(covariance)


CORRELATED = Method("gls", all_together)


@register("reconstructors", "gls", trials=Trials(CORRELATED))
def gls(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """Generalised least squares: weights from image noise and from the calibration, cameras correlated."""
    return reconstruct(observations, calibration, field, CORRELATED)
