"""Hexagonal grids of circles: every other row is half a distance further right, rows are sqrt(3)/2 apart.

As BoofCV prints them, the lowest row is not shifted; so of an even number of rows the top one is.
"""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import BoardKind, BoardPattern, half_of_marks_mm

ROWS_APART = np.sqrt(0.75)
"""In distances within a row, so that all six neighbours of a dot are equally far."""


def row_shifts(rows: int) -> np.ndarray:
    """(rows,) 1 for rows that are shifted by half a distance, from the top."""
    return np.arange(rows)[::-1] % 2


def _centres_mm(pattern: BoardPattern) -> np.ndarray:
    row, k = np.divmod(np.arange(pattern.columns * pattern.rows), pattern.columns)
    xy = np.column_stack([k + row_shifts(pattern.rows)[row] / 2, -row * ROWS_APART]) * pattern.pitch_mm
    return xy - (xy.max(axis=0) + xy.min(axis=0)) / 2


@register("boards", "hexcircles")
def hexcircles() -> BoardKind:
    """BoofCV's hexagonal grid of circles, with as many in each row."""
    return BoardKind(
        points_mm=_centres_mm,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _centres_mm(pattern)),
        free_mm=lambda pattern: pattern.mark_mm,
        staggered=True,
        hexagonal=True,
    )
