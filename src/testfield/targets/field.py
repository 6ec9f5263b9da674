"""The field sheet: everything a measuring person is told about the field, and nothing that is only true."""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import speaking
from testfield.registry import names
from testfield.store.sheets import FORMAT, checked, read_json, unique
from testfield.store.text import write_text
from testfield.targets.board_pattern import BoardPattern, dictionary
from testfield.targets.camera_sheet import CameraSheet, RigSheet, cameras_of, tables_of
from testfield.targets.code_table import CodeTable, of_sheet
from testfield.targets.field_sheets import BoardSheet, FieldSheet
from testfield.targets.marks import USUAL, Marks, RingRadii, ring_radii
from testfield.targets.ring_code import BITS


@dataclass(frozen=True)
class CertifiedPose:
    """Where a board is in the frame of the sheet's first board: `x_first = R @ x_board + t_mm`, R from the rotation
    vector `turn_rad`; `u_turn_rad`, `u_mm` the standard uncertainties of each small turn and each shift."""

    turn_rad: tuple[float, float, float]
    t_mm: tuple[float, float, float]
    u_turn_rad: float
    u_mm: float


@dataclass(frozen=True)
class NominalBoard:
    """A sub-board as certified: its marks in its own frame, and how well they are known.

    `u_xy_mm` is the standard uncertainty of each mark's x and y, `u_z_mm` of its height (flatness). `pattern` is what
    the board shows where that is not ring codes with plain dots; `size_mm` its width and height, needed with `pattern`.
    The marks are then the pattern's points, a corner's diameter that of the circle in which nothing else is printed.
    `pose` is given where somebody has measured where the board is.
    """

    name: str
    marks: Marks
    u_xy_mm: float
    u_z_mm: float
    pattern: BoardPattern | None = None
    size_mm: tuple[float, float] | None = None
    pose: CertifiedPose | None = None

    @property
    def has_corners(self) -> bool:
        """Whether its marks are corners instead of discs."""
        return self.pattern is not None and self.pattern.has_corners


@dataclass(frozen=True)
class ScaleBar:
    """Two coded targets at a certified centre-to-centre distance. `role` is `control` or `check`; `moved` whether it
    lies elsewhere at every time at which the cameras took images."""

    name: str
    role: str
    codes: tuple[int, int]
    length_mm: float
    u_length_mm: float
    moved: bool = False


TIME = 100_000
"""More than the highest code: what a moved target's code grows by with every time."""


def code_at(code: Any, time: Any) -> Any:
    """The code under which a moved target is known at a time: a point of its own."""
    return code + TIME * time


@dataclass(frozen=True)
class MeasuringLine:
    """Coded targets on a line for a length measurement test: `codes` in order, the calibrated distances `length_mm`
    of all but the first from the first, and their standard uncertainty `u_length_mm`. No adjustment may use them."""

    name: str
    codes: tuple[int, ...]
    length_mm: tuple[float, ...]
    u_length_mm: float


@dataclass(frozen=True)
class Field:
    """The field sheet.

    `u_scale` is the relative standard uncertainty of the scale all boards share (printing, temperature);
    `code_radii` names the rings' shape, as 1:2:3; `codes` is a table of a maker's own, absent that of so many `bits`;
    `loose` maps the code of each coded target that belongs to no board to its dot diameter in mm; `cameras` and the
    `rigs` that hold some of them are those that took the images.
    """

    bits: int
    boards: tuple[NominalBoard, ...]
    scale_bars: tuple[ScaleBar, ...] = ()
    loose: dict[int, float] = field(default_factory=dict)
    white_on_black: bool = True
    u_scale: float = 0.0
    code_radii: str = USUAL
    measuring_lines: tuple[MeasuringLine, ...] = ()
    cameras: tuple[CameraSheet, ...] = ()
    rigs: tuple[RigSheet, ...] = ()
    codes: CodeTable | None = None

    @property
    def moving(self) -> tuple[int, ...]:
        """Codes of targets that lie elsewhere at every time."""
        return tuple(code for bar in self.scale_bars if bar.moved for code in bar.codes)

    def at_times(self, times: int) -> "Field":
        """The field with every moved bar once for each time, under codes of that time.

        A control bar's certified length is the same at all of them, and so is its error: n lengths of it tell the scale
        no better than one, so that each is given the standard uncertainty sqrt(n) u.
        """
        if not self.moving or times == 1:
            return self
        bars: list[ScaleBar] = []
        for bar in self.scale_bars:
            each = bar.u_length_mm * (np.sqrt(times) if bar.role == "control" else 1.0)
            bars += (
                [
                    replace(
                        bar,
                        name=f"{bar.name} @{time}",
                        codes=(code_at(bar.codes[0], time), code_at(bar.codes[1], time)),
                        u_length_mm=float(each),
                    )
                    for time in range(times)
                ]
                if bar.moved
                else [bar]
            )
        loose = dict(self.loose)
        for code in self.moving:
            loose |= {code_at(code, time): self.loose[code] for time in range(times)}
        return replace(self, scale_bars=tuple(bars), loose=loose)

    @property
    def radii(self) -> RingRadii:
        """The rings' shape."""
        return ring_radii(self.code_radii)

    def save(self, path: Path) -> None:
        """Write as JSON (`field.json` in a run's folder)."""
        boards = [
            {
                "name": b.name,
                "u_xy_mm": b.u_xy_mm,
                "u_z_mm": b.u_z_mm,
                "x_mm": b.marks.xy_mm[:, 0].tolist(),
                "y_mm": b.marks.xy_mm[:, 1].tolist(),
                "diameter_mm": b.marks.diameter_mm.tolist(),
                "code": b.marks.code.tolist(),
                **({"pattern": asdict(b.pattern), "size_mm": b.size_mm} if b.pattern else {}),
                **({"pose": asdict(b.pose)} if b.pose else {}),
            }
            for b in self.boards
        ]
        bars = [
            {key: value for key, value in vars(bar).items() if key != "moved" or value} | {"codes": list(bar.codes)}
            for bar in self.scale_bars
        ]
        sheet = {
            "format": FORMAT,
            "bits": self.bits,
            "code_radii": self.code_radii,
            **({"codes": self.codes.sheet()} if self.codes else {}),
            "white_on_black": self.white_on_black,
            "u_scale": self.u_scale,
            "boards": boards,
            "scale_bars": bars,
            "loose_diameter_mm": {str(code): d for code, d in self.loose.items()},
            **({"measuring_lines": [asdict(line) for line in self.measuring_lines]} if self.measuring_lines else {}),
            **tables_of(self.cameras, self.rigs),
        }
        write_text(path, json.dumps(sheet, indent=1))

    @staticmethod
    @speaking("field sheet")
    def load(path: Path) -> "Field":
        """Read what `save` wrote. Raises `TestfieldError` where types, names, lengths or numbers are not such."""
        sheet = checked(FieldSheet, read_json(path))
        boards = tuple(_board(b, sheet.bits) for b in sheet.boards)
        bars = tuple(ScaleBar(b.name, b.role, b.codes, b.length_mm, b.u_length_mm, b.moved) for b in sheet.scale_bars)
        lines = tuple(MeasuringLine(v.name, v.codes, v.length_mm, v.u_length_mm) for v in sheet.measuring_lines)
        codes = None if sheet.codes is None else of_sheet(sheet.codes.model_dump())
        if codes is None and sheet.bits not in BITS:
            raise ValueError(f"ring codes of {sheet.bits} bits need a table, codes")
        if codes is not None and codes.bits != sheet.bits:
            raise ValueError(f"bits is {sheet.bits}, and the words of codes have {codes.bits}")
        for what, named in (("board", boards), ("bar", bars), ("measuring line", lines)):
            unique([one.name for one in named], what)
        cameras, rigs = cameras_of(sheet.cameras, sheet.rigs)
        return Field(
            bits=sheet.bits,
            boards=boards,
            scale_bars=bars,
            loose=dict(sheet.loose_diameter_mm),
            white_on_black=sheet.white_on_black,
            u_scale=sheet.u_scale,
            code_radii=sheet.code_radii,
            measuring_lines=lines,
            cameras=cameras,
            rigs=rigs,
            codes=codes,
        )


def _board(b: BoardSheet, bits: int) -> NominalBoard:
    n = len(b.x_mm)
    if not n == len(b.y_mm) == len(b.diameter_mm) == len(b.code):
        raise ValueError(f"board '{b.name}' has lists of different lengths")
    if b.pattern is not None and b.size_mm is None:
        raise ValueError(f"board '{b.name}' has a pattern and no size_mm")
    pattern = None
    if b.pattern is not None:
        if b.pattern.kind not in names("boards"):
            raise ValueError(f"board '{b.name}': no pattern is called '{b.pattern.kind}'")
        if b.pattern.names:
            dictionary(b.pattern.names)
        pattern = BoardPattern(**b.pattern.model_dump())
    pose = None if b.pose is None else CertifiedPose(**b.pose.model_dump())
    marks = Marks(
        np.column_stack([b.x_mm, b.y_mm]).astype(float).reshape(n, 2),
        np.array(b.diameter_mm, float),
        np.array(b.code, int),
        bits,
    )
    return NominalBoard(b.name, marks, b.u_xy_mm, b.u_z_mm, pattern, b.size_mm, pose)
