"""Weighted least squares by parametric equations: each ray weighted by the covariance of its own equations, from image
and from projection matrix, rays taken for independent (METHODS section 1.5)."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Trials, pixel_covariance, reconstruct
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights
from testfield.registry import register
from testfield.targets.field import Field


def by_ray(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """Inverses of R = t^2 Sigma_u + G Sigma_theta G^T of each ray."""
    return line_weights(sights, rays, pixel_covariance(sights, rays, calibration))


def line_weights(sights: Sights, rays: Rays, cov_px2: np.ndarray) -> np.ndarray:
    """(n, k, 2, 2) inverse covariances of the lines' residuals, of pixels with covariances (n, k, 2, 2)."""
    covariance = rays.to_line @ cov_px2 @ np.swapaxes(rays.to_line, -1, -2)
    there = sights.there[..., None, None]
    return np.where(there, np.linalg.inv(np.where(there, covariance, np.eye(2))), 0)


BY_RAY = Method("parametric_wls", by_ray)


@register("reconstructors", "parametric_wls", trials=Trials(BY_RAY))
def parametric_wls(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """Weights from image and projection matrix, each ray by itself: the thesis' method."""
    return reconstruct(observations, calibration, field, BY_RAY)
