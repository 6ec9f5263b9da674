"""The table of observations as it enters: first its columns, then what its numbers mean. Nothing behind asks again.

Anybody may write such a table, so every sentence names the file, the row with what it is about, the column, its value
and what to do. Rows that were not measured carry no numbers that anything uses, and are asked for their columns alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError
from testfield.store.sheets import notes_of
from testfield.targets.field import Field

FLOATS = (
    "x_px",
    "y_px",
    "cov_xx_px2",
    "cov_xy_px2",
    "cov_yy_px2",
    "moment_xx_px2",
    "moment_xy_px2",
    "moment_yy_px2",
    "chi2",
)
INTEGERS = ("code", "board", "point")
TEXTS = ("station", "status")
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
    table = _opened(path)
    column = {name: _column(table, name, path) for name in (*FLOATS, *INTEGERS, *TEXTS)}
    notes = notes_of(table)
    if notes.get("centre_of_disc") not in ("True", "False"):
        raise TestfieldError(
            f"the table's metadata says centre_of_disc = {notes.get('centre_of_disc')!r}",
            str(path),
            "write True where x_px, y_px are centres of dots' images, False where they are projections of centres",
        )
    named = list(dict.fromkeys(column["station"].tolist()))
    stations = notes["stations"].split("\n") if "stations" in notes else named
    discs = notes["centre_of_disc"] == "True"
    extra = {"stations": tuple(stations), "centre_of_disc": discs} | _imaging(notes, len(stations), path)
    rows = _Rows(path, column, discs, field, size_px)
    complaint = next(_stations(rows, stations), None) or next(_meaning(rows), None)
    if complaint:
        raise complaint
    return column, extra


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
    path: Path
    column: dict[str, Any]
    discs: bool
    field: Field | None
    size_px: tuple[int, int] | None

    @property
    def measured(self) -> np.ndarray:
        return np.asarray(self.column["status"] == MEASURED)

    def wrong(self, bad: np.ndarray, column: str, why: str, do: str) -> Iterator[TestfieldError]:
        """The complaint about the first of the rows in a mask, if there is one."""
        if not bad.any():
            return
        k = int(np.argmax(bad))
        key = ", ".join(f"{name} {self.column[name][k]}" for name in ("station", "board", "point", "code"))
        more = f" (and {int(bad.sum()) - 1} more rows)" if bad.sum() > 1 else ""
        value = self.column[column][k]
        said = f"{value:g}" if isinstance(value, float) else f"{value!r}"
        yield TestfieldError(f"row {k} ({key}), {column} = {said}: {why}{more}", str(self.path), do)


def _opened(path: Path) -> Any:
    import pyarrow.parquet as pq

    try:
        return pq.read_table(path)
    except FileNotFoundError:
        raise TestfieldError("there is no such file", str(path), "run `testfield detect` first") from None
    except (OSError, ValueError, KeyError) as error:  # Arrow's own errors are among these
        reason = " ".join(f"{error}".split())[:120]
        raise TestfieldError(f"not a readable observations file ({reason})", str(path), "make it again") from error


def _column(table: Any, name: str, path: Path) -> np.ndarray:
    import pyarrow as pa

    if name not in table.column_names:
        raise TestfieldError(f"the table has no column {name}", str(path), "write all columns of an observations file")
    wanted = pa.string() if name in TEXTS else pa.int64() if name in INTEGERS else pa.float64()
    column = table[name]
    is_text = pa.types.is_string(column.type) or pa.types.is_large_string(column.type)
    is_text |= pa.types.is_dictionary(column.type)
    is_number = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    try:
        if not (is_text if name in TEXTS else is_number):
            raise pa.ArrowInvalid(f"it holds {column.type}")
        column = column.cast(wanted)
        values = column.to_numpy()
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:100]
        raise TestfieldError(
            f"column {name} is {column.type} and cannot be read as {wanted} ({reason})", str(path), "write it as that"
        ) from error
    if column.null_count:
        k = column.is_null().to_pylist().index(True)
        raise TestfieldError(f"row {k}, {name} is empty", str(path), "write a value, or leave the row out")
    return np.asarray(values.astype(object) if name in TEXTS else values)


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
    good, column = rows.measured, rows.column
    for name in FLOATS[:-1]:
        if name.startswith("moment") and not rows.discs:
            continue
        yield from rows.wrong(
            good & ~np.isfinite(column[name]), name, "not a finite number", "write a number, or another status"
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
    for values, part in ((xx, "xx"), (yy, "yy")):
        yield from rows.wrong(rows.measured & (values <= 0), f"{stem}_{part}_px2", why, do)
    with np.errstate(all="ignore"):
        beyond = xx * yy - xy**2 <= NOT_DEFINITE * xx * yy
    yield from rows.wrong(rows.measured & beyond, f"{stem}_xy_px2", why, do)


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
        u = float(np.sqrt(np.median(rows.column[name][good])))
        if not LEAST_U_PX <= u <= MOST_U_PART * width:
            yield from rows.wrong(
                good,
                name,
                f"half of the observations claim to be known better or worse than {u:.2g} px",
                "state the covariance in px^2",
            )
