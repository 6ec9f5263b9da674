"""What anybody else writes is read as they meant it, or refused with its row, column and value."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.detect.centres_file import read_centres
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

SIZE = (1000, 800)
POINTS = 30


def good() -> dict:
    """A table of two images of one board, as columns."""
    n = 2 * POINTS
    rng = np.random.default_rng(0)
    point = np.tile(np.arange(POINTS), 2)
    return {
        "station": np.repeat(["left", "right"], POINTS).astype(object),
        "x_px": rng.uniform(0, 999, n),
        "y_px": rng.uniform(0, 799, n),
        "cov_xx_px2": np.full(n, 9e-4),
        "cov_xy_px2": np.zeros(n),
        "cov_yy_px2": np.full(n, 9e-4),
        "moment_xx_px2": np.full(n, 9.0),
        "moment_xy_px2": np.zeros(n),
        "moment_yy_px2": np.full(n, 9.0),
        "code": np.where(point < 8, point + 1, 0),
        "board": np.zeros(n, int),
        "point": point,
        "chi2": np.ones(n),
        "status": np.full(n, MEASURED, object),
    }


def sheet() -> Field:
    codes = np.where(np.arange(POINTS) < 8, np.arange(POINTS) + 1, 0)
    return Field(14, (NominalBoard("A", Marks(np.zeros((POINTS, 2)), np.full(POINTS, 9.0), codes), 0, 0),))


def write(columns: dict, path: Path, notes: dict | None = None) -> Path:
    notes = {"stations": "left\nright", "centre_of_disc": "True"} if notes is None else notes
    pq.write_table(pa.table(columns).replace_schema_metadata(notes), path)
    return path


def at(name: str, row: int, value: object) -> Callable[[dict], None]:
    def change(columns: dict) -> None:
        columns[name] = columns[name].copy()
        columns[name][row] = value

    return change


def all_of(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict], None]:
    return lambda columns: columns.update({name: change(columns[name])})


def both(*changes: Callable[[dict], None]) -> Callable[[dict], None]:
    return lambda columns: [change(columns) for change in changes] and None


BAD = {
    "covariance zero": (at("cov_xx_px2", 7, 0.0), "row 7", "cov_xx_px2"),
    "covariance negative": (at("cov_yy_px2", 7, -1e-4), "row 7", "cov_yy_px2"),
    "covariance not definite": (at("cov_xy_px2", 7, 1e-3), "row 7", "cov_xy_px2"),
    "covariance NaN": (at("cov_xy_px2", 7, np.nan), "row 7", "cov_xy_px2"),
    "covariance in mm^2": (
        both(*(all_of(f"cov_{part}_px2", lambda v: v * 1e-6) for part in ("xx", "xy", "yy"))),
        "row 0",
        "cov_xx_px2",
    ),
    "position infinite": (at("x_px", 31, np.inf), "row 31", "x_px"),
    "position far outside": (at("y_px", 31, 4000.0), "row 31", "y_px"),
    "positions normalised": (all_of("x_px", lambda v: v / 1000), "row 0", "x_px"),
    "positions in mm": (all_of("y_px", lambda v: (v - 400) * 0.005), "row 0", "y_px"),
    "no such board": (at("board", 3, 1), "row 3", "board"),
    "board below -1": (at("board", 3, -2), "row 3", "board"),
    "no such point": (at("point", 3, POINTS), "row 3", "point"),
    "point -1": (at("point", 3, -1), "row 3", "point"),
    "another point's code": (at("code", 3, 5), "row 3", "code"),
    "moment NaN": (at("moment_xx_px2", 5, np.nan), "row 5", "moment_xx_px2"),
    "moment zero": (at("moment_yy_px2", 5, 0.0), "row 5", "moment_yy_px2"),
    "station empty": (at("station", 9, ""), "row 9", "station"),
    "station not listed": (at("station", 9, "middle"), "row 9", "station"),
    "point half": (all_of("point", lambda v: v + 0.5), "point", "int64"),
    "position as text": (all_of("x_px", lambda v: v.astype(str).astype(object)), "x_px", "double"),
    "status as number": (all_of("status", lambda v: np.zeros(len(v))), "status", "string"),
    "column missing": (lambda columns: columns.pop("code") is None or None, "code", "column"),
    "value missing": (at("station", 9, None), "row 9", "station"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_number_that_cannot_be_is_named_with_file_row_and_column(name: str, tmp_path: Path) -> None:
    change, *words = BAD[name]
    columns = good()
    change(columns)
    path = write(columns, tmp_path / "peer.parquet")
    with pytest.raises(TestfieldError) as error:
        Observations.load(path, sheet(), SIZE)
    for word in ("peer.parquet", *words):
        assert word in str(error.value)


def test_what_a_peer_may_leave_out_is_read(tmp_path: Path) -> None:
    columns = good()
    columns["moment_xx_px2"] = np.full(2 * POINTS, np.nan)  # no discs, no moments
    columns["point"] = columns["point"].astype(float)
    columns["x_px"] = columns["x_px"].astype(np.float32)
    columns["cov_xx_px2"][4], columns["status"][4] = 0.0, "too small"  # not measured: nobody uses it
    found = Observations.load(write(columns, tmp_path / "p.parquet", {"centre_of_disc": "False"}), sheet(), SIZE)
    assert found.stations == ("left", "right")
    assert not found.centre_of_disc
    assert len(found.measured) == 2 * POINTS - 1


def test_a_file_without_its_meaning_or_that_is_no_table_is_named(tmp_path: Path) -> None:
    path = write(good(), tmp_path / "p.parquet", {})
    with pytest.raises(TestfieldError, match="centre_of_disc"):
        Observations.load(path)
    damaged = bytearray(path.read_bytes())
    damaged[4] ^= 0xFF
    path.write_bytes(damaged)
    with pytest.raises(TestfieldError, match=r"p\.parquet"):
        Observations.load(path)


def _twice(columns: dict, name: str, path: Path) -> Path:
    """A table with one column twice, whose second says something else."""
    table = pa.table(columns)
    table = table.append_column(name, pa.array(np.asarray(columns[name]) + 1))
    if path.suffix == ".csv":
        csv.write_csv(table, path)
    else:
        pq.write_table(table.replace_schema_metadata({"centre_of_disc": "True"}), path)
    return path


@pytest.mark.parametrize("name", ["p.csv", "p.parquet"])
def test_a_column_that_occurs_twice_is_named_with_its_file(name: str, tmp_path: Path) -> None:
    path = _twice(good(), "x_px", tmp_path / name)
    for read in (Observations.load, lambda path: read_centres(path, "left", sheet(), SIZE)):
        with pytest.raises(TestfieldError, match=f"{name}.*x_px occurs"):
            read(path)
    points = {"code": [1], **{f"{axis}_mm": [0.0] for axis in "xyz"}}
    points |= {"rays": [2], "residual_rms_px": [0.0], "rejected": [0]}
    with pytest.raises(TestfieldError, match=f"{name}.*'y_mm' occurs"):
        Points.load(_twice(points, "y_mm", tmp_path / name))


def calibration() -> dict:
    labels = ["fx", *(f"station:left.{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz"))]
    found = Calibration(
        method="peer",
        interior=Interior(1000, 800, np.array([900, 900, 500, 400, 0, 0, 0, 0, 0.0])),
        station_names=("left",),
        stations=Poses.identity(1),
        board_names=(),
        boards=Poses.identity(0),
        scale=1.0,
        covariance=np.eye(7),
        labels=tuple(labels),
        sigma0=1.0,
        freedom=10,
        reprojection_rms_px=0.05,
        used=30,
    )
    return found, found.labels


def _set(key: str, value: object) -> Callable[[dict], None]:
    return lambda tree: tree.update({key: value})


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (_set("station_names", ["photo"]), "station:left"),
        (_set("station_names", ["left", "right"]), "stations"),
        (_set("covariance", np.eye(6).tolist()), "covariance"),
        (_set("covariance", (-np.eye(7)).tolist()), "covariance"),
        (_set("scale", float("nan")), "scale"),
        (lambda tree: tree["stations"][0].update(R=(2 * np.eye(3)).tolist()), "stations"),
        (lambda tree: tree["interior"].update(fx=-900.0), "interior"),
        (lambda tree: tree.pop("labels"), "labels"),
    ],
)
def test_a_calibration_that_cannot_be_is_named(change: Callable[[dict], None], word: str, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    calibration()[0].save(path)
    Calibration.load(path)
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))
    with pytest.raises(TestfieldError) as error:
        Calibration.load(path)
    assert word in str(error.value)
    assert "calibration.json" in str(error.value)
