"""The table of observations as it enters: first its columns, then what its numbers mean. Nothing behind asks again.

Anybody may write such a table, so every sentence names the file, the row with what it is about, the column, its value
and what to do. Rows that were not measured carry no numbers that anything uses, and are asked for their columns alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testfield.detect.table_file import FLOATS, INTEGERS, MAY_BE_EMPTY, TEXTS, Table, open_table
from testfield.errors import TestfieldError
from testfield.targets.field import Field

MEASURED = "measured"
BESIDE = 0.1
"""Part of the image's size by which an observation may lie outside it."""
LEAST_U_PX, MOST_U_PART = 2e-4, 0.1
"""Standard uncertainties below the first in px, or above the second of the image's width, are in another unit."""
LEAST_SPAN, ENOUGH = 0.05, 20
"""Observations, from so many on, that all lie within this part of the image are in another unit."""
NOT_DEFINITE = 1e-12


def read_table(path: Path, field: Field | None, size_px: tuple[int, int] | None) -> tuple[dict[str, Any], dict]:
    """Columns by name as arrays, and what goes with the table: its `stations` and `centre_of_disc`.

    `field` and `size_px` (width, height), where given, say what can be. Raises `TestfieldError` for what cannot.
    """
    table = open_table(path)
    column = _columns(table, {})
    discs = _discs(table)
    named = list(dict.fromkeys(column["station"].tolist()))
    stations = table.notes["stations"].split("\n") if "stations" in table.notes else named
    extra = {"stations": tuple(stations), "centre_of_disc": discs} | _imaging(table.notes, len(stations), path)
    rows = _Rows(table, column, discs, field, size_px)
    complaint = next(_stations(rows, stations), None) or next(_meaning(rows), None)
    if complaint:
        raise complaint
    return column, extra


def read_of_one_image(path: Path, station: str, field: Field, size_px: tuple[int, int], most: int) -> dict[str, Any]:
    """Columns by name of a table of one image, of which may be left out what can be told: the station, the status of
    what is measured, the board of a sheet that has one, the number that a row does not carry. Without columns code
    and point all rows are of marks that nobody named: code 0, board and point -1.

    Raises `TestfieldError` as `read_table` does, and for more than `most` rows.
    """
    table = open_table(path)
    if len(table) > most:
        raise TestfieldError(f"{len(table):,} rows are more than one image has targets", str(path), f"write {most:,}")
    column = _columns(table, {"station": station, "status": MEASURED, "code": 0, "board": -1, "point": -1})
    if table.missing(("board",)) and len(field.boards) == 1:
        column["board"] = np.where(column["point"] >= 0, 0, -1)
    rows = _Rows(table, column, True, field, size_px)
    complaint = next(_stations(rows, [station]), None) or next(_meaning(rows), None)
    if complaint:
        raise complaint
    return column


def _columns(table: Table, told: dict[str, Any]) -> dict[str, Any]:
    """All columns as arrays; those that are told are filled in where they are missing."""
    missing = [name for name in table.missing((*FLOATS, *INTEGERS, *TEXTS)) if name not in (*MAY_BE_EMPTY, *told)]
    if missing:
        s = "s" if len(missing) > 1 else ""
        raise TestfieldError(
            f"the table has no column{s} {', '.join(missing)}",
            str(table.path),
            "write all columns of an observations file (FORMATS.md); covariances, moments and chi2 may be left out",
        )
    return {
        name: np.full(len(table), told[name], object if name in TEXTS else int)
        if name in told and table.missing((name,))
        else table.column(name)
        for name in (*FLOATS, *INTEGERS, *TEXTS)
    }


def _discs(table: Table) -> bool:
    """Whether places of dots are centres of their images: a text file has no metadata, and means those."""
    said = table.notes.get("centre_of_disc", "True" if table.lines else None)
    if said not in ("True", "False"):
        raise TestfieldError(
            f"the table's metadata says centre_of_disc = {said!r}",
            str(table.path),
            "write True where x_px, y_px are centres of dots' images, False where they are projections of centres",
        )
    return said == "True"


def positive_definite(matrices: np.ndarray) -> np.ndarray:
    """(n,) which of the symmetric matrices (n, 2, 2) are finite and positive definite beyond rounding."""
    with np.errstate(all="ignore"):
        xx, xy, yy = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
        definite = (xx > 0) & (yy > 0) & (xx * yy - xy**2 > NOT_DEFINITE * xx * yy)
    return np.asarray(definite & np.isfinite(matrices).all(axis=(1, 2)))


def _imaging(notes: dict[str, str], images: int, path: Path) -> dict[str, tuple]:
    """Camera, place and time of every image, as far as the table says."""
    said: dict[str, tuple] = {}
    for name in ("cameras", "places", "times"):
        values = notes[name].split("\n") if name in notes else []
        if values and len(values) != images:
            raise TestfieldError(
                f"the metadata `{name}` has {len(values)} lines, and there are {images} images",
                str(path),
                "give one line for each image of the metadata `stations`",
            )
        if name == "times" and not all(value.isdecimal() for value in values):
            raise TestfieldError("the metadata `times` holds what is no number", str(path), "number the times from 0")
        said[name] = tuple(map(int, values)) if name == "times" else tuple(values)
    return said


@dataclass(frozen=True)
class _Rows:
    table: Table
    column: dict[str, Any]
    discs: bool
    field: Field | None
    size_px: tuple[int, int] | None

    @property
    def path(self) -> Path:
        return self.table.path

    @property
    def measured(self) -> np.ndarray:
        return np.asarray(self.column["status"] == MEASURED)

    def states(self, stem: str) -> np.ndarray:
        """(n,) which measured rows state anything of a matrix: three numbers that are NaN, or zero, state nothing."""
        three = np.stack([self.column[f"{stem}_{part}_px2"] for part in ("xx", "xy", "yy")])
        nothing = np.isnan(three).all(axis=0) | (three == 0).all(axis=0)
        return np.asarray(self.measured & ~nothing)

    def wrong(self, bad: np.ndarray, column: str, why: str, do: str) -> Iterator[TestfieldError]:
        """The complaint about the first of the rows in a mask, if there is one."""
        if not bad.any():
            return
        k = int(np.argmax(bad))
        key = ", ".join(f"{name} {self.column[name][k]}" for name in ("station", "board", "point", "code"))
        more = f" (and {int(bad.sum()) - 1} more rows)" if bad.sum() > 1 else ""
        value = self.column[column][k]
        value = value.item() if isinstance(value, np.generic) else value
        said = f"{value:g}" if isinstance(value, float) else f"{value!r}"
        yield TestfieldError(f"{self.table.place(k)} ({key}), {column} = {said}: {why}{more}", str(self.path), do)


def _stations(rows: _Rows, stations: list[str]) -> Iterator[TestfieldError]:
    names = rows.column["station"]
    yield from rows.wrong(
        np.array([not name.strip() or "\n" in name for name in names], bool),
        "station",
        "a station needs a name of one line",
        "name the image",
    )
    yield from rows.wrong(
        ~np.isin(names.astype(str), stations),
        "station",
        "the table's metadata does not list it",
        "list every station in the metadata `stations`, one a line, or leave the list out",
    )
    twice = sorted({name for name in stations if stations.count(name) > 1})
    if twice:
        yield TestfieldError(f"station '{twice[0]}' is listed twice in the metadata", str(rows.path), "list it once")


def _meaning(rows: _Rows) -> Iterator[TestfieldError]:
    """Complaints about measured rows, the plainest first."""
    for name in FLOATS[:-1]:
        stem = name.partition("_")[0]
        if stem == "moment" and not rows.discs:
            continue
        asked = rows.states(stem) if name in MAY_BE_EMPTY else rows.measured
        yield from rows.wrong(
            asked & ~np.isfinite(rows.column[name]), name, "not a finite number", "write a number, or another status"
        )
    yield from _definite(rows, "cov", "the covariance is not positive definite", "state the covariance in px^2")
    if rows.discs:
        yield from _definite(
            rows,
            "moment",
            "the second moments are not those of a disc",
            "write a quarter of the squared half-axes in px^2, or centre_of_disc = False in the metadata",
        )
    yield from _numbers(rows)
    if rows.size_px is not None:
        yield from _units(rows, *rows.size_px)


def _definite(rows: _Rows, stem: str, why: str, do: str) -> Iterator[TestfieldError]:
    xx, xy, yy = (rows.column[f"{stem}_{part}_px2"] for part in ("xx", "xy", "yy"))
    stated = rows.states(stem)
    for values, part in ((xx, "xx"), (yy, "yy")):
        yield from rows.wrong(stated & (values <= 0), f"{stem}_{part}_px2", why, do)
    with np.errstate(all="ignore"):
        beyond = xx * yy - xy**2 <= NOT_DEFINITE * xx * yy
    yield from rows.wrong(stated & beyond, f"{stem}_xy_px2", why, do)


def _numbers(rows: _Rows) -> Iterator[TestfieldError]:
    good, code, board, point = rows.measured, *(rows.column[name] for name in INTEGERS)
    yield from rows.wrong(good & (code < 0), "code", "no code has such a number", "write 0 for a dot without a code")
    yield from rows.wrong(good & (board < -1), "board", "no board has such a number", "write -1 for no board")
    on = good & (board >= 0)
    yield from rows.wrong(on & (point < 0), "point", "a mark of a board needs its number there", "count from 0")
    if rows.field is None:
        return
    boards = rows.field.boards
    yield from rows.wrong(
        on & (board >= len(boards)),
        "board",
        f"the field sheet lists {len(boards)} board(s), numbered from 0",
        "number the boards as the sheet does",
    )
    for b, sheet in enumerate(boards):
        here = on & (board == b)
        yield from rows.wrong(
            here & (point >= len(sheet.marks)),
            "point",
            f"the field sheet lists {len(sheet.marks)} marks of board '{sheet.name}', numbered from 0",
            "number the marks as the sheet does",
        )
        listed = sheet.marks.code[np.where(here, point, 0)] if len(sheet.marks) else code
        yield from rows.wrong(
            here & (code > 0) & (code != listed),
            "code",
            f"the field sheet gives another code to this point of board '{sheet.name}'",
            "give the point that carries the code, or code 0",
        )


def _units(rows: _Rows, width: int, height: int) -> Iterator[TestfieldError]:
    good = rows.measured
    if not good.any():
        return
    for name, size in (("x_px", width), ("y_px", height)):
        values = rows.column[name]
        if good.sum() >= ENOUGH and np.ptp(values[good]) < LEAST_SPAN * size:
            yield from rows.wrong(
                good,
                name,
                f"all observations lie between {values[good].min():g} and {values[good].max():g}, and the image has "
                f"{size} px: they look normalised, or in mm",
                "write px from the centre of the top-left pixel",
            )
        outside = (values < -0.5 - BESIDE * size) | (values > size - 0.5 + BESIDE * size)
        yield from rows.wrong(
            good & outside,
            name,
            f"far outside the image of {width} x {height} px",
            "write px from the centre of the top-left pixel, x to the right",
        )
    for name in ("cov_xx_px2", "cov_yy_px2"):
        stated = rows.states("cov")
        u = float(np.sqrt(np.median(rows.column[name][stated]))) if stated.any() else LEAST_U_PX
        if not LEAST_U_PX <= u <= MOST_U_PART * width:
            yield from rows.wrong(
                stated,
                name,
                f"half of the observations claim to be known better or worse than {u:.2g} px",
                "state the covariance in px^2",
            )
