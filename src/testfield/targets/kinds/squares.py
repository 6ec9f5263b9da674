"""Grids of squares that do not touch, as Zhang's calibration plate has them (IEEE PAMI 22(11), 2000)."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import SIDES, BoardKind, BoardPattern, Cells, grid, half_of_marks_mm


def _middles_mm(pattern: BoardPattern) -> np.ndarray:
    return grid(pattern.columns, pattern.rows, pattern.pitch_mm)


def _corners_mm(pattern: BoardPattern) -> np.ndarray:
    return (_middles_mm(pattern)[:, None] + SIDES * pattern.mark_mm / 2).reshape(-1, 2)


def _cells(pattern: BoardPattern) -> Cells:
    """Lines at both sides of every square: each second cell in x and in y is black."""
    low = [np.unique(_middles_mm(pattern)[:, axis]) - pattern.mark_mm / 2 for axis in (0, 1)]
    x, y = ((begin[:, None] + [0.0, pattern.mark_mm]).ravel() for begin in low)
    black = np.zeros((len(y) - 1, len(x) - 1), bool)
    black[::2, ::2] = True
    return Cells(x, y, black)


@register("boards", "squares")
def squares() -> BoardKind:
    """Squares row by row from the top left, four corners each; the grid is taken to stand upright, as of circles."""
    return BoardKind(
        points_mm=_corners_mm,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _middles_mm(pattern)),
        free_mm=lambda pattern: 2 * min(pattern.mark_mm, pattern.pitch_mm - pattern.mark_mm),
        cells=_cells,
        known_within_mm=lambda pattern: pattern.pitch_mm,
        crossing=False,
        shows_front=False,
    )
