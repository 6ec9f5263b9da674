"""What the datum costs (zero-order design, Grafarend 1974; Fraser 1984): the same network in other frames.

Images determine shapes; a frame is a choice. Held by one board, everything far from it swings with that board's
uncertainty; inner constraints over the points, which a fit to them amounts to, have the least mean variance of all
(METHODS section 5.4). Comparing them says how much of an uncertainty is the frame's and no better network's to mend.
"""

from typing import Any

import numpy as np

from testfield.camera.pose import cross_matrix
from testfield.plan.points import PointCovariance
from testfield.plan.predict import Prediction
from testfield.score.align import rigid_basis

AXES = ("rx", "ry", "rz", "tx", "ty", "tz")


def datum_card(found: Prediction) -> dict[str, Any]:
    """Root mean square uncertainty per coordinate of the check points: in the frame of every board, and after inner
    constraints; `costs` is the ratio of the scene's own to the least."""
    check = np.flatnonzero(found.is_check)
    boards = [found.job.field.boards[b].name for b in found.planned.boards]
    if not len(check):
        return {"board": boards[0], "boards": [], "inner_mm": None, "costs": None}
    inner = None
    if len(check) >= 3:
        inner = found.points.take(check).rms_after(rigid_basis(found.xyz_mm[check]))
    rows = [{"board": name, "u_rms_mm": rms_in_board(found, check, k)} for k, name in enumerate(boards)]
    return {
        "board": boards[0],
        "boards": rows,
        "inner_mm": inner,
        "costs": None if not inner else rows[0]["u_rms_mm"] / inner,
    }


def rms_in_board(found: Prediction, points: np.ndarray, board: int) -> float:
    """Root mean square uncertainty per coordinate of points in the frame of a board (its place in the plan)."""
    own = found.points.take(points)
    if board > 0:
        name = found.job.field.boards[found.planned.boards[board]].name
        index = found.index([f"board:{name}.{axis}" for axis in AXES])
        offset = found.xyz_mm[points] - found.adjustment.network.boards.t_mm[board]
        n = len(points)
        # y = R^T (x - t), and the board turns by w after R: R dy = dx - dt + [x - t]x w.
        follows = own.by_shared.reshape(n, 3, -1).copy()
        follows[:, :, index[:3]] += cross_matrix(offset)
        follows[:, :, index[3:]] -= np.eye(3)
        own = PointCovariance(own.own, follows.reshape(3 * n, -1), own.shared, own.weights)
    return float(np.sqrt(np.einsum("nii->", own.blocks()) / (3 * len(points))))
