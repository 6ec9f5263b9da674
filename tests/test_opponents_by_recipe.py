"""Opponents in environments of their own: recipes that come along are sound, and what they run does what it says."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import SCENES, TINY

from testfield.cli.main import main
from testfield.evaluate.execute import FAILURE
from testfield.scene.load import load_scene

HERE = SCENES / "reports/opponents"


def test_the_scene_of_the_opponents_is_one_of_apriltags() -> None:
    (board,) = load_scene(HERE / "tags.toml").boards
    assert board.pattern is not None and board.pattern.pattern.names == "DICT_APRILTAG_36h11"


def compared(scene: Path, recipe: str, until: str, folder: Path, capsys: pytest.CaptureFixture) -> pd.DataFrame:
    recipes = [str(HERE / f"{name}.toml") for name in ("own", recipe)]
    words = [str(scene), "--recipes", *recipes, "--until", until, "--draws", "1", "--jobs", "1"]
    status = main(["compare", *words, "--out", str(folder)])
    said = capsys.readouterr().err
    if status == 2 and "cannot be installed" in said:
        pytest.skip("no package index")
    assert status == 0, said
    rows = pd.read_parquet(folder / "results.parquet")
    rows = rows[rows.draw > 0].reset_index(drop=True)
    assert FAILURE not in rows or rows[FAILURE].isna().all(), rows[FAILURE].dropna().tolist()
    return rows


@pytest.mark.slow  # an environment is made
@pytest.mark.skipif(sys.platform != "linux", reason="the recipes name wheels for Linux")
def test_aprilgrid_finds_the_corners_under_their_names(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    own, other = compared(HERE / "tags.toml", "aprilgrid", "detect", tmp_path, capsys).to_dict("records")
    assert other["detection.found_fraction"] > 0.95 and other["detection.wrong_dot"] == 0
    assert np.median(np.hypot(other["dx_px"], other["dy_px"])) < 0.5
    assert own["detection.centre_rms_px"] < other["detection.centre_rms_px"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the recipes name wheels for Linux")
def test_ceres_reconstructs_and_states_its_uncertainty(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    own, other = compared(TINY, "ceres", "reconstruct", tmp_path, capsys).to_dict("records")
    assert other["points.measured"] == own["points.measured"] == 2 and other["points.rmse_mm"] < 0.1
    assert np.isfinite(other["points.mean_u_mm"]) and other["points.mean_u_mm"] > 0
