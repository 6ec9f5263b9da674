"""Asymmetric grids of circles: every other row is half a distance further right."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import BoardKind, BoardPattern, half_of_marks_mm


def _centres_mm(pattern: BoardPattern) -> np.ndarray:
    row, k = np.divmod(np.arange(pattern.columns * pattern.rows), pattern.columns)
    xy = np.column_stack([2 * k + row % 2, -row]) * pattern.pitch_mm
    return xy - (xy.max(axis=0) + xy.min(axis=0)) / 2


@register("boards", "acircles")
def acircles() -> BoardKind:
    """OpenCV's asymmetric grid of circles."""
    return BoardKind(
        points_mm=_centres_mm,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _centres_mm(pattern)),
        free_mm=lambda pattern: pattern.mark_mm,
        staggered=True,
    )
