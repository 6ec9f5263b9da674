"""A recipe is a value, and the pipeline measures what it says."""

from pathlib import Path

import numpy as np
import pytest
from conftest import SCENES

from testfield.calibrate.zhang import zhang
from testfield.chain.recipe import recipe_of
from testfield.errors import TestfieldError
from testfield.measure.pipeline import calibrate, measure
from testfield.measure.recipe import Algorithm, Recipe, options_of
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import see
from testfield.simulate.observations import draw_observations

WRONG = {
    'calibrator = "stiched"': "stitched",
    'calibrator = { name = "zhang", bord = "A" }': "board",
    'centroid = "none"\n': "centroid",
    "reconstructors = 3": "reconstructor",
    "smallest_diameter_px = 1": "smallest_diameter_px",
    'calibrator = { name = "stitched", lens = "brown", hold = ["k9"] }': "k9",
    'calibrator = { name = "stitched", hold = 20 }': "calibrator.hold",
    'calibrator = { name = "stitched", hold = [3.5] }': "calibrator.hold",
    'calibrator = { name = "stitched", lens = {} }': "calibrator.lens",
    'calibrator = { name = "stitched", lens = "browm" }': "'brown'",
    'calibrator = { name = "stitched", rigs = 3 }': "calibrator.rigs",
}


@pytest.fixture(scope="module")
def quick_drawn() -> tuple:
    scene = load_scene(SCENES / "quick.toml")
    world = build_world(scene)
    return scene, world, draw_observations(scene, world, see(world), 7)


def test_a_recipe_in_a_file_is_the_recipe_of_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'centroid = "star"\nsmallest_diameter_px = 6\n[calibrator]\nname = "zhang"\nhold = ["k3"]\nboard = "A"\n'
    )
    recipe = Recipe.load(path)
    assert recipe == Recipe(
        name="mine",
        centroid=Algorithm("star"),
        calibrator=Algorithm("zhang", {"hold": ("k3",), "board": "A"}),
        smallest_diameter_px=6,
    )
    scene = load_scene(SCENES / "quick.toml")
    asked = {"centroid": "star", "calibrator": "zhang", "hold": ("k3",), "board": "A", "smallest_diameter_px": 6}
    changed = scene.model_copy(update={"name": "mine", "measure": scene.measure.model_copy(update=asked)})
    assert recipe_of(changed) == recipe


@pytest.mark.parametrize("text", WRONG, ids=range(len(WRONG)))
def test_a_wrong_recipe_is_refused_by_file_and_field(text: str, tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(TestfieldError) as refused:
        Recipe.load(tmp_path / "r.toml")
    assert "r.toml" in refused.value.sentence() and WRONG[text] in refused.value.sentence()


def test_the_options_of_an_algorithm_are_what_it_takes_beside_what_it_is_given() -> None:
    assert options_of("calibrators", "zhang") == ["lens", "hold", "board"]
    assert options_of("reconstructors", "gls") == []
    assert options_of("centroids", "star") == []


def test_the_board_that_a_recipe_names_is_the_one_that_calibrates(quick_drawn: tuple) -> None:
    scene, world, observations = quick_drawn
    for board in ("A", "B"):
        recipe = Recipe(calibrator=Algorithm("zhang", {"board": board}))
        found = calibrate(observations, world.field, recipe)
        assert found.board_names == (board,)
        camera = scene.camera
        alone = zhang(observations, world.field, camera.width_px, camera.height_px, camera.lens, (), board)
        assert np.array_equal(found.interior.parameters, alone.interior.parameters)


def test_an_option_of_a_scene_reaches_the_algorithm(quick_drawn: tuple) -> None:
    scene, world, observations = quick_drawn
    options = scene.measure.model_copy(update={"calibrator_options": {"hold": ("k3",)}})
    held = measure(observations, world.field, recipe_of(scene.model_copy(update={"measure": options})))
    assert held.calibration.interior.parameters[6] == 0 and "k3" not in held.calibration.labels
