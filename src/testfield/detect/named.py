"""Centres that carry no name get that of the mark which this project's own detector sees there."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.images import Frame
from testfield.detect.detect import ROUGH, detect
from testfield.detect.observations import MEASURED, Observations
from testfield.targets.field import Field

NEAR_PART, NEAR_PX = 0.25, 2.0
"""A centre is a mark's within this part of the mark's diameter, or so many px of a small one and of a corner."""


def needs_names(seen: Observations) -> bool:
    """Whether no row says which mark it is of."""
    return len(seen) > 0 and not ((seen.code > 0) | (seen.board >= 0)).any()


def named(seen: Observations, frame: Frame, field: Field, smallest_px: float) -> Observations:
    """The same centres of one frame under the names of the marks nearest to them, one centre a mark.

    What our own detector finds of the marks' sizes stands for moments that the centres do not have. Centres that are
    near no mark keep none: they are counted as false where nothing is.
    """
    own = detect(frame, field, ROUGH, smallest_px).measured
    corner = np.array([board.has_corners for board in field.boards] + [False])[own.board]
    near = np.maximum(np.where(corner, 0, NEAR_PART * own.diameter_px), NEAR_PX)
    rows = np.flatnonzero(seen.status == MEASURED)
    if not len(own) or not len(rows):
        return seen
    distance, mark = cKDTree(own.xy_px).query(seen.xy_px[rows])
    order = np.argsort(distance, kind="stable")
    _, first = np.unique(mark[order], return_index=True)
    chosen = order[first]
    chosen = chosen[distance[chosen] <= near[mark[chosen]]]
    row, mark = rows[chosen], mark[chosen]
    code, board, point, moments = (values.copy() for values in (seen.code, seen.board, seen.point, seen.moments_px2))
    code[row], board[row], point[row] = own.code[mark], own.board[mark], own.point[mark]
    untold = row[~np.isfinite(moments[row]).all(axis=(1, 2))]
    moments[untold] = own.moments_px2[mark[np.isin(row, untold)]]
    return replace(seen, code=code, board=board, point=point, moments_px2=moments)
