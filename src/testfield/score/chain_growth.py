"""How the pose error of boards grows along a chain: the law of METHODS 4.4, and the errors of links and boards."""

from dataclasses import dataclass

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import rotation_vector
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.statistics.consistency import nees


def grown(links: np.ndarray, shift: float, turn: float, pitch: float, shared: float = 0.0) -> np.ndarray:
    """Variance across the chain after `links` links, each with standard deviations `shift` and `turn` (rad).

    Every turn swings all boards behind it. `shared` is the covariance of shift and turn of the same link, which the
    law of METHODS takes as zero.
    """
    k = np.asarray(links, float)
    swung = (k - 1) * k * (2 * k - 1) / 6
    return k * shift**2 + pitch**2 * turn**2 * swung + pitch * shared * k * (k - 1)


def link_of_marks(xy_mm: np.ndarray, sigma_mm: float) -> tuple[float, float]:
    """Standard deviations of the shift (mm) and the turn in its plane (rad) of a board that marks (n, 2), each with
    `sigma_mm` in x and y, place by a rigid fit."""
    away = xy_mm - xy_mm.mean(axis=0)
    return sigma_mm / np.sqrt(len(xy_mm)), float(sigma_mm / np.sqrt((away**2).sum()))


@dataclass(frozen=True)
class ChainErrors:
    """Errors of boards along a chain, in the world's directions.

    Of boards 2 ... B `place_mm`, `u_place_mm` (B-1, 3): along the chain, out of its plane, up; `nees` (B-1,) of the
    pose per degree of freedom. Of links `shift_mm`, `turn_rad` (B-1, 2): of a board seen from the one before, out of
    the plane and up; a turn is positive where it moves the boards behind it that way.
    """

    place_mm: np.ndarray
    u_place_mm: np.ndarray
    nees: np.ndarray
    shift_mm: np.ndarray
    turn_rad: np.ndarray


def chain_errors(world: World, calibration: Calibration) -> ChainErrors:
    """Errors of the boards of a chain along x that faces -y, in the order of their names."""
    datum, true = true_in_datum(world, calibration.board_names)
    found, to_world = calibration.boards, datum.R[0]
    place, u, each = [], [], []
    for b, name in enumerate(calibration.board_names[1:], 1):
        turn = rotation_vector((found.R[b] @ true.R[b].T)[None])[0]
        error = np.concatenate([turn, found.t_mm[b] - true.t_mm[b]])
        index = calibration.index([f"board:{name}.{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")])
        covariance = calibration.covariance[np.ix_(index, index)]
        each.append(nees(error, covariance))
        place.append(to_world @ error[3:])
        u.append(np.sqrt(np.diag(to_world @ covariance[3:, 3:] @ to_world.T)))
    shift, turns = [], []
    for a in range(len(true) - 1):
        pair = [
            (poses.R[a].T @ poses.R[a + 1], poses.R[a].T @ (poses.t_mm[a + 1] - poses.t_mm[a]))
            for poses in (found, true)
        ]
        upright = to_world @ true.R[a]
        shift.append(upright @ (pair[0][1] - pair[1][1]))
        turns.append(upright @ rotation_vector((pair[0][0] @ pair[1][0].T)[None])[0])
    shifts, turned = np.array(shift), np.array(turns)
    # A turn about z moves what lies ahead in +y, one about y in -z; out of the plane, towards the cameras, is -y.
    return ChainErrors(
        np.array(place) * [1, -1, 1],
        np.array(u),
        np.array(each),
        shifts[:, 1:] * [-1, 1],
        np.column_stack([-turned[:, 2], -turned[:, 1]]),
    )
