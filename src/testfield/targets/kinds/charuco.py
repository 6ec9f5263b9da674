"""ChArUco boards: a checkerboard with a tag in each white square."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import (
    BoardKind,
    BoardPattern,
    Cells,
    grid,
    lines_of_tags,
    middles_of_cells,
    squares_black,
    with_tags,
)
from testfield.targets.kinds.checkerboard import half_mm, inner_corners_mm, lines_mm


def _first_white(pattern: BoardPattern) -> int:
    """1 where the square at the top left is white, which holds a tag."""
    return int(pattern.legacy and pattern.rows % 2 == 0)


def _tag_middles_mm(pattern: BoardPattern) -> np.ndarray:
    row, column = np.divmod(np.arange(pattern.columns * pattern.rows), pattern.columns)
    return grid(pattern.columns, pattern.rows, pattern.pitch_mm)[(row + column) % 2 != _first_white(pattern)]


def _cells(pattern: BoardPattern) -> Cells:
    inset = (pattern.pitch_mm - pattern.mark_mm) / 2
    squares = lines_mm(pattern)
    # A square's tag begins where the square does, plus the inset.
    tags = [lines_of_tags(pattern, lines[:-1] + inset) for lines in squares]
    x, y = (np.sort(np.concatenate(both)) for both in zip(squares, tags, strict=True))
    middle = middles_of_cells(x, y)
    return Cells(x, y, with_tags(pattern, middle, squares_black(pattern, middle, _first_white(pattern))))


def _diagonal_mm(pattern: BoardPattern) -> float:
    """From a square's corner to its tag's."""
    return float((pattern.pitch_mm - pattern.mark_mm) / np.sqrt(2))


@register("boards", "charuco")
def charuco() -> BoardKind:
    """A checkerboard, black at its top left, with a tag in each white square."""
    return BoardKind(
        points_mm=inner_corners_mm,
        half_mm=half_mm,
        # A tag's corner is next, along the diagonal of its square.
        free_mm=lambda pattern: float(np.sqrt(2) * (pattern.pitch_mm - pattern.mark_mm)),
        cells=_cells,
        tag_middles_mm=_tag_middles_mm,
        known_within_mm=_diagonal_mm,
    )
