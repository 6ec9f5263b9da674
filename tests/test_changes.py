"""Fields that are set for one run: in its scene, its folder's name and its record, or refused with the nearest name."""

import json
from pathlib import Path

import pytest
from conftest import SCENES

from testfield.chain.run import begin, checked, lay_out
from testfield.errors import TestfieldError, faults_in
from testfield.scene.changes import Change, folder_name
from testfield.scene.load import load_scene

QUICK = SCENES / "quick.toml"


def test_values_are_set_by_field_name_and_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    texts = ("camera.focal_length_mm=8.5", "boards.B.bow_mm=2", "stations.1.count = 3", "measure.centroid=star")
    changes = tuple(map(Change.parse, texts))
    run, content, warnings = checked(QUICK, None, None, 1, changes=changes)
    lay_out(run, content, warnings)
    scene = load_scene(run.folder / "scene.toml")
    assert scene.camera.focal_length_mm == 8.5
    assert [board.bow_mm for board in scene.boards] == [0, 2, 0]
    assert len(run.world.station_name) == 7
    assert scene.measure.centroid == "star"
    assert run.folder.name.startswith("quick-")
    assert json.loads((run.folder / "run.json").read_text())["notes"]["changes"][1] == "boards.B.bow_mm=2"


def test_a_folder_is_named_after_what_was_set() -> None:
    assert folder_name([Change("camera.k1", -0.1)]) == "-camera.k1=-0.1"
    assert folder_name([]) == ""
    assert len(folder_name([Change("description", "x" * 500)])) < 40


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("camera.focal_lenght_mm=35", ("--set camera.focal_lenght_mm=35", "did you mean 'focal_length_mm'")),
        ("camra.k1=1", ("--set camra.k1=1", "did you mean 'camera'")),
        ("boards.D.bow_mm=2", ("--set boards.D.bow_mm=2", "no entry 'D'", "A")),
        ("scale_bars.controlbar.length_mm=2", ("did you mean 'control bar'",)),
        ("boards.9.bow_mm=2", ("no entry '9'",)),
        ("name.first=2", ("--set name.first=2", "no such place")),
        ("camera.k1=large", ('--set camera.k1="large"', "a number is wanted")),
        ("camera.k1", ("FIELD=VALUE",)),
        ("camera.=3", ("FIELD=VALUE",)),
        ("boards=[", ("not valid TOML",)),
    ],
)
def test_what_cannot_be_set_is_refused_by_its_option(text: str, words: tuple[str, ...]) -> None:
    with pytest.raises(TestfieldError) as refused:
        checked(QUICK, None, None, 1, changes=(Change.parse(text),))
    said = " ".join(fault.sentence() for fault in faults_in(refused.value))
    assert all(word in said for word in words), said


def test_all_that_cannot_be_set_is_said_at_once() -> None:
    wrong = (Change("boards.D.bow_mm", 1), Change("scale_bars.9.length_mm", 1))
    with pytest.raises(TestfieldError) as refused:
        checked(QUICK, None, None, 1, changes=wrong)
    assert len(faults_in(refused.value)) == 2


def test_another_seed_is_no_other_scene(tmp_path: Path) -> None:
    run, _ = begin(QUICK, tmp_path / "run", 11, 1)
    assert load_scene(run.folder / "scene.toml").seed == 11
