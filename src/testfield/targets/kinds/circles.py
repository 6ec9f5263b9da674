"""Symmetric grids of circles."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import BoardKind, BoardPattern, grid, half_of_marks_mm


def _centres_mm(pattern: BoardPattern) -> np.ndarray:
    return grid(pattern.columns, pattern.rows, pattern.pitch_mm)


@register("boards", "circles")
def circles() -> BoardKind:
    """A symmetric grid of circles, which is taken to stand upright."""
    return BoardKind(
        points_mm=_centres_mm,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _centres_mm(pattern)),
        free_mm=lambda pattern: pattern.mark_mm,
        shows_front=False,
    )
