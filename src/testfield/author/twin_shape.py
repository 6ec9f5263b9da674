"""How a printed sheet truly lies and where its marks truly are, from the photographs alone: its marks as free points.

A job takes a sheet as its field file says it is. Here the marks are points of a free network, whose places nobody
knows; what they differ by from the sheet, after a fit of seven parameters, is print errors and waves of the paper.
"""

from dataclasses import dataclass, replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.self_calibration import free_network
from testfield.calibrate.similarity import similarity
from testfield.calibrate.ties import coded_ties
from testfield.camera.pose import Poses
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError

LEAST_IMAGES = 4
"""Images from which a sheet's shape is taken: three determine it, the fourth controls it."""


@dataclass(frozen=True)
class Shape:
    """`off_mm` (n, 3) by how much marks lie off their sheet, in its frame; `u_mm` (3,) of that, rms; `scatter_px` of an
    image coordinate with all that taken out; `calibration` the camera and stations that belong to it."""

    off_mm: np.ndarray
    u_mm: np.ndarray
    scatter_px: float
    calibration: Calibration


def shape_of(
    calibration: Calibration, observations: Observations, nominal_mm: np.ndarray, hold: tuple[str, ...] = ()
) -> Shape | None:
    """The shape of the one sheet with marks at `nominal_mm` (n, 3), which `observations.point` numbers.

    None where the images do not tell it: too few, a mark or an image lost.
    """
    on = (observations.status == MEASURED) & (observations.point >= 0)
    named = replace(observations, code=np.where(on, observations.point + 1, 0))
    inner = calibration.interior
    if len(calibration.station_names) < LEAST_IMAGES:
        return None
    try:
        free = free_network(
            coded_ties(named)[0], inner.width_px, inner.height_px, inner.model, hold, focal_px=inner.fx, empirical=True
        )
    except TestfieldError:
        return None
    order = {int(code) - 1: k for k, code in enumerate(free.code)}
    found = free.calibration
    if set(order) != set(range(len(nominal_mm))) or set(found.station_names) != set(calibration.station_names):
        return None
    rows = np.array([order[k] for k in range(len(nominal_mm))])
    scale, R, t = similarity(free.xyz_mm[rows], nominal_mm)
    off = scale * free.xyz_mm[rows] @ R.T + t - nominal_mm
    turn = np.kron(np.eye(len(rows)), R)
    own = (3 * rows[:, None] + np.arange(3)).ravel()
    cov = scale**2 * turn @ free.cov_xyz_mm2[np.ix_(own, own)] @ turn.T
    u2 = np.diag(cov).reshape(-1, 3).mean(axis=0)
    # What is measured of a place is its error as well: the best guess of each is smaller by the variances' ratio.
    share = np.clip(1 - u2 / np.maximum((off**2).mean(axis=0), 1e-30), 0, 1)
    R_new = found.stations.R @ R.T
    stations = Poses(R_new, scale * found.stations.t_mm - R_new @ t)
    place = [found.station_names.index(name) for name in calibration.station_names]
    freedom = max(found.freedom, 1)
    return Shape(
        off * share,
        np.sqrt(u2),
        float(np.sqrt((found.residual_px**2).sum() / freedom)),
        replace(
            calibration,
            interior=found.interior,
            stations=stations[np.array(place)],
            misfit=found.misfit,
        ),
    )
