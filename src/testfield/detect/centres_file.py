"""Centres of one image as a program, or anybody, writes them: CSV or Parquet, few columns, the rest left out."""

from pathlib import Path

import numpy as np

from testfield.detect.observation_table import MEASURED, read_of_one_image
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field

MOST_CENTRES = 100_000
"""Of one image: this project's own finder looks at half as many."""


def read_centres(path: Path, station: str, field: Field, size_px: tuple[int, int]) -> Observations:
    """Observations of one image of `size_px` (width, height) from a file (OWN_ALGORITHMS.md tells its columns).

    A row that is no measured centre has another status. Raises `TestfieldError` with line, column and value for what
    cannot be.
    """
    column = read_of_one_image(path, station, field, size_px, MOST_CENTRES)
    n = len(column["x_px"])
    other = np.flatnonzero(column["station"] != station)
    if len(other):
        raise TestfieldError(
            f"station = {column['station'][other[0]]!r}, and the file is of {station!r}", str(path), "name it so"
        )
    return Observations(
        stations=(station,),
        station=np.zeros(n, int),
        xy_px=np.column_stack([column["x_px"], column["y_px"]]),
        cov_px2=_symmetric(column, "cov"),
        moments_px2=_symmetric(column, "moment"),
        code=column["code"],
        board=column["board"],
        point=column["point"],
        chi2=column["chi2"],
        status=np.where(column["status"] == MEASURED, MEASURED, column["status"]).astype(object),
    )


def _symmetric(column: dict, stem: str) -> np.ndarray:
    """(n, 2, 2) matrices; NaN where their three numbers say nothing."""
    three = np.stack([np.asarray(column[f"{stem}_{part}_px2"], float) for part in ("xx", "xy", "yy")])
    three = np.where((three == 0).all(axis=0), np.nan, three)
    return np.moveaxis(np.stack([three[:2], three[1:]]), -1, 0)
