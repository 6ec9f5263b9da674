"""Files of a run that are damaged or edited are named where they are read, and never end in a traceback."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Radiance, load_sheet
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.photographs import EMPTY
from testfield.reconstruct.points import Points
from testfield.score.scorecard import load_scorecard
from testfield.targets.field import Field

Change = Callable[[dict[str, Any]], Any]

EDITS: list[tuple[str, Callable[[Path], Any], str, Change]] = [
    ("calibration.json", Calibration.load, "a station renamed", lambda t: t["station_names"].__setitem__(0, "photo")),
    ("calibration.json", Calibration.load, "a board renamed", lambda t: t["board_names"].__setitem__(1, "photo")),
    ("calibration.json", Calibration.load, "an unknown twice", lambda t: t["labels"].__setitem__(0, t["labels"][1])),
    ("calibration.json", Calibration.load, "a row less", lambda t: t["covariance"].pop()),
    ("calibration.json", Calibration.load, "not finite", lambda t: t["covariance"][0].__setitem__(0, float("nan"))),
    ("calibration.json", Calibration.load, "below zero", lambda t: t["covariance"][0].__setitem__(0, -1.0)),
    ("calibration.json", Calibration.load, "no rotation", lambda t: t["stations"][0]["R"][0].__setitem__(0, 3.0)),
    ("calibration.json", Calibration.load, "no focal length", lambda t: t["interior"].update(fx=0)),
    ("calibration.json", Calibration.load, "no lens", lambda t: t["interior"].update(model="x")),
    ("calibration.json", Calibration.load, "a later format", lambda t: t.update(format=99)),
    ("calibration.json", Calibration.load, "text for a number", lambda t: t.update(scale="one")),
    ("calibration.json", Calibration.load, "a part less", lambda t: t.pop("labels")),
    ("field.json", Field.load, "a diameter as text", lambda t: t["loose_diameter_mm"].update({"201": "wide"})),
    ("field.json", Field.load, "an infinite place", lambda t: t["boards"][0]["x_mm"].__setitem__(0, float("inf"))),
    ("field.json", Field.load, "a place less", lambda t: t["boards"][0]["x_mm"].pop()),
    ("field.json", Field.load, "a name twice", lambda t: t["boards"][0].update(name=t["boards"][1]["name"])),
    ("scorecard.json", load_scorecard, "a figure less", lambda t: t["detection"].pop("centre_rms_px")),
    ("scorecard.json", load_scorecard, "text for a figure", lambda t: t["points"].update(rmse_mm="good")),
    ("scorecard.json", load_scorecard, "a section less", lambda t: t.pop("lengths")),
    ("frames/station01.json", load_sheet, "no balance", lambda t: t.update(balance=[])),
    ("frames/station01.json", load_sheet, "no gain", lambda t: t.update(gain_e_per_dn=0)),
    ("frames/station01.json", load_sheet, "a gain beyond all", lambda t: t.update(gain_e_per_dn=1e300)),
    ("frames/station01.json", load_sheet, "a gain of nothing", lambda t: t.update(gain_e_per_dn=1e-300)),
    ("frames/station01.json", load_sheet, "balance beyond all", lambda t: t.update(balance=[1e30])),
    ("frames/station01.json", load_sheet, "noise beyond all", lambda t: t.update(read_noise_e=1e200)),
    ("frames/station01.json", load_sheet, "many bits", lambda t: t.update(bits=10**9)),
    ("frames/station01.json", load_sheet, "another key", lambda t: t.update(other=1)),
]


@pytest.mark.parametrize("name, load, what, change", EDITS, ids=[f"{name}: {what}" for name, _, what, _ in EDITS])
def test_an_edited_file_is_named(
    name: str, load: Callable[[Path], Any], what: str, change: Change, quick: Run, tmp_path: Path
) -> None:
    path = tmp_path / Path(name).name
    shutil.copy(quick.folder / name, path)
    load(path)
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))
    with pytest.raises(TestfieldError, match=path.name):
        load(path)


@pytest.mark.parametrize("at", [4, 40, -20, -5])
def test_a_damaged_byte_of_points_is_named_or_changes_nothing_else(quick: Run, tmp_path: Path, at: int) -> None:
    path = tmp_path / "points.parquet"
    data = bytearray((quick.folder / "points.parquet").read_bytes())
    data[at] ^= 0xFF
    path.write_bytes(data)
    try:
        Points.load(path)
    except TestfieldError as error:
        assert path.name in error.sentence()


def test_columns_of_points_are_checked(quick: Run, tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(quick.folder / "points.parquet")
    n = len(table)
    path = tmp_path / "points.parquet"
    for changed in (
        table.drop_columns(["rays"]),
        table.set_column(0, "code", pa.array(["a"] * n)),
        table.set_column(0, "code", pa.array([1] * n)),
        table.set_column(1, "x_mm", pa.array([None] + [0.0] * (n - 1))),
        table.set_column(1, "x_mm", pa.array([np.inf] + [0.0] * (n - 1))),
        table.slice(0, n - 1),
        table.replace_schema_metadata({}),
        table.replace_schema_metadata({"method": "gls", "format": "99"}),
    ):
        pq.write_table(changed, path)
        with pytest.raises(TestfieldError, match=path.name):
            Points.load(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_radiance_that_is_none_is_named(value: float, tmp_path: Path) -> None:
    pixels = np.ones((8, 8), np.float32)
    radiance = Radiance("a", pixels)
    pixels[3, 3] = value
    radiance.save(tmp_path / "a.exr")
    with pytest.raises(TestfieldError, match=r"a\.exr"):
        Radiance.load(tmp_path / "a.exr")


def test_what_was_read_is_what_was_written(quick: Run, tmp_path: Path) -> None:
    for name, load in (
        ("calibration.json", Calibration.load),
        ("points.parquet", Points.load),
        ("field.json", Field.load),
    ):
        load(quick.folder / name).save(tmp_path / name)
        assert (tmp_path / name).read_bytes() == (quick.folder / name).read_bytes(), name


def test_a_frame_of_another_station_is_refused(quick: Run, tmp_path: Path) -> None:
    from testfield.camera.images import Frame

    for kind in ("png", "json"):
        shutil.copy(quick.folder / f"frames/station02.{kind}", tmp_path / f"station01.{kind}")
    with pytest.raises(TestfieldError, match="station02"):
        Frame.load(tmp_path / "station01.png", "station01")


@pytest.mark.parametrize("name", ["observations.parquet", "points.parquet"])
def test_notes_that_are_no_text_are_named_or_change_nothing(name: str, tiny: Run, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    path, load = tmp_path / name, {"observations.parquet": Observations.load, "points.parquet": Points.load}[name]
    table = pq.read_table(tiny.folder / name)
    told = dict(table.schema.metadata)
    for key in told:
        for changed in (told | {key: b"\xfe" + told[key]}, told | {b"\xc1": b"\xb7"}):
            pq.write_table(table.replace_schema_metadata(changed), path)
            try:
                load(path)
            except TestfieldError as error:
                assert name in error.sentence()


def test_points_of_which_none_is_left_are_not_accepted(
    tiny: Run, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = shutil.copytree(tiny.folder, tmp_path / "tiny")
    none = Points("gls", *(np.zeros(shape, kind) for shape, kind in EMPTY))
    none.save(folder / "points.parquet")
    assert main(["accept", str(folder), "--a-mm", "1"]) == 2
    assert "none of the" in capsys.readouterr().err
