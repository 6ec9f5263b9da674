"""Several cameras and rigs: drawn observations, whose truth is known."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import IN_FULL, SCENES
from several_cameras import drawn, fewer

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.settle import _lost_image, settled
from testfield.calibrate.settled import Settled
from testfield.chain.recipe import recipe_of
from testfield.chain.truth import Truth
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.pipeline import Measured, measure
from testfield.measure.recipe import Algorithm, Recipe
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.schema import SceneFile
from testfield.score.points import score_points
from testfield.score.several import score_cameras, score_rigs

STEREO = SCENES / "stereo_rig.toml"


@pytest.fixture(scope="module")
def stereo() -> tuple[SceneFile, Truth, Observations]:
    scene = fewer(load_scene(STEREO), 5)
    truth = Truth.of(scene, "stereo_rig")
    return scene, truth, drawn(truth, 3)


@pytest.fixture(scope="module")
def measured(stereo: tuple) -> Measured:
    scene, truth, observations = stereo
    return measure(observations, truth.told, recipe_of(scene))


def test_every_camera_and_the_rig_are_as_good_as_they_say(stereo: tuple, measured: Measured) -> None:
    scene, truth, _ = stereo
    card = score_cameras(truth.cameras, measured.calibration)
    assert set(card["cameras"]) == {"left", "right"}
    for one in card["cameras"].values():
        assert one["interior_anees"] < 2.6 and one["corner_error_px"] < 0.1  # 9 degrees of freedom, 99.5 %
    assert card["corner_error_px"] == max(one["corner_error_px"] for one in card["cameras"].values())
    (rig,) = score_rigs(scene.rigs, measured.calibration)
    assert rig["anees"] < 3.1 and rig["translation_error_mm"] < 0.1  # 6 degrees of freedom, 99.5 %
    points = score_points(truth.world, measured.calibration, measured.points)
    assert 0.4 < points.anees < 1.9


def test_a_rig_shares_one_place_among_its_cameras(stereo: tuple, measured: Measured) -> None:
    c = measured.calibration
    left = [k for k, name in enumerate(c.station_names) if name.endswith("-left")]
    right = [c.station_names.index(c.station_names[k].replace("left", "right")) for k in left]
    relative = c.stations[np.array(right)].after(c.stations[np.array(left)].inverse())
    assert np.ptp(relative.t_mm, axis=0).max() < 1e-9
    free = replace(recipe_of(stereo[0]), calibrator=Algorithm("stitched", {"rigs": "free"}))
    apart = measure(stereo[2], stereo[1].told, free).calibration
    other = apart.stations[np.array(right)].after(apart.stations[np.array(left)].inverse())
    assert np.ptp(other.t_mm, axis=0).max() > 1e-3 and not apart.rigs


def test_an_image_of_which_nothing_is_left_is_not_lost_again() -> None:
    seen = SimpleNamespace(image=np.repeat([0, 1, 3], 10))  # image 2 was left out, and its rig keeps its place
    start, none = SimpleNamespace(stations=("a", "b", "c", "d"), network=seen), np.zeros(30, bool)
    assert _lost_image(start, np.arange(30), none, seen) is None  # type: ignore[arg-type]
    contradicts = np.arange(30) >= 22
    assert _lost_image(start, np.arange(30), contradicts, seen) == 3  # type: ignore[arg-type]


@pytest.mark.slow
def test_an_image_that_contradicts_its_rig_is_left_out_once(stereo: tuple, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, truth, observations = stereo
    wrong = next(k for k, name in enumerate(observations.stations) if name.endswith("-right"))
    shown, lost = observations.xy_px.copy(), []
    shown[observations.station == wrong] += [150.0, -90.0]  # taken at another moment than the left one

    def once(*args: object) -> Settled:
        found = settled(*args)  # type: ignore[arg-type]
        assert found.lost is None or found.lost not in lost
        lost.append(found.lost)
        return found

    monkeypatch.setattr("testfield.calibrate.finish.settled", once)
    found = measure(replace(observations, xy_px=shown), truth.told, recipe_of(scene)).calibration
    assert lost[0] is not None
    assert lost[-1] is None
    assert score_cameras(truth.cameras, found)["corner_error_px"] < 0.1


def test_a_rig_that_is_held_makes_the_cameras_better(stereo: tuple, measured: Measured) -> None:
    free = measure(stereo[2], stereo[1].told, Recipe(calibrator=Algorithm("stitched", {"rigs": "free"})))
    rows = [
        [c.index([f"camera:left.{name}"])[0] for name in ("fx", "cx", "cy")]
        for c in (measured.calibration, free.calibration)
    ]
    held, apart = (
        np.diag(c.covariance)[row] for c, row in zip((measured.calibration, free.calibration), rows, strict=True)
    )
    assert (held < apart).all()


def test_a_stated_relative_orientation_is_weighed_with_its_uncertainty(stereo: tuple) -> None:
    scene, _, observations = stereo
    stated = [one.model_copy(update={"u_position_mm": 1e-4, "u_rotation_deg": 1e-6}) for one in scene.rigs[0].cameras]
    told = scene.model_copy(update={"rigs": (scene.rigs[0].model_copy(update={"cameras": tuple(stated)}),)})
    sheet = Truth.of(told, "x").told
    assert sheet.rigs[0].poses[0] is None and sheet.rigs[0].poses[1] is not None
    found = measure(observations, sheet, recipe_of(scene)).calibration
    (rig,) = score_rigs(scene.rigs, found)
    assert rig["translation_error_mm"] < 5e-4 and rig["u_translation_mm"] < 3e-4


def test_a_calibration_of_several_cameras_comes_back_from_its_file(measured: Measured, tmp_path: Path) -> None:
    measured.calibration.save(tmp_path / "c.json")
    again = Calibration.load(tmp_path / "c.json")
    for name in ("camera_names", "labels", "rigs", "station_names"):
        assert getattr(again, name) == getattr(measured.calibration, name)
    assert np.array_equal(again.image_camera, measured.calibration.image_camera)
    assert np.array_equal(again.more_cameras[0].parameters, measured.calibration.more_cameras[0].parameters)


def test_observations_keep_their_cameras_in_a_file(stereo: tuple, tmp_path: Path) -> None:
    stereo[2].save(tmp_path / "o.parquet")
    again = Observations.load(tmp_path / "o.parquet")
    assert (again.cameras, again.places) == (stereo[2].cameras, stereo[2].places)


def test_a_calibrator_of_one_camera_says_so(stereo: tuple) -> None:
    with pytest.raises(TestfieldError, match="one camera"):
        measure(stereo[2], stereo[1].told, Recipe(calibrator=Algorithm("opencv")))


WRONG = {
    "camera = 'left'\n[[rigs.cameras]]\ncamera = 'lft'": ("lft", "did you mean 'left'"),
    "camera = 'left'\n[[rigs.cameras]]\ncamera = 'left'": ("left", "already held"),
}


@pytest.mark.parametrize("held", WRONG, ids=range(len(WRONG)))
def test_names_of_cameras_and_rigs_must_fit(held: str) -> None:
    text = STEREO.read_text()
    begin, end = text.index("[[rigs]]"), text.index("[exposure]")
    changed = text[:begin] + f'[[rigs]]\nname = "bar"\n[[rigs.cameras]]\n{held}\n' + text[end:]
    with pytest.raises(TestfieldError) as refused:
        Truth.of(parse_scene(changed, "rig.toml"), "rig.toml")
    assert all(word in refused.value.sentence() for word in ("rig.toml", "rigs[0]", *WRONG[held]))


def test_a_station_of_several_cameras_names_one(tmp_path: Path) -> None:
    text = STEREO.read_text().replace('rig = "bar"\ncount', "count")
    with pytest.raises(TestfieldError, match="camera` or `rig"):
        Truth.of(parse_scene(text, "rig.toml"), "rig.toml")


def test_one_camera_under_a_name_is_the_camera_alone() -> None:
    text = IN_FULL.read_text()
    alone = Truth.of(parse_scene(text, "quick.toml"), "quick.toml")
    named = text.replace("[camera]", '[[cameras]]\nname = "body"').replace(
        "[[stations]]", '[[stations]]\ncamera = "body"'
    )
    found = Truth.of(parse_scene(named, "quick.toml"), "quick.toml")
    assert found.world.station_name == alone.world.station_name
    assert np.abs(found.world.camera_from_world.t_mm - alone.world.camera_from_world.t_mm).max() < 1e-9
    assert np.array_equal(found.world.mark_world_mm, alone.world.mark_world_mm)
    assert np.abs(np.nan_to_num(found.views.disc_px - alone.views.disc_px)).max() < 1e-9
