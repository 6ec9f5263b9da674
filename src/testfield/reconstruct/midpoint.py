"""The point nearest to all rays, unweighted: least squares over the parametric rays (METHODS sections 1.2 and 1.4)."""

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.gls import reconstruct
from testfield.reconstruct.points import Points
from testfield.registry import register
from testfield.targets.field import Field


@register("reconstructors", "midpoint")
def midpoint(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """The point nearest to all rays, every ray counting the same; its covariance includes what that ignores."""
    return reconstruct(observations, calibration, field, "midpoint")
