"""Indirect light, bounce by bounce: what paths traced to their ends say, and the same however many rays there are."""

from pathlib import Path

import numpy as np
import pytest

from testfield.render.gather import Places, gather, matt_radiances, path_radiances
from testfield.render.irradiance import (
    SMOOTH_NODES,
    Irradiance,
    IrradianceLookup,
    _nodes,
    _on_panels,
    compute_irradiance,
)
from testfield.render.stage import Stage, build_stage
from testfield.scene.build import build_world
from testfield.scene.load import load_scene

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"


@pytest.fixture(scope="module")
def stage() -> Stage:
    return build_stage(build_world(load_scene(QUICK)))


@pytest.fixture(scope="module")
def light(stage: Stage) -> Irradiance:
    return compute_irradiance(stage, 120.0, 1024, 1, lambda _: None)


@pytest.fixture(scope="module")
def on_boards(stage: Stage) -> Places:
    """Sixteen places on each board's front."""
    world = stage.world
    every = _on_panels(world, np.full((len(world.panels), 2), 4))
    names = {sheet.name for sheet in world.field.boards}
    here = np.repeat([name in names for name in world.panels.name], 16)
    return Places(every.points[here], every.normals[here], every.tangents[here])


def test_one_ray_that_knows_the_light_it_meets_says_what_whole_paths_say(
    stage: Stage, light: Irradiance, on_boards: Places
) -> None:
    known = gather(matt_radiances(stage, IrradianceLookup(light), None, []), on_boards, 8192, 3)
    traced = gather(path_radiances(stage), on_boards, 8192, 3)
    assert known.mean() == pytest.approx(traced.mean(), rel=2e-3)
    assert np.sqrt(np.mean((known / traced - 1) ** 2)) < 0.015


def test_more_rays_give_the_same_light(stage: Stage, light: Irradiance, on_boards: Places) -> None:
    few = Places(on_boards.points[::6], on_boards.normals[::6], on_boards.tangents[::6])
    radiance = matt_radiances(stage, IrradianceLookup(light), None, [])
    dense = gather(radiance, few, 1 << 20, 5).mean()
    assert gather(radiance, few, 1 << 16, 6).mean() == pytest.approx(dense, rel=8e-4)


def test_another_shift_of_the_rays_gives_the_same_light(stage: Stage, light: Irradiance) -> None:
    again = compute_irradiance(stage, 120.0, 1024, 2, lambda _: None)
    assert again.values.mean() == pytest.approx(light.values.mean(), rel=3e-3)


def test_a_polynomial_comes_back_as_it_is_and_does_not_swing_beyond_the_last_point() -> None:
    n = 24
    x, y = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    at = np.linspace(0, 1, SMOOTH_NODES)
    u, v = np.meshgrid(at, at)
    assert _nodes(2 + x**3 - 2 * x * y + y**2) == pytest.approx(2 + u**3 - 2 * u * v + v**2, abs=1e-9)
    # A step, as where a floor goes on behind a wall: it may ring, but not beyond its own height.
    stepped = _nodes(np.where(y < 0.8, 1.0, 0.5) + 0 * x)
    assert stepped.max() < 1.25 and stepped.min() > 0.25


def _past_a_bar(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Light with a trough aslant, as behind a bar, that no polynomial of some degrees follows."""
    return 2 + x - 0.5 * y * y - 0.2 * np.exp(-(((x - 0.3 * y - 0.4) / 0.06) ** 2))


def test_light_that_falls_past_something_near_is_followed() -> None:
    n = 40
    x, y = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, SMOOTH_NODES)])
    error = np.abs(_nodes(_past_a_bar(x, y)) - _past_a_bar(u, v))
    # Half a cell beyond the last estimate it can only be guessed how the trough goes on.
    assert error[3:-3, 3:-3].max() < 0.01 * 0.2 and error.max() < 0.1 * 0.2


def test_noise_of_estimates_is_left_behind_whatever_the_light() -> None:
    n, u_noise = 40, 0.01
    x, y = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, SMOOTH_NODES)])
    rng = np.random.default_rng(5)
    for light, part in ((_past_a_bar, 0.6), (lambda x, y: 2 + x - y**3, 0.12)):
        error = [_nodes(light(x, y) + rng.normal(0, u_noise, x.shape)) - light(u, v) for _ in range(8)]
        assert np.sqrt(np.mean(np.square(error))) < part * u_noise
