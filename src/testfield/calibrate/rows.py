"""What of the observations a calibration can use, and what is turned down before it begins."""

from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np

from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field


def usable_rows(observations: Observations, field: Field) -> tuple[Observations, list[dict], list[str]]:
    """The measured observations that say clearly which mark they are; records of those that do not; notes on both.

    Of a code that occurs twice in an image, or twice on the field sheet, nobody knows which is which: both are turned
    down. Raises `TestfieldError` for a measured row that is not finite.
    """
    rows = observations.measured
    finite = np.isfinite(rows.xy_px).all(axis=1) & np.isfinite(rows.cov_px2).all(axis=(1, 2))
    if not finite.all():
        bad = int(np.argmin(finite))
        raise TestfieldError(
            f"observation {bad} (station '{rows.stations[rows.station[bad]]}', code {rows.code[bad]}) is not finite",
            "observations.parquet",
            "detect again, or drop the row",
        )
    doubtful, notes = _listed_twice(rows, field)
    twice = _seen_twice(rows)
    for k in sorted(set(np.flatnonzero(twice & ~doubtful).tolist()), key=lambda k: (rows.station[k], rows.code[k])):
        note = f"{_name(rows, field, k)} occurs more than once in image '{rows.stations[rows.station[k]]}'"
        if f"{note}: all of them are rejected" not in notes:
            notes.append(f"{note}: all of them are rejected")
    bad_rows = doubtful | twice
    records = [rejection(rows, field, k, None, "ambiguous") for k in np.flatnonzero(bad_rows).tolist()]
    return rows.take(~bad_rows), records, notes


def rejection(rows: Observations, field: Field, k: int, sigmas: float | None, why: str) -> dict:
    """The record of an observation that was turned down, with `why`; `sigmas` its residual where it has one."""
    board = field.boards[rows.board[k]].name if rows.board[k] >= 0 else ""
    x, y = (float(v) for v in rows.xy_px[k])
    station = rows.stations[rows.station[k]]
    code = int(rows.code[k])
    return {"station": station, "board": board, "x_px": x, "y_px": y, "sigmas": sigmas, "why": why, "code": code} | {
        "point": int(rows.point[k])
    }


def best_board(rows: Observations, field: Field, name: str | None) -> int:
    """The board called `name`, or that of which most marks were observed.

    Raises `TestfieldError` where there is none.
    """
    names = [sheet.name for sheet in field.boards]
    if name is not None:
        if name not in names:
            raise TestfieldError(f"no board is called '{name}'", "measure.board", f"choose one of {', '.join(names)}")
        return names.index(name)
    on = rows.board[rows.board >= 0]
    if not len(on):
        raise TestfieldError("no mark of any board was identified", "observations.parquet", "look at the frames")
    return int(np.bincount(on, minlength=len(names)).argmax())


def on_one_board(rows: Observations, field: Field, board: int) -> tuple[Observations, Field]:
    """Only what was seen of one board, and a sheet of that board alone."""
    here = rows.take(rows.board == board)
    alone = replace(field, boards=(field.boards[board],), scale_bars=(), loose={})
    return replace(here, board=np.zeros(len(here), int)), alone


def _name(rows: Observations, field: Field, k: int) -> str:
    where = f" of board '{field.boards[rows.board[k]].name}'" if rows.board[k] >= 0 else ""
    return f"code {rows.code[k]}{where}" if rows.code[k] > 0 else f"mark {rows.point[k]}{where}"


def _seen_twice(rows: Observations) -> np.ndarray:
    """(n,) which rows share their image and their mark with another one."""
    on = rows.board >= 0
    keys = np.stack([rows.station, rows.board, np.where(on, rows.point, rows.code)], axis=1)
    named = on | (rows.code > 0)
    _, place, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    return named & (count[place.ravel()] > 1)


def _listed_twice(rows: Observations, field: Field) -> tuple[np.ndarray, list[str]]:
    """(n,) which rows carry a code that the sheet lists in two places, and a note on each such code."""
    owners: dict[int, list[str]] = defaultdict(list)
    for sheet in field.boards:
        for code in sheet.marks.code[sheet.marks.code > 0]:
            owners[int(code)].append(f"board '{sheet.name}'")
    for code in field.loose:
        owners[int(code)].append("the loose targets")
    twice = {code: names for code, names in owners.items() if len(names) > 1}
    notes = []
    for code, names in twice.items():
        where = " and ".join(f"{name}{f' ({n} times)' if n > 1 else ''}" for name, n in Counter(names).items())
        notes.append(f"the field sheet lists code {code} on {where}: its observations are rejected")
    return np.isin(rows.code, list(twice)) & (rows.code > 0), notes
