"""A table of observations as columns: Parquet, or CSV where the file's name ends so.

What is read here is types alone; what numbers mean is asked in `observation_table.py`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError
from testfield.store.sheets import notes_of

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
MAY_BE_EMPTY = FLOATS[2:]
"""Columns that may be absent, or empty in a row: whoever does not know the uncertainty or the shape states none."""
MOST_ROWS, MOST_BYTES = 2_000_000, 1_000_000_000
"""Larger tables are no observations of anything that this project renders; a program may run wild."""


@dataclass(frozen=True)
class Table:
    """An opened table: its `path`, Arrow's `columns`, what its metadata say, and whether it is lines of text."""

    path: Path
    columns: Any
    notes: dict[str, str]
    lines: bool

    def __len__(self) -> int:
        return int(self.columns.num_rows)

    def place(self, row: int) -> str:
        """A row as a person finds it: the line of a text file, whose first line names the columns."""
        return f"line {row + 2}" if self.lines else f"row {row}"

    def missing(self, names: tuple[str, ...]) -> list[str]:
        """Those of the columns that there are not."""
        return [name for name in names if name not in self.columns.column_names]

    def column(self, name: str) -> np.ndarray:
        """A column as float64, int64 or objects. Raises `TestfieldError` where it holds what is none, or nothing."""
        import pyarrow as pa

        if name in self.missing(MAY_BE_EMPTY):
            return np.full(len(self), np.nan)
        wanted = pa.string() if name in TEXTS else pa.int64() if name in INTEGERS else pa.float64()
        column = self.columns[name]
        if pa.types.is_null(column.type) and (name in MAY_BE_EMPTY or len(self) == 0):
            column = column.cast(wanted)
        is_text = pa.types.is_string(column.type) or pa.types.is_large_string(column.type)
        is_text |= pa.types.is_dictionary(column.type)
        is_number = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
        try:
            if not (is_text if name in TEXTS else is_number):
                raise pa.ArrowInvalid(f"it holds {column.type}")
            values = column.cast(wanted).to_numpy()
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError, UnicodeDecodeError) as error:
            if self.lines and name not in TEXTS:
                self._name_the_line(name, column)
            reason = " ".join(str(error).split())[:100]
            raise TestfieldError(
                f"column {name} is {column.type} and cannot be read as {wanted} ({reason})",
                str(self.path),
                "write it as that",
            ) from error
        if column.null_count and name not in MAY_BE_EMPTY:
            k = column.is_null().to_pylist().index(True)
            raise TestfieldError(
                f"{self.place(k)}, {name} is empty{' or NaN' if self.lines else ''}",
                str(self.path),
                "write a value, or leave the row out",
            )
        return np.asarray(values.astype(object) if name in TEXTS else values)

    def _name_the_line(self, name: str, column: Any) -> None:
        kind = int if name in INTEGERS else float
        for row, value in enumerate(column.to_pylist()):
            try:
                kind(value) if not isinstance(value, float) or value.is_integer() else int("")
            except (TypeError, ValueError):
                what = "whole number" if kind is int else "number"
                raise TestfieldError(
                    f"{self.place(row)}, {name} = {str(value)[:40]!r}: no {what}", str(self.path), f"write a {what}"
                ) from None


def open_table(path: Path) -> Table:
    """Open a table. Raises `TestfieldError` where there is none, one beyond all size, or a column twice."""
    import pyarrow.parquet as pq
    from pyarrow import csv

    lines = path.suffix.lower() == ".csv"
    try:
        if path.stat().st_size > MOST_BYTES:
            raise _too_large(f"{path.stat().st_size:,} bytes", path)
        if lines:
            texts = csv.ConvertOptions(column_types=dict.fromkeys(TEXTS, "string"), strings_can_be_null=False)
            columns = csv.read_csv(path, csv.ReadOptions(use_threads=False), convert_options=texts)
            names = columns.column_names
        else:
            names = pq.read_schema(path).names
            # Arrow reads no Parquet with a name that occurs twice, and says so in a riddle.
            columns = pq.read_table(path) if len(set(names)) == len(names) else None
    except FileNotFoundError:
        raise TestfieldError("there is no such file", str(path), "run `testfield detect` first") from None
    except (OSError, ValueError, KeyError) as error:  # Arrow's own errors are among these
        reason = " ".join(f"{error}".split())[:120]
        raise TestfieldError(f"not a readable observations file ({reason})", str(path), "make it again") from error
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise TestfieldError(
            f"column {twice[0]} occurs {names.count(twice[0])} times", str(path), "write every column once"
        )
    if columns.num_rows > MOST_ROWS:
        raise _too_large(f"{columns.num_rows:,} rows", path)
    return Table(path, columns, notes_of(columns), lines)


def _too_large(size: str, path: Path) -> TestfieldError:
    return TestfieldError(f"{size} are more than any images give", str(path), f"write {MOST_ROWS:,} rows at most")
