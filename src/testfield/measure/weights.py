"""Weights of observations whose uncertainty nobody states.

An algorithm need not state a covariance. What comes after it must weigh its pixels nevertheless: all alike, by the
standard deviation that the calibration's residuals have. Only the score still knows that none was stated.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations

FIRST_U_PX = 0.1
"""With which the first calibration weighs them: what corner finders and blob finders usually err."""
ALIKE, MOST_PASSES = 1.25, 4
"""A calibration is repeated until the standard deviation of its residuals is, by this factor, the one it was given."""
LEAST_U_PX = 1e-4
"""Residuals may be zero, of synthetic points; a weight must be finite."""


def all_stated(observations: Observations) -> bool:
    """Whether every measured row states a covariance."""
    return bool(observations.measured.states_u.all())


def calibrated(observations: Observations, calibrate: Callable[[Observations], Calibration]) -> Calibration:
    """What `calibrate` makes of observations; where some state no covariance, with the one that residuals show."""
    if all_stated(observations):
        return calibrate(observations)
    u_px, found = FIRST_U_PX, calibrate(observations.weighed(FIRST_U_PX))
    for _ in range(MOST_PASSES - 1):
        before, u_px = u_px, u_of(found)
        if 1 / ALIKE < u_px / before < ALIKE:
            break
        found = calibrate(observations.weighed(u_px))
    return found


def weighed_by(observations: Observations, calibration: Calibration) -> Observations:
    """The observations as their rays deserve: rows that state none get the standard deviation of the calibration's
    residuals. So do all, where the calibration states no covariance: what its cameras err is in no other number."""
    if calibration.states_u:
        return observations if all_stated(observations) else observations.weighed(u_of(calibration))
    return replace(observations, cov_px2=np.full_like(observations.cov_px2, np.nan)).weighed(u_of(calibration))


def u_of(calibration: Calibration) -> float:
    """Standard uncertainty in px of rows that state none, as the residuals have it."""
    found = calibration.u_px
    return max(found, LEAST_U_PX) if found == found else FIRST_U_PX
