"""The direct linear transformation: the two linear equations of each ray as they stand (METHODS section 1.5).

Their weight depends on the arbitrary scale of each projection matrix. Two usual choices are given: the third row's
first three numbers of length one, so that a residual is depth times pixels; and the last number one, so that it is
depth over the camera's distance from the plane through the datum's origin, whatever that means.
"""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Trials, reconstruct
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights
from testfield.registry import register
from testfield.targets.field import Field


def in_pixels(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """Depth times pixels of the ideal image, with ||m3|| = 1."""
    fx, fy = calibration.interior.parameters[:2]
    return np.broadcast_to(np.diag([fx**2, fy**2]), (*sights.there.shape, 2, 2))


def by_last_element(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """The same divided by the last element of each projection matrix."""
    last = calibration.stations.t_mm[sights.station, 2]
    return in_pixels(sights, rays, calibration) / (last**2)[..., None, None]


IN_PIXELS = Method("dlt", in_pixels)


@register("reconstructors", "dlt", trials=Trials(IN_PIXELS))
def dlt(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """The direct linear transformation with projection matrices of ||m3|| = 1."""
    return reconstruct(observations, calibration, field, IN_PIXELS)


BY_LAST_ELEMENT = Method("dlt_p34", by_last_element)


@register("reconstructors", "dlt_p34", trials=Trials(BY_LAST_ELEMENT))
def dlt_p34(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """The direct linear transformation with projection matrices of p34 = 1."""
    return reconstruct(observations, calibration, field, BY_LAST_ELEMENT)
