"""The virtual mother board that stitching makes of all boards: how true it is, and whether it is flat."""

import numpy as np
from scipy.stats import chi2

from testfield.calibrate.calibration import Calibration
from testfield.scene.world import World
from testfield.score.align import rigid_fit
from testfield.score.camera import true_in_datum
from testfield.score.flatness import flatness
from testfield.statistics.consistency import chi_squared


def mother_scores(world: World, calibration: Calibration) -> dict[str, float]:
    """How far the mother board's marks are from the truth, their range about their best plane and that of the true
    ones, and the test of flatness. NaN where a calibration has one board only."""
    found, true = mother_marks(world, calibration)
    statistic, freedom = coplanarity(calibration)
    return {
        "mother_rms_mm": fitted_rms_mm(found, true),
        "mother_flatness_mm": flatness(found),
        "true_flatness_mm": flatness(true),
        "coplanarity": statistic / freedom if freedom else float("nan"),
        "flat_passed": float(statistic <= chi2.ppf(0.95, freedom)) if freedom else float("nan"),
    }


def mother_marks(world: World, calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) the mother board's marks as a user has them (the sheets' marks at the calibrated scale and poses) and the
    true ones, both in the frame of the first board."""
    datum, _ = true_in_datum(world, calibration.board_names)
    place = {sheet.name: k for k, sheet in enumerate(world.field.boards)}
    measured, true = [], []
    for b, name in enumerate(calibration.board_names):
        here = world.marks.board == place[name]
        xy = world.field.boards[place[name]].marks.xy_mm[world.marks.point[here]] * calibration.scale
        local = np.column_stack([xy, np.zeros(len(xy))])
        measured.append(local @ calibration.boards.R[b].T + calibration.boards.t_mm[b])
        true.append((world.mark_world_mm[here] - datum.t_mm[0]) @ datum.R[0])
    return np.vstack(measured), np.vstack(true)


def fitted_rms_mm(found_mm: np.ndarray, true_mm: np.ndarray) -> float:
    """Each coordinate's root mean square after a fit of six parameters."""
    R, t = rigid_fit(found_mm, true_mm)
    return float(np.sqrt(((found_mm @ R.T + t - true_mm) ** 2).mean()))


def coplanarity(calibration: Calibration) -> tuple[float, int]:
    """Chi-squared, and its degrees of freedom, of the claim that all boards lie in the plane of the first.

    Of every other board two leans and the height of its origin are compared with zero, by their covariance. The
    test takes the boards' own flatness for granted, and has none to judge where there is one board.
    """
    names = calibration.board_names[1:]
    index = calibration.index([f"board:{name}.{axis}" for name in names for axis in ("rx", "ry", "tz")])
    normal = calibration.boards.R[1:, :, 2]
    # A small turn (x, y) brings the first board's normal to (y, -x, 1).
    off = np.column_stack([-normal[:, 1], normal[:, 0], calibration.boards.t_mm[1:, 2]]).ravel()
    covariance = calibration.covariance[np.ix_(index, index)]
    return chi_squared(off, covariance)
