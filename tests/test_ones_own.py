"""Algorithms, a lens model and a kind of board of one's own: one file, found by name wherever names are given."""

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w

from testfield import registry
from testfield.camera.images import Frame, SensorSheet
from testfield.camera.lens import lens_model, lens_names
from testfield.certify.lens import certify_lens
from testfield.detect.detect import detect
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import changed, scene_table
from testfield.measure.pipeline import measure
from testfield.measure.recipe import Algorithm, Recipe
from testfield.scene.build import build_world
from testfield.scene.camera_parts import CameraPart
from testfield.scene.load import parse_scene
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.simulate.board_image import draw_board, facing
from testfield.simulate.observations import draw_observations
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks
from testfield.uncertainty.rays import RayTrials

CAMERA = {
    "width_px": 1280,
    "height_px": 1024,
    "lens": "one_term",
    "coefficients": {"bow": -0.08},
    "pixel_pitch_um": 5.0,
    "focal_length_mm": 8.0,
}
QUICK = Path(__file__).parents[1] / "scenes/quick.toml"


@pytest.fixture(scope="module", autouse=True)
def ones_own() -> Iterator[None]:
    sys.path.insert(0, str(Path(__file__).parent))
    import_module("ones_own")  # the one line
    yield
    sys.path.pop(0)
    for entered in registry._registered.values():
        for name in [name for name, function in entered.items() if function.__module__ == "ones_own"]:
            del entered[name]
    sys.modules.pop("ones_own")


@pytest.fixture(scope="module")
def drawn(ones_own: None) -> tuple[World, Observations]:
    """The quick scene seen through the lens of one's own, drawn without images."""
    scene = parse_scene(tomli_w.dumps(changed(scene_table(QUICK), {"camera": CAMERA})), "own.toml")
    world = build_world(scene)
    return world, draw_observations(scene, world, see(world), 5)


def test_a_lens_model_of_ones_own_is_calibrated_as_truly_as_it_claims(drawn: tuple[World, Observations]) -> None:
    world, seen = drawn
    found = measure(seen, world.field, Recipe()).calibration
    assert found.interior.names == ("fx", "fy", "cx", "cy", "bow")
    own = found.index(list(found.interior.names))
    error = found.interior.parameters - world.interior.parameters
    cov = found.covariance[np.ix_(own, own)]
    assert error @ np.linalg.solve(cov, error) < 20.5  # chi2 of 5 at 0.999
    assert np.sqrt(cov[4, 4]) < 2e-3


def test_the_parameters_of_a_lens_model_are_asked_for_in_the_order_that_it_gives() -> None:
    assert lens_model("one_term").parameter_groups == (("fx", "fy"), ("bow",), ("cx", "cy"), ("aspect",))
    for name in lens_names():
        model = lens_model(name)
        asked = [parameter for group in model.parameter_groups for parameter in group]
        assert sorted(asked) == sorted(["fx", "fy", "cx", "cy", "aspect", *model.coefficients])


def test_calibrator_and_reconstructor_of_ones_own_are_parts_of_a_recipe(drawn: tuple[World, Observations]) -> None:
    world, seen = drawn
    recipe = Recipe(calibrator=Algorithm("stitched_anew"), reconstructor=Algorithm("by_depth"))
    recipe.check("recipe")
    found = measure(seen, world.field, recipe)
    assert found.calibration.method == "stitched_anew" and found.points.method == "by_depth"
    assert len(found.points.code)


def test_a_reconstructor_of_ones_own_is_drawn_by_rays(drawn: tuple[World, Observations]) -> None:
    world, seen = drawn
    found = measure(seen, world.field, Recipe(reconstructor=Algorithm("by_depth")))
    ready = RayTrials.of(seen, found.calibration, world.field, "by_depth")
    assert np.allclose(ready.xyz_mm, found.points.xyz_mm, rtol=0, atol=1e-9)
    with pytest.raises(TestfieldError, match="all at once"):
        RayTrials.of(seen, found.calibration, world.field, "opencv")


def test_files_commands_and_the_certificate_know_the_lens_model() -> None:
    assert CameraPart(lens="one_term").lens == "one_term"
    verdicts = {verdict.name: verdict for verdict in certify_lens(quick=True)}
    assert verdicts["round trip, one_term"].passed
    assert verdicts["points folded back"].passed


def test_a_kind_of_board_of_ones_own_is_printed_told_and_detected(tmp_path: Path) -> None:
    pattern = BoardPattern("staggered_tags", 4, 3, 40.0, 28.0, "DICT_4X4_50")
    n = len(pattern.points_mm)
    marks = Marks(pattern.points_mm, np.full(n, pattern.free_mm), np.zeros(n, int))
    sheet = Field(14, (NominalBoard("own", marks, 0.0, 0.0, pattern, (200.0, 150.0)),), (), {})
    sheet.save(tmp_path / "field.json")
    told = Field.load(tmp_path / "field.json")
    assert told.boards[0].pattern == pattern

    to_px = facing(4.0, (400.0, 300.0), 7.0, 1e-4)
    image = draw_board(pattern, (800, 600), to_px, fine=10, black_and_white=(400.0, 3000.0))
    image += np.random.default_rng(1).normal(0, 3, image.shape)
    frame = Frame("one", np.rint(image).astype(np.uint16), SensorSheet(2.6, 2.3, 64.0, 12))
    found = detect(frame, told, "forward_model", 5.0)
    good = found.take(found.status == MEASURED)
    assert len(good) == n
    true = cv2.perspectiveTransform(pattern.points_mm[None], to_px)[0]
    assert np.abs(good.xy_px - true[good.point]).max() < 0.05


def test_a_finder_of_ones_own_reads_a_kind_of_board(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[BoardPattern] = []
    monkeypatch.setitem(
        registry._known["boards"], "staggered_tags", {"read": lambda image, pattern: asked.append(pattern)}
    )
    pattern = BoardPattern("staggered_tags", 2, 2, 40.0, 28.0, "DICT_4X4_50")
    marks = Marks(pattern.points_mm, np.full(16, pattern.free_mm), np.zeros(16, int))
    sheet = Field(14, (NominalBoard("own", marks, 0.0, 0.0, pattern, (200.0, 150.0)),), (), {})
    frame = Frame("one", np.full((100, 100), 3000, np.uint16), SensorSheet(2.6, 2.3, 64.0, 12))
    detect(frame, sheet, "forward_model", 5.0)
    assert asked == [pattern]


def test_a_coefficient_that_a_lens_model_has_not_is_refused() -> None:
    for camera, place in (
        (CAMERA | {"coefficients": {"bowl": -0.08}}, "camera.coefficients.bowl"),
        (CAMERA | {"k1": -0.08}, "camera.k1"),
    ):
        scene = parse_scene(tomli_w.dumps(changed(scene_table(QUICK), {"camera": camera})), "own.toml")
        with pytest.raises(TestfieldError, match=rf"{place}.*its coefficients are bow"):
            build_world(scene)


def test_a_name_that_nobody_registered_is_refused_with_those_that_are() -> None:
    with pytest.raises(ValueError, match="'one_term'"):
        CameraPart(lens="two_terms")
    with pytest.raises(TestfieldError, match="one_term"):
        registry.find("lenses", "two_terms")
    with pytest.raises(TestfieldError, match="lenses"):
        registry.register("lens", "two_terms")
