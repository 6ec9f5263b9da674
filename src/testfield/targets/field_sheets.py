"""The tables of a field sheet's file."""

from typing import Annotated, Literal

import pydantic

from testfield.store.sheets import LARGEST_MM, Count, Sheet
from testfield.targets.camera_sheet import CameraTable, RigTable
from testfield.targets.marks import USUAL, RingShape

Millimetres = Annotated[float, pydantic.Field(ge=-LARGEST_MM, le=LARGEST_MM)]
Length = Annotated[float, pydantic.Field(gt=0, le=LARGEST_MM)]
Uncertainty = Annotated[float, pydantic.Field(ge=0, le=LARGEST_MM)]
Triple = tuple[Millimetres, Millimetres, Millimetres]


class _PoseSheet(Sheet):
    turn_rad: Triple
    t_mm: Triple
    u_turn_rad: Uncertainty
    u_mm: Uncertainty


class _PatternSheet(Sheet):
    kind: str
    columns: Annotated[int, pydantic.Field(ge=1, le=1000)]
    rows: Annotated[int, pydantic.Field(ge=1, le=1000)]
    pitch_mm: Length
    mark_mm: Uncertainty = 0.0
    names: str = ""
    first_tag: Count = 0
    legacy: bool = False
    border_cells: Annotated[int, pydantic.Field(ge=1, le=4)] = 1
    crowns: Annotated[int, pydantic.Field(ge=0, le=4)] = 0


class BoardSheet(Sheet):
    """A board."""

    name: str
    u_xy_mm: Uncertainty
    u_z_mm: Uncertainty
    x_mm: list[Millimetres]
    y_mm: list[Millimetres]
    diameter_mm: list[Uncertainty]
    code: list[Count]
    pattern: _PatternSheet | None = None
    size_mm: tuple[Length, Length] | None = None
    pose: _PoseSheet | None = None


class _BarSheet(Sheet):
    name: str
    role: Literal["control", "check"]
    codes: tuple[Count, Count]
    length_mm: Length
    u_length_mm: Uncertainty
    moved: bool = False


class _LineSheet(Sheet):
    name: str
    codes: tuple[Count, ...]
    length_mm: tuple[Length, ...]
    u_length_mm: Uncertainty

    @pydantic.model_validator(mode="after")
    def _as_many(self) -> "_LineSheet":
        if len(self.codes) != len(self.length_mm) + 1:
            raise ValueError(f"{len(self.codes)} codes and {len(self.length_mm)} lengths from the first")
        return self


class _CodesSheet(Sheet):
    name: str = ""
    source: str = ""
    number: list[Count]
    word: list[str]


class FieldSheet(Sheet):
    """A field sheet."""

    bits: Annotated[int, pydantic.Field(ge=6, le=24)]
    code_radii: RingShape = USUAL  # sheets of before there was a choice
    white_on_black: bool
    u_scale: Annotated[float, pydantic.Field(ge=0, le=1)]
    boards: list[BoardSheet]
    scale_bars: list[_BarSheet]
    loose_diameter_mm: dict[Count, Length]
    measuring_lines: tuple[_LineSheet, ...] = ()
    cameras: tuple[CameraTable, ...] = ()
    rigs: tuple[RigTable, ...] = ()
    codes: _CodesSheet | None = None
