"""Boards of CCTags: concentric crowns whose centres are points, exactly, whatever the perspective."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import BoardKind, BoardPattern, Cells, Discs, grid, half_of_marks_mm
from testfield.targets.crowns import crown_radii


def _centres_mm(pattern: BoardPattern) -> np.ndarray:
    return grid(pattern.columns, pattern.rows, pattern.pitch_mm)


def _discs(pattern: BoardPattern) -> Discs:
    """Every crown as a disc of ink and one of paper within it."""
    radii = crown_radii(pattern.crowns)[pattern.tags]
    n, edges = radii.shape
    sign = np.where(np.arange(edges) % 2 == 0, 1, -1)
    return Discs(
        np.repeat(_centres_mm(pattern), edges, axis=0),
        radii.ravel() * pattern.mark_mm / 2,
        np.tile(sign, n).astype(int),
    )


def _paper(pattern: BoardPattern) -> Cells:
    """Nothing is printed but discs."""
    x, y = half_of_marks_mm(pattern, _centres_mm(pattern)).tolist()
    return Cells(np.array([-x, x]), np.array([-y, y]), np.zeros((1, 1), bool))


@register("boards", "cctag")
def cctag() -> BoardKind:
    """A grid of CCTags, numbered row by row from the top left."""
    return BoardKind(
        points_mm=_centres_mm,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _centres_mm(pattern)),
        free_mm=lambda pattern: pattern.mark_mm,
        cells=_paper,
        tag_middles_mm=_centres_mm,
        discs=_discs,
    )
