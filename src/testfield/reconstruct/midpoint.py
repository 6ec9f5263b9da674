"""The point nearest to all rays, unweighted: least squares over the parametric rays (METHODS sections 1.2 and 1.4)."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Trials, reconstruct
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights
from testfield.registry import register
from testfield.targets.field import Field


def unweighted(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """(D D^T)^-1: D^T W D is then the projector square to the ray, and the residual a distance."""
    square = rays.lines @ np.swapaxes(rays.lines, -1, -2)
    return np.linalg.inv(np.where(sights.there[..., None, None], square, np.eye(2)))


UNWEIGHTED = Method("midpoint", unweighted)


@register("reconstructors", "midpoint", trials=Trials(UNWEIGHTED))
def midpoint(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """The point nearest to all rays, every ray counting the same; its covariance includes what that ignores."""
    return reconstruct(observations, calibration, field, UNWEIGHTED)
