"""RUNE-Tags: dots on three circles, a board each, whose every dot is a point."""

import numpy as np

from testfield.registry import register
from testfield.targets.board_pattern import BoardKind, BoardPattern
from testfield.targets.rune_code import DOT, RADII, SECTORS, places_of_rune


def _centres_mm(pattern: BoardPattern) -> np.ndarray:
    sector, circle = places_of_rune(pattern.first_tag)
    angle, radius = 2 * np.pi * sector / SECTORS, RADII[circle] * pattern.pitch_mm / 2
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _diameters_mm(pattern: BoardPattern) -> np.ndarray:
    return RADII[places_of_rune(pattern.first_tag)[1]] * pattern.mark_mm


@register("boards", "runetag")
def runetag() -> BoardKind:
    """One RUNE-Tag of 129 places: `pitch_mm` is the diameter of its outer circle, `mark_mm` of the dots on it."""
    return BoardKind(
        points_mm=_centres_mm,
        half_mm=lambda pattern: np.full(2, pattern.pitch_mm / 2 * (1 + DOT)),
        free_mm=lambda pattern: pattern.mark_mm,
        diameters_mm=_diameters_mm,
        tag_middles_mm=lambda pattern: np.zeros((1, 2)),
        on_circles=True,
    )
