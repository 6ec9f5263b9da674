"""A scene written in Python is the scene in its file; what is loaded and changed keeps its comments."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from conftest import SCENES

import testfield as tf
from testfield.chain.run import checked
from testfield.errors import TestfieldError
from testfield.scene.load import load_scene

BOARD = {"kind": "ring codes 500x360", "spin_deg": 2}
LOOK = (0, 0, 560)


def cell() -> tf.Scene:
    return (
        tf.Scene("cell", seed=7)
        .volume((1800, 1200, 800))
        .camera(width_px=1280, height_px=1024, pixel_pitch_um=4.8, focal_length_mm=8.0, f_number=5.6)
        .exposure(8.0)
        .room(ambient_w_m2_sr=0.6)
        .surface("floor", (5000, 5000), (0, -1000, 0), (0, 0, 1))
        .light((300, -1300, 2600), kind="LED panel 1200x600 7200 lm", normal=(0, 0.5, -1))
        .board("A", (0, 250, 560), normal=(0.05, -1, 0.1), first_code=1, **BOARD)
        .board("B", np.array([-580, 20, 640]), normal=(0.5, -1, -0.1), first_code=11, **BOARD)
        .bar("control bar", 900.0, (101, 102), (0, 260, 960), diameter_mm=14)
        .target(211, (320, 60, 900), diameter_mm=14)
        .targets("grid", first_code=201, counts=(2, 1, 2), low_mm=(-330, -60, 330), high_mm=(330, -60, 820))
        .stations(
            tf.arc(4, 2150, 650, LOOK, azimuth_deg=(-38, 38), roll_deg=(0, 90, 180, 270)),
            tf.station((0, -2000, 1200), LOOK, name="high"),
            tf.ring(3, 400, (0, -2200, 700), LOOK),
            tf.grid((2, 1, 1), (-500, -2300, 500), (500, -2300, 500), LOOK),
            tf.scattered(2, (-500, -2500, 500), (500, -2300, 900), LOOK),
        )
        .measure(centroid="star")
    )


def test_a_scene_written_in_python_is_the_one_in_its_file(tmp_path: Path) -> None:
    scene = cell()
    path = scene.save(tmp_path / "cell.toml")
    assert load_scene(path) == scene.check()
    assert [board.name for board in scene.check().boards] == ["A", "B"]
    run, _, _ = checked(scene.described(), tmp_path / "run", None, 1)
    assert len(run.stations) == 12


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("camera.focal_lenght_mm", 9, "did you mean 'focal_length_mm'"),
        ("boards.A.bowmm", 2, "did you mean 'bow_mm'"),
        ("camera.focal_length_mm", "nine", '"nine".*number'),
        ("boards.A.size_mm", [500, -360], "-360"),
        ("name.first", 3, "no such place"),
    ],
)
def test_set_refuses_a_wrong_field_or_value_at_once_and_changes_nothing(path: str, value: object, words: str) -> None:
    for scene in (tf.Scene.load("quick"), cell(), tf.Scene("begun").board("A")):
        before = scene.text()
        with pytest.raises(TestfieldError, match=words):
            scene.set(path, value)
        assert scene.text() == before
        scene.set("boards.A.bow_mm", 2).set("camera.focal_length_mm", 9)  # what is missing elsewhere is no hindrance


def test_a_plan_needs_no_file() -> None:
    card = cell().plan()
    assert card["points"]["measured"] == 5
    assert 0 < card["points"]["u_rms_mm"] < 0.1


def test_loading_and_changing_keeps_comments(tmp_path: Path) -> None:
    source = (SCENES / "charuco.toml").read_text()
    path = tmp_path / "own.toml"
    path.write_text(source)
    scene = tf.Scene.load(path).set("camera.focal_length_mm", 9.5).board("charuco", spin_deg=3.0)
    scene.stations(tf.station((0, -500, 400), (0, 100, 320))).save()
    before, after = source.splitlines(), path.read_text().splitlines()
    changed = [line for line in before if line not in after]
    assert changed == ["focal_length_mm = 8.0", "spin_deg = 1.5"]
    assert [line for line in before if line.startswith("#")] == [line for line in after if line.startswith("#")]
    assert len(load_scene(path).stations) == len(tomllib.loads(source)["stations"]) + 1


def test_nothing_changed_is_written_byte_by_byte() -> None:
    for name in ("quick", "stitched_wall", "stereo_rig", "camera_cell"):
        assert tf.Scene.load(name).text() == (SCENES / f"{name}.toml").read_text()


def test_files_are_named_from_where_the_scene_is_saved(tmp_path: Path) -> None:
    path = tf.Scene.load("on_a_hull").save(tmp_path / "hull.toml")
    scene = load_scene(path)
    assert (tmp_path / scene.meshes[0].file).resolve() == (SCENES / "meshes/hull.stl").resolve()


def test_an_include_stands_before_the_tables(tmp_path: Path) -> None:
    (tmp_path / "room.toml").write_text("[room]\nambient_w_m2_sr = 0.6\n")
    scene = cell()
    scene.folder = tmp_path
    assert tomllib.loads(scene.include("room.toml").text())["include"] == ["room.toml"]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda s: s.camera(focal_lenght_mm=8), "did you mean 'focal_length_mm'"),
        (lambda s: s.stations(tf.arc(3, 100, 100, LOOK, roll_degs=[0])), "did you mean 'roll_deg'"),
        (lambda s: s.targets("grids", first_code=1), "did you mean 'grid'"),
        (lambda s: s.set("boards.D.bow_mm", 2), "no entry 'D'"),
        (lambda s: s.board("C", (0, 0, 0), kind="calib.io ChArUco A3 11x9").check(), "calib.io ChArUco A3 11x8"),
        (lambda s: s.exposure(-1).check(), "exposure.time_ms"),
        (lambda s: s.save(), "give a path"),
    ],
)
def test_what_is_wrong_is_said_with_the_nearest_name(wrong, words: str) -> None:
    with pytest.raises(tf.TestfieldError) as refused:
        wrong(cell())
    assert words in str(refused.value) + refused.value.sentence()


def test_another_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text("mine")
    with pytest.raises(tf.TestfieldError, match="exists"):
        cell().save(path)
    assert path.read_text() == "mine"
    assert cell().save(path, force=True).read_text() == tomlkit.dumps(cell().document)
