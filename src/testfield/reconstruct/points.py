"""Reconstructed points with their full covariance."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import speaking
from testfield.store.sheets import FORMAT, LARGEST_MM, covariance, read_columns, unique

MOST_POINTS = 10_000
"""Rows that a CSV file may have: the joint covariance of more has no room."""


@dataclass(frozen=True)
class Points:
    """n targets in the datum frame (that of the first board).

    `code` (n,); `xyz_mm` (n, 3); `cov_xyz_mm2` (3n, 3n) over all points together, since they share cameras, NaN where
    none is stated;
    `rays` (n,) number of stations; `residual_rms_px` (n,); `rejected` (n,) rays turned down.
    """

    method: str
    code: np.ndarray
    xyz_mm: np.ndarray
    cov_xyz_mm2: np.ndarray
    rays: np.ndarray
    residual_rms_px: np.ndarray
    rejected: np.ndarray

    def __len__(self) -> int:
        return len(self.code)

    @property
    def states_u(self) -> bool:
        """Whether a covariance is stated: one that is finite, with a variance of every coordinate."""
        return bool(np.isfinite(self.cov_xyz_mm2).all() and (np.diag(self.cov_xyz_mm2) > 0).all())

    def rows(self, codes: list[int]) -> np.ndarray:
        """Places of codes among the points."""
        place = {int(code): k for k, code in enumerate(self.code)}
        return np.array([place[code] for code in codes], int)

    def covariance_of(self, rows: np.ndarray) -> np.ndarray:
        """(3k, 3k) joint covariance of some points."""
        index = (3 * np.asarray(rows)[:, None] + np.arange(3)).ravel()
        return self.cov_xyz_mm2[np.ix_(index, index)]

    def distance(self, a: int, b: int) -> tuple[float, float]:
        """Distance in mm of the points in rows a and b, and its standard uncertainty (METHODS section 1.6), NaN where
        none is stated."""
        d = self.xyz_mm[a] - self.xyz_mm[b]
        length = float(np.linalg.norm(d))
        direction = np.concatenate([d, -d]) / length
        return length, float(np.sqrt(direction @ self.covariance_of(np.array([a, b])) @ direction))

    def save(self, path: Path) -> None:
        """Write as Parquet, one row a point; `cov_rows` holds the point's three rows of the full covariance."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        n = len(self)
        u = np.sqrt(np.diag(self.cov_xyz_mm2)).reshape(n, 3)
        columns = {
            "code": self.code,
            **{f"{axis}_mm": self.xyz_mm[:, k] for k, axis in enumerate("xyz")},
            **{f"u_{axis}_mm": u[:, k] for k, axis in enumerate("xyz")},
            "rays": self.rays,
            "residual_rms_px": self.residual_rms_px,
            "rejected": self.rejected,
            "cov_rows_mm2": list(self.cov_xyz_mm2.reshape(n, 9 * n)),
        }
        pq.write_table(pa.table(columns).replace_schema_metadata({"format": str(FORMAT), "method": self.method}), path)

    @staticmethod
    @speaking("points")
    def load(path: Path, most: int = MOST_POINTS) -> "Points":
        """Read what `save` wrote, or a CSV file with code, x_mm, y_mm, z_mm, and u_x_mm, u_y_mm, u_z_mm where they are
        known, of `most` rows. Raises `TestfieldError` where columns, shapes or numbers are not such."""
        if path.suffix.lower() == ".csv":
            return _from_csv(path, most)
        column, notes = read_columns(path, COLUMNS)
        n = len(column["code"])
        unique(column["code"].tolist(), "code")
        xyz = np.column_stack([column[f"{axis}_mm"] for axis in "xyz"])
        if np.abs(xyz).max(initial=0) > LARGEST_MM:
            raise ValueError(f"coordinates are beyond {LARGEST_MM:g} mm")
        return Points(
            method=notes["method"],
            code=column["code"],
            xyz_mm=xyz,
            cov_xyz_mm2=_covariance(column.get("cov_rows_mm2"), n),
            rays=column["rays"],
            residual_rms_px=column["residual_rms_px"],
            rejected=column["rejected"],
        )


COLUMNS = {
    "code": "i",
    "x_mm": "f",
    "y_mm": "f",
    "z_mm": "f",
    "rays": "i",
    "residual_rms_px": "n",
    "rejected": "i",
    "cov_rows_mm2": "?",
}


def _from_csv(path: Path, most: int) -> Points:
    from pyarrow import csv

    # An empty line is a row: lines are counted as a person's editor does.
    table = csv.read_csv(path, csv.ReadOptions(use_threads=False), csv.ParseOptions(ignore_empty_lines=False))
    unique(table.column_names, "column")
    if missing := [name for name in ("code", "x_mm", "y_mm", "z_mm") if name not in table.column_names]:
        raise ValueError(f"there is no column {', '.join(missing)}")
    n = table.num_rows
    if n > most:
        raise ValueError(f"{n:,} rows are more than the {most:,} points that there can be")
    code = _numbers(table, "code", least=None)
    if (code != np.rint(code)).any():
        raise ValueError(f"line {int(np.argmax(code != np.rint(code))) + 2}, code is no whole number")
    unique(code.astype(int).tolist(), "code")
    xyz = np.column_stack([_numbers(table, f"{axis}_mm", least=None) for axis in "xyz"]).reshape(n, 3)
    cov = np.full((3 * n, 3 * n), np.nan)
    if all(f"u_{axis}_mm" in table.column_names for axis in "xyz"):
        u = np.column_stack([_numbers(table, f"u_{axis}_mm", least=0.0) for axis in "xyz"])
        cov = np.diag(u.ravel() ** 2)
    return Points(path.stem, code.astype(int), xyz, cov, np.zeros(n, int), np.full(n, np.nan), np.zeros(n, int))


def _numbers(table: Any, name: str, least: float | None) -> np.ndarray:
    """(n,) finite numbers of a column, none beyond all size nor below `least`; a wrong one is named with its line."""
    found = np.full(table.num_rows, np.nan)
    for k, value in enumerate(table[name].to_pylist()):
        try:
            found[k] = float(value) if value is not None and not isinstance(value, bool) else np.nan
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"line {k + 2}, {name} = {str(value)[:40]!r}: no number") from None
        if not abs(found[k]) <= LARGEST_MM or (least is not None and found[k] < least):
            raise ValueError(f"line {k + 2}, {name} = {found[k]:g}: no number that can be")
    return found


def _covariance(rows: list[np.ndarray] | None, n: int) -> np.ndarray:
    """(3n, 3n) of the points' rows; NaN where they say nothing, or nothing but NaN or zero."""
    if rows is None:
        return np.full((3 * n, 3 * n), np.nan)
    if any(len(row) != 9 * n for row in rows):
        raise ValueError("column 'cov_rows_mm2' does not hold three rows of the covariance")
    found = np.concatenate([np.zeros(0), *rows]).reshape(3 * n, 3 * n)
    if np.isnan(found).all() or not found.any():
        return np.full((3 * n, 3 * n), np.nan)
    return covariance(found, "cov_rows_mm2", 3 * n)
