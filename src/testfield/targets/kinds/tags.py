"""Grids of tags (ArUco, AprilTag)."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import (
    BoardKind,
    BoardPattern,
    cells_of_tags,
    corners_of_tags,
    free_around_tags_mm,
    grid,
    half_of_marks_mm,
)


def _middles_mm(pattern: BoardPattern) -> np.ndarray:
    return grid(pattern.columns, pattern.rows, pattern.pitch_mm)


@register("boards", "tags")
def tags() -> BoardKind:
    """A grid of ArUco or AprilTag tags, measured at their outer corners."""
    return BoardKind(
        points_mm=corners_of_tags,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _middles_mm(pattern)),
        free_mm=free_around_tags_mm,
        cells=cells_of_tags,
        tag_middles_mm=_middles_mm,
        known_within_mm=lambda pattern: pattern.pitch_mm - pattern.mark_mm,
        crossing=False,
    )
