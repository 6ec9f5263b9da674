"""The field sheet: everything a measuring person is told about the field, and nothing that is only true."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from testfield.errors import speaking
from testfield.store.text import read_text, write_text
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.marks import RADII, USUAL, Marks, RingRadii


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
    """Two coded targets at a certified centre-to-centre distance. `role` is `control` or `check`."""

    name: str
    role: str
    codes: tuple[int, int]
    length_mm: float
    u_length_mm: float


@dataclass(frozen=True)
class Wand:
    """Three or more coded targets on a line, `codes` at `at_mm` from the first, which stays in one place while the wand
    turns about it; `u_mm` is each distance's standard uncertainty."""

    name: str
    codes: tuple[int, ...]
    at_mm: tuple[float, ...]
    u_mm: float = 0.0


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
    `code_radii` names the rings' shape (a key of `RADII`);
    `loose` maps the code of each coded target that belongs to no board to its dot diameter in mm.
    """

    bits: int
    boards: tuple[NominalBoard, ...]
    scale_bars: tuple[ScaleBar, ...] = ()
    loose: dict[int, float] = field(default_factory=dict)
    white_on_black: bool = True
    u_scale: float = 0.0
    code_radii: str = USUAL
    wands: tuple[Wand, ...] = ()
    measuring_lines: tuple[MeasuringLine, ...] = ()

    @property
    def radii(self) -> RingRadii:
        """The rings' shape."""
        return RADII[self.code_radii]

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
        bars = [bar.__dict__ | {"codes": list(bar.codes)} for bar in self.scale_bars]
        sheet = {
            "bits": self.bits,
            "code_radii": self.code_radii,
            "white_on_black": self.white_on_black,
            "u_scale": self.u_scale,
            "boards": boards,
            "scale_bars": bars,
            "loose_diameter_mm": {str(code): d for code, d in self.loose.items()},
            **({"wands": [asdict(wand) for wand in self.wands]} if self.wands else {}),
            **({"measuring_lines": [asdict(line) for line in self.measuring_lines]} if self.measuring_lines else {}),
        }
        write_text(path, json.dumps(sheet, indent=1))

    @staticmethod
    @speaking("field sheet")
    def load(path: Path) -> "Field":
        """Read what `save` wrote."""
        sheet = json.loads(read_text(path))
        boards = tuple(
            NominalBoard(
                b["name"],
                Marks(
                    np.column_stack([b["x_mm"], b["y_mm"]]).astype(float),
                    np.array(b["diameter_mm"], float),
                    np.array(b["code"], int),
                    sheet["bits"],
                ),
                b["u_xy_mm"],
                b["u_z_mm"],
                BoardPattern(**b["pattern"]) if "pattern" in b else None,
                (b["size_mm"][0], b["size_mm"][1]) if "size_mm" in b else None,
                _pose(b["pose"]) if "pose" in b else None,
            )
            for b in sheet["boards"]
        )
        bars = tuple(
            ScaleBar(b["name"], b["role"], (b["codes"][0], b["codes"][1]), b["length_mm"], b["u_length_mm"])
            for b in sheet["scale_bars"]
        )
        radii = sheet.get("code_radii", USUAL)  # sheets of before there was a choice
        if radii not in RADII:
            raise ValueError(f"code_radii '{radii}' is none of {', '.join(RADII)}")
        loose = {int(code): d for code, d in sheet["loose_diameter_mm"].items()}
        wands = tuple(
            Wand(w["name"], tuple(w["codes"]), tuple(w["at_mm"]), w.get("u_mm", 0.0)) for w in sheet.get("wands", ())
        )
        lines = tuple(
            MeasuringLine(line["name"], tuple(line["codes"]), tuple(line["length_mm"]), line["u_length_mm"])
            for line in sheet.get("measuring_lines", ())
        )
        return Field(sheet["bits"], boards, bars, loose, sheet["white_on_black"], sheet["u_scale"], radii, wands, lines)


def _pose(data: dict) -> CertifiedPose:
    turn, t = (tuple(float(v) for v in data[key]) for key in ("turn_rad", "t_mm"))
    if len(turn) != 3 or len(t) != 3:
        raise ValueError("a board's pose needs three numbers in turn_rad and in t_mm")
    return CertifiedPose(turn, t, float(data["u_turn_rad"]), float(data["u_mm"]))
