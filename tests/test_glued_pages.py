"""A tiled print is a stitched board: pages that were glued badly cost no accuracy, for every page is a board."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from glued import glued, pages_of_board
from scipy.stats import chi2

from testfield.camera.images import Frame
from testfield.chain.recipe import recipe_of
from testfield.detect.observations import Observations
from testfield.measure.pipeline import detect_all, measure
from testfield.measure.recipe import Algorithm
from testfield.scene.build import build_world
from testfield.scene.exposure import sensor_of
from testfield.scene.load import load_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views, see
from testfield.scene.world import World
from testfield.score.scorecard import score_measured
from testfield.sensor.expose import expose
from testfield.simulate.observations import draw_observations

SCENE = Path(__file__).parent / "glued_wall.toml"
SHIFT_MM, TURN_DEG = 1.0, 0.2
"""By how much every page is off, in a direction of its own."""


def worlds_of(scene: SceneFile, off: float, workshop: int = 5) -> tuple[World, World]:
    """The scene's first board on pages of A4, glued `off` times `SHIFT_MM` and `TURN_DEG` from where they belong: as
    pages, and as one board. Another workshop prints and glues in another way."""
    world = build_world(scene, workshop)
    pages = pages_of_board(world, 0)
    assert len(pages) == 15
    rng = np.random.default_rng(workshop)
    angle, sign = rng.uniform(0, 2 * np.pi, len(pages)), rng.choice([-1.0, 1.0], len(pages))
    shift = SHIFT_MM * np.column_stack([np.cos(angle), np.sin(angle)])
    return glued(world, 0, pages, off * shift, off * TURN_DEG * sign)


def figures(scene: SceneFile, world: World, views: Views, seen: Observations, calibrator: str = "stitched") -> dict:
    """The scorecard of what was seen, measured by the world's own field sheet."""
    recipe = replace(recipe_of(scene), calibrator=Algorithm(calibrator))
    found = measure(seen, world.field, recipe)
    return score_measured(world, views, found.observations, found.calibration, found.points)


def summed(cards: list[dict[str, Any]]) -> dict[str, float]:
    """Root mean squares over draws: errors of check targets (mm, after the fit) and of the bar that checks (mm), its
    z-score; the mean NEES of the targets."""
    bars = [next(bar for bar in card["lengths"]["bars"] if bar["role"] == "check") for card in cards]
    return {
        "points_mm": float(np.sqrt(np.mean([card["points"]["rmse_mm"] ** 2 for card in cards]))),
        "length_mm": float(np.sqrt(np.mean([bar["error_mm"] ** 2 for bar in bars]))),
        "length_z": float(np.sqrt(np.mean([(2 * bar["en"]) ** 2 for bar in bars]))),
        "points_anees": float(np.mean([card["points"]["anees_fitted"] for card in cards])),
    }


def shown_as_one_board(well: dict[str, Any], badly: dict[str, Any], badly_unchecked: dict[str, Any]) -> None:
    """A calibration with checks refuses a badly glued board that is measured as one; one without is wrong by it."""
    assert not any("sheet of board 'A'" in failure for failure in well["verdict"]["failures"])
    assert any("sheet of board 'A'" in failure for failure in badly["verdict"]["failures"])
    assert badly_unchecked["points"]["rmse_mm"] > 8 * well["points"]["rmse_mm"]


def test_pages_glued_badly_cost_nothing_that_is_predicted() -> None:
    """No images: centres at their physical bound, the print and the bars of one workshop."""
    scene = load_scene(SCENE)
    cards: dict[tuple[float, str], list[dict[str, Any]]] = {}
    for off in (0.0, 1.0):
        by_page, as_one = worlds_of(scene, off, workshop=1)
        views = see(by_page)
        for noise in (0, 1):
            seen = draw_observations(scene, by_page, views, noise)
            cards.setdefault((off, "pages"), []).append(figures(scene, by_page, views, seen))
        seen = draw_observations(scene, as_one, views, 0)
        cards[off, "one"] = [figures(scene, as_one, views, seen)]
        if off:
            cards[off, "unchecked"] = [figures(scene, as_one, views, seen, "opencv")]
    well, badly = summed(cards[0.0, "pages"]), summed(cards[1.0, "pages"])
    assert badly["points_mm"] == pytest.approx(well["points_mm"], rel=0.02)
    assert badly["length_mm"] == pytest.approx(well["length_mm"], rel=0.02)
    assert 0.7 < badly["points_anees"] < 1.4
    assert all(card["verdict"]["passed"] for off in (0.0, 1.0) for card in cards[off, "pages"])
    shown_as_one_board(cards[0.0, "one"][0], cards[1.0, "one"][0], cards[1.0, "unchecked"][0])


@pytest.mark.slow
def test_what_is_stated_of_badly_glued_pages_is_true_in_many_workshops() -> None:
    """Without images: twelve prints, each with pages glued otherwise, its own bars and noise."""
    scene = load_scene(SCENE)
    cards = []
    for workshop in range(12):
        world, _ = worlds_of(scene, 1.0, workshop)
        views = see(world)
        cards.append(figures(scene, world, views, draw_observations(scene, world, views, workshop)))
    found = summed(cards)
    print(found)
    assert 0.85 < found["points_anees"] < 1.15
    assert chi2.cdf(12 * found["length_z"] ** 2, 12) == pytest.approx(0.5, abs=0.495)


def frames_of(scene: SceneFile, world: World) -> Callable[[int], list[Frame]]:
    """The world's rendered images, exposed with the noise of a seed."""
    from testfield.render.irradiance import compute_irradiance
    from testfield.render.stage import build_stage
    from testfield.render.views import fast_views

    stage, render, stations = build_stage(world), scene.render, range(len(world.station_name))
    light = compute_irradiance(stage, render.light_spacing_mm, render.light_paths, 1, lambda _: None)
    images = list(fast_views(stage, light, stations, stations, render.cells, render.blur_shots, lambda image: image))
    return lambda noise: [expose(image, sensor_of(scene), scene.seed, noise_seed=noise) for image in images]


@pytest.mark.slow
def test_pages_glued_badly_cost_nothing_in_rendered_images() -> None:
    """Rendered, exposed five times each, detected and measured as anybody would; the noise is the pixels' own."""
    scene = load_scene(SCENE)
    cards: dict[tuple[float, str], list[dict[str, Any]]] = {}
    for off in (0.0, 1.0):
        by_page, as_one = worlds_of(scene, off)
        views, exposed = see(by_page), frames_of(scene, by_page)
        for noise in range(5):
            seen = detect_all(exposed(noise), by_page.field, recipe_of(scene))
            cards.setdefault((off, "pages"), []).append(figures(scene, by_page, views, seen))
        seen = detect_all(exposed(0), as_one.field, recipe_of(scene))
        cards[off, "one"] = [figures(scene, as_one, views, seen)]
        cards[off, "unchecked"] = [figures(scene, as_one, views, seen, "opencv")]
    for key, found in cards.items():
        print(key, summed(found), {failure for card in found for failure in card["verdict"]["failures"]})
    well, badly = summed(cards[0.0, "pages"]), summed(cards[1.0, "pages"])
    # The marks come to lie on other pixels, so the noise of five exposures is not the same.
    assert badly["points_mm"] == pytest.approx(well["points_mm"], rel=0.1)
    assert 0.7 < badly["points_anees"] < 1.4
    seen = [card["detection"] for card in cards[1.0, "pages"]]
    assert not sum(one["wrong_code"] + one["wrong_dot"] for one in seen)
    shown_as_one_board(cards[0.0, "one"][0], cards[1.0, "one"][0], cards[1.0, "unchecked"][0])
