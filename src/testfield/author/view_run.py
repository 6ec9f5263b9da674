"""A finished run beside what was predicted of it: each target's actual error, and the uncertainty that was stated."""

import numpy as np

from testfield.author.view_data import Actual, half_axes
from testfield.calibrate.calibration import Calibration
from testfield.reconstruct.points import Points
from testfield.scene.world import World
from testfield.score.align import rigid_fit
from testfield.score.camera import true_in_datum


def actual_of(world: World, target: np.ndarray, calibration: Calibration, points: Points) -> Actual:
    """Errors of the targets, numbers of marks (t,), in the world frame: measured in the datum frame that the
    calibration holds less true, turned into the world. A free network is fitted to the truth first."""
    datum, _ = true_in_datum(world, calibration.board_names)
    error, axes = np.full((len(target), 3), np.nan), np.full((len(target), 3, 3), np.nan)
    place = {int(code): k for k, code in enumerate(points.code)}
    row = np.array([place.get(int(code), -1) for code in world.marks.code[target]], int)
    here, row = np.flatnonzero(row >= 0), row[row >= 0]
    true = world.mark_world_mm[target[here]]
    R, t = datum.R[0], datum.t_mm[0]
    fitted = not calibration.board_names
    if fitted and len(here) >= 3:
        R, t = rigid_fit(points.xyz_mm[row], true)
    if len(here) and not (fitted and len(here) < 3):
        error[here] = points.xyz_mm[row] @ R.T + t - true
    if len(here) and points.states_u:
        axes[here] = R @ half_axes(np.stack([points.covariance_of(np.array([k])) for k in row]))
    return Actual(error, axes, points.method, fitted)
