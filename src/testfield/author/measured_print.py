"""What somebody measured of a print, entered into its field sheet: how large it came out, or where its marks are."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testfield.errors import TestfieldError
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

COLUMNS = ("x_mm", "y_mm")
LEAST_POINTS = 3
FAR_MM = 2.0
"""A measured point farther from where it was printed is another one, or the columns are in another order."""


@dataclass(frozen=True)
class MeasuredPoints:
    """Places (n, 2) mm of a board's marks by number, in a frame of the measuring machine's own, each known within
    `u_mm` (n,)."""

    mark: np.ndarray
    xy_mm: np.ndarray
    u_mm: np.ndarray


def stretched(sheet: Field, scale_x: float, scale_y: float, u_scale: float) -> Field:
    """The sheet of prints that are `scale_x`, `scale_y` times as large as drawn, known within the part `u_scale`."""
    factor = np.array([scale_x, scale_y])

    def of(board: NominalBoard) -> NominalBoard:
        if board.pattern is not None and abs(scale_x / scale_y - 1) > 1e-9:
            raise TestfieldError(
                f"board '{board.name}' is a {board.pattern.kind}, whose squares stay squares in the sheet",
                "--scale-x, --scale-y",
                "give both the same scale, or measure its points (--points)",
            )
        pattern = board.pattern and replace(
            board.pattern, pitch_mm=board.pattern.pitch_mm * scale_x, mark_mm=board.pattern.mark_mm * scale_x
        )
        size = board.size_mm and (board.size_mm[0] * scale_x, board.size_mm[1] * scale_y)
        mean = float(np.sqrt(scale_x * scale_y))
        marks = Marks(board.marks.xy_mm * factor, board.marks.diameter_mm * mean, board.marks.code, board.marks.bits)
        return replace(board, marks=marks, pattern=pattern, size_mm=size)

    return replace(sheet, boards=tuple(of(board) for board in sheet.boards), u_scale=u_scale)


def load_points(path: Path, board: NominalBoard, u_mm: float | None) -> MeasuredPoints:
    """Points of a board from a CSV file with the columns x_mm, y_mm and `mark` (its number on the sheet, from 1) or
    `code`; u_mm where the file has a standard uncertainty for each, else `u_mm` for all.

    Raises `TestfieldError` with the line of what is wrong.
    """
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TestfieldError(f"not a readable table ({error})", str(path), "give a CSV file") from error
    columns = set(rows[0]) if rows else set()
    missing = [name for name in COLUMNS if name not in columns]
    if not {"mark", "code"} & columns:
        missing.append("mark or code")
    if u_mm is None and "u_mm" not in columns:
        missing.append("u_mm (or --u-um)")
    if missing:
        raise TestfieldError(f"no column {', '.join(missing)}", str(path), "name the columns in the first line")
    codes = {int(code): k for k, code in enumerate(board.marks.code) if code > 0}
    found: dict[int, tuple[float, float, float]] = {}
    for line, row in enumerate(rows, 2):
        by_code = bool(row.get("code"))
        try:
            number = int(row["code"] if by_code else row["mark"])
            values = [float(row[name]) for name in COLUMNS] + [float(row["u_mm"]) if row.get("u_mm") else u_mm or 0.0]
        except (TypeError, ValueError, KeyError) as error:
            raise TestfieldError(f"not numbers: {error}", f"{path}, line {line}", "correct it") from error
        k = codes.get(number, -1) if by_code else number - 1
        if not 0 <= k < len(board.marks):
            raise TestfieldError(
                f"board '{board.name}' has no {'code' if by_code else 'mark'} {number}",
                f"{path}, line {line}",
                "correct it",
            )
        if not np.all(np.isfinite(values)) or values[2] <= 0:
            raise TestfieldError(
                f"{values} are no place with an uncertainty", f"{path}, line {line}", "give finite mm, u_mm above zero"
            )
        if k in found:
            raise TestfieldError(f"{number} is given twice", f"{path}, line {line}", "leave one out")
        found[k] = (values[0], values[1], values[2])
    if len(found) < LEAST_POINTS:
        raise TestfieldError(f"{len(found)} points", str(path), f"measure {LEAST_POINTS} or more")
    table = np.array([found[k] for k in sorted(found)])
    return MeasuredPoints(np.array(sorted(found)), table[:, :2], table[:, 2])


def measured(board: NominalBoard, points: MeasuredPoints) -> NominalBoard:
    """The board with its marks where they were measured, turned into the sheet's frame.

    Marks that were not measured follow the affine map that fits those that were, as a printer stretches paper. All
    share one uncertainty: the root mean square of the points', and together with it, where a mark was not measured,
    the scatter that the affine map leaves. Raises `TestfieldError` where a point is far from where it was printed.
    """
    drawn = board.marks.xy_mm[points.mark]
    turn, shift = _rigid(points.xy_mm, drawn)
    here = points.xy_mm @ turn.T + shift
    off = np.linalg.norm(here - drawn, axis=1)
    if off.max() > FAR_MM:
        worst = int(off.argmax())
        raise TestfieldError(
            f"mark {points.mark[worst] + 1} was measured {off[worst]:.3g} mm from where it was printed",
            f"board '{board.name}'",
            "check the numbers of the marks, and whether y points up",
        )
    design = np.column_stack([drawn, np.ones(len(drawn))])
    affine, *_ = np.linalg.lstsq(design, here, rcond=None)
    left = here - design @ affine
    freedom = max(2 * len(drawn) - 6, 1)
    u_left = float(np.sqrt((left**2).sum() / freedom)) if len(drawn) > LEAST_POINTS else 0.0
    xy = np.column_stack([board.marks.xy_mm, np.ones(len(board.marks))]) @ affine
    xy[points.mark] = here
    all_measured = len(points.mark) == len(board.marks)
    u = float(np.sqrt(np.mean(points.u_mm**2)))
    marks = Marks(xy, board.marks.diameter_mm, board.marks.code, board.marks.bits)
    return replace(board, marks=marks, u_xy_mm=u if all_measured else float(np.hypot(u, u_left)))


def _rigid(moved: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn (2, 2) and shift (2,) that lead points (n, 2) to others best (Kabsch 1976), without turning them over."""
    a, b = moved.mean(axis=0), fixed.mean(axis=0)
    u, _, v = np.linalg.svd((moved - a).T @ (fixed - b))
    turn = v.T @ np.diag([1.0, float(np.sign(np.linalg.det(v.T @ u.T)))]) @ u.T
    return turn, b - turn @ a
