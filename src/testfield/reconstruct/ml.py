"""Maximum likelihood given the cameras: the least weighted reprojection error (METHODS section 1.5, last part)."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Trials, reconstruct
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights
from testfield.registry import register
from testfield.targets.field import Field


def by_noise(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    """Inverses of the pixels' covariances."""
    return np.where(sights.there[..., None, None], np.linalg.inv(sights.cov_px2), 0)


REPROJECTION = Method("ml", by_noise, reprojected=True)


@register("reconstructors", "ml", trials=Trials(REPROJECTION))
def ml(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """The least weighted reprojection error, cameras taken as they are; the covariance knows that they are not."""
    return reconstruct(observations, calibration, field, REPROJECTION)
