"""Kalibr's AprilGrid: AprilTags with a border of two cells, and a black square at each of their corners.

The layout is that of Kalibr (github.com/ethz-asl/kalibr: `kalibr_create_target_pdf`, `GridCalibrationTargetAprilgrid`):
tags are numbered row by row from the lower left, corners likewise, 2 x columns in a row; a tag's bits are read row by
row from its top left, most significant first, which is OpenCV's print turned by half. The squares are as wide as the
gaps, so that two edges cross in every corner.
"""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import (
    BoardKind,
    BoardPattern,
    Cells,
    grid,
    half_of_marks_mm,
    lines_of_tags,
    middles_of_cells,
    with_tags,
)

SAME_LINE = 1e-6
"""Lines that are nearer to each other than this part of a cell are one."""


def _middles_mm(pattern: BoardPattern) -> np.ndarray:
    return grid(pattern.columns, pattern.rows, pattern.pitch_mm) * [1, -1]


def _corners_mm(pattern: BoardPattern) -> np.ndarray:
    """(n, 2) corners row by row from the lower left."""
    x, y = (
        ((np.arange(count) - (count - 1) / 2) * pattern.pitch_mm)[:, None] + np.array([-0.5, 0.5]) * pattern.mark_mm
        for count in (pattern.columns, pattern.rows)
    )
    return np.stack(np.meshgrid(x.ravel(), y.ravel()), axis=-1).reshape(-1, 2)


def _gap_mm(pattern: BoardPattern) -> float:
    return pattern.pitch_mm - pattern.mark_mm


def _lines_mm(pattern: BoardPattern, low_mm: np.ndarray) -> np.ndarray:
    """All lines of one direction, of tags that begin at places (n,)."""
    squares = np.concatenate([low_mm - _gap_mm(pattern), low_mm + pattern.pitch_mm])
    lines = np.sort(np.concatenate([lines_of_tags(pattern, low_mm), squares]))
    return lines[np.diff(lines, prepend=-np.inf) > SAME_LINE * pattern.mark_mm / pattern.cells_a_tag]


def _cells(pattern: BoardPattern) -> Cells:
    low = [np.unique(_middles_mm(pattern)[:, axis]) - pattern.mark_mm / 2 for axis in (0, 1)]
    x, y = (_lines_mm(pattern, low_mm) for low_mm in low)
    middle = middles_of_cells(x, y)
    squares = np.ones(middle.shape[:2], bool)  # beside all tags in x and in y
    for axis in (0, 1):
        for begin_mm in low[axis]:
            squares &= (middle[..., axis] < begin_mm) | (middle[..., axis] > begin_mm + pattern.mark_mm)
    return Cells(x, y, with_tags(pattern, middle, squares))


def _free_mm(pattern: BoardPattern) -> float:
    """The tag's bits are next, along its diagonal, or the far sides of the corner square."""
    border = pattern.border_cells * pattern.mark_mm / pattern.cells_a_tag
    return float(2 * min(np.sqrt(2) * border, _gap_mm(pattern)))


@register("boards", "aprilgrid")
def aprilgrid() -> BoardKind:
    """AprilTags from the lower left, with a square at each corner, measured where the edges of both cross."""
    return BoardKind(
        points_mm=_corners_mm,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _middles_mm(pattern)) + _gap_mm(pattern),
        free_mm=_free_mm,
        cells=_cells,
        tag_middles_mm=_middles_mm,
        known_within_mm=_gap_mm,
        turned_tags=True,
        corner_squares=True,
    )
