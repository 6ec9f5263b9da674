"""Checkerboards: squares alone."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import BoardKind, BoardPattern, Cells, grid, middles_of_cells, squares_black


def inner_corners_mm(pattern: BoardPattern) -> np.ndarray:
    """(n, 2) corners where four squares meet."""
    return grid(pattern.columns - 1, pattern.rows - 1, pattern.pitch_mm)


def half_mm(pattern: BoardPattern) -> np.ndarray:
    """(2,) half the width and height of all squares."""
    return np.array([pattern.columns, pattern.rows]) * pattern.pitch_mm / 2


def lines_mm(pattern: BoardPattern) -> list[np.ndarray]:
    """Lines between the squares in x and in y."""
    counts = zip((pattern.columns, pattern.rows), half_mm(pattern), strict=True)
    return [np.arange(count + 1) * pattern.pitch_mm - half for count, half in counts]


def _cells(pattern: BoardPattern) -> Cells:
    x, y = lines_mm(pattern)
    return Cells(x, y, squares_black(pattern, middles_of_cells(x, y), 0))


@register("boards", "checkerboard")
def checkerboard() -> BoardKind:
    """Squares alone, black at the top left."""
    return BoardKind(
        points_mm=inner_corners_mm,
        half_mm=half_mm,
        free_mm=lambda pattern: 2 * pattern.pitch_mm,
        cells=_cells,
    )
