"""Algorithms, a lens model and a kind of board as a user adds them: this one file, and one line where it is imported.

In a package of one's own that line is an entry point: `one_term = "my_package.ones_own"` under `testfield.lenses`.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.stitched import stitched
from testfield.camera.lens import LensModel
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Trials, reconstruct
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import Rays, Sights
from testfield.registry import register
from testfield.targets.board_pattern import (
    BoardKind,
    BoardPattern,
    cells_of_tags,
    corners_of_tags,
    free_around_tags_mm,
    half_of_marks_mm,
)
from testfield.targets.field import Field


@register("lenses", "one_term")
def one_term() -> LensModel:
    """A radius grows by its cube times `bow`."""
    return LensModel(
        coefficients=("bow",),
        image=_image,
        by_coefficients=lambda xy, c: (xy * (xy**2).sum(axis=-1, keepdims=True))[..., None],
        reach=lambda c: float(np.sqrt(-1 / (3 * c[0]))) if c[0] < 0 else np.inf,
        radial=lambda r, c: (r + c[0] * r**3, 1 + 3 * c[0] * r**2),
        radial_terms=("bow",),
        examples={"": (3000, 3000, -0.1)},
        folding=(-0.4,),
    )


def _image(x: Any, y: Any, c: Any, m: Any) -> tuple[Any, ...]:
    grow, slope = 1 + c[0] * (x * x + y * y), 2 * c[0]
    return x * grow, y * grow, grow + slope * x * x, slope * x * y, slope * x * y, grow + slope * y * y


@register("centroids", "brightest")
def brightest() -> None:
    """Nothing that measures: it is only found."""


@register("calibrators", "stitched_anew")
def stitched_anew(
    observations: Observations, field: Field, width_px: int, height_px: int, lens: str = "brown", hold: tuple = ()
) -> Calibration:
    """`stitched` under another name."""
    return replace(stitched(observations, field, width_px, height_px, lens, hold), method="stitched_anew")


def _by_depth(sights: Sights, rays: Rays, calibration: Calibration) -> np.ndarray:
    weight = np.where(sights.there, 1 / np.maximum(rays.depth_mm, 1.0) ** 2, 0)
    return weight[..., None, None] * np.eye(2)


@register("reconstructors", "by_depth", trials=Trials(Method("by_depth", _by_depth)))
def by_depth(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """Near rays count more."""
    return reconstruct(observations, calibration, field, Method("by_depth", _by_depth))


def _staggered_mm(pattern: BoardPattern) -> np.ndarray:
    row, column = np.divmod(np.arange(pattern.columns * pattern.rows), pattern.columns)
    xy = np.column_stack([column + 0.5 * (row % 2), -row]) * pattern.pitch_mm
    return xy - (xy.max(axis=0) + xy.min(axis=0)) / 2


@register("boards", "staggered_tags")
def staggered_tags() -> BoardKind:
    """Tags of which every other row is moved by half a distance."""
    return BoardKind(
        points_mm=corners_of_tags,
        half_mm=lambda pattern: half_of_marks_mm(pattern, _staggered_mm(pattern)),
        free_mm=free_around_tags_mm,
        cells=cells_of_tags,
        tag_middles_mm=_staggered_mm,
        known_within_mm=lambda pattern: pattern.pitch_mm - pattern.mark_mm,
        crossing=False,
    )
