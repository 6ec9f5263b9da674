"""`import testfield as tf`: stable names, imported when asked for, and results that agree with the files."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import testfield as tf
from testfield.chain.run import Run
from testfield.errors import TestfieldError


def test_names_are_imported_when_asked_for() -> None:
    code = (
        "import sys, testfield as tf; before = 'numpy' in sys.modules; tf.Recipe;"
        "import testfield.score.scorecard, testfield.measure.pipeline;"
        "print(before, all(callable(getattr(tf, n)) for n in tf.__all__ if n != '__version__'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
    assert set(tf.__all__) <= set(dir(tf))
    with pytest.raises(AttributeError, match="nothing_such"):
        _ = tf.nothing_such


def test_a_finished_run_is_read_as_typed_objects(tiny: Run) -> None:
    result = tf.open_run(tiny.folder)
    assert result.scene == tiny.scene and result.field.boards[0].name == "A"
    assert [frame.station for frame in result.frames()] == list(tiny.stations)
    assert list(result.table("points")["code"]) == result.points.code.tolist()
    assert result.score.passed and result.score["points.rmse_mm"] == result.score.figures["points"]["rmse_mm"]
    assert len(result.score.ten) == 10
    with pytest.raises(TestfieldError, match="no such table"):
        result.table("truth")
    shown = result._repr_html_()
    assert all(f"<td>{value}</td>" in shown for value in result.score.ten.values())


def test_every_stable_name_has_its_page(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pdoc", "--no-show-source", "-o", str(tmp_path), "testfield.api"]
    subprocess.run(command, check=True)
    page = (tmp_path / "testfield/api.html").read_text(encoding="utf-8")
    assert all(f'id="{name}"' in page for name in tf.__all__ if name != "__version__")


def test_what_is_measured_again_scores_the_same(tiny: Run) -> None:
    result = tf.open_run(tiny.folder)
    measured = tf.measure(result.observations, result.field)
    assert np.array_equal(measured.points.xyz_mm, result.points.xyz_mm)
    again = tf.score(result.scene, measured)
    same = {key: value for key, value in again.figures.items() if key in result.score.figures}
    assert same == {key: result.score.figures[key] for key in same} and "points" in same


def test_a_scene_is_run_by_path_and_folder(tiny: Run, tmp_path: Path) -> None:
    from conftest import TINY

    folder = shutil.copytree(tiny.folder, tmp_path / "run")
    assert tf.load_scene(TINY).name == tf.run(TINY, folder).scene.name == "tiny"
    assert tf.load_scene("quick").name == "quick"
