"""Dirt on boards: the renderer covers what the truth says is covered."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import build_stage
from testfield.scene.board_parts import DirtPart
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import see
from testfield.scene.world import Dirt, TrueMarks, World
from testfield.score.detection import EXPECTED_PX

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"


def soiled(seed: int = 0) -> World:
    scene = load_scene(QUICK)
    dirt = DirtPart(count=30, diameter_mm=12.0, albedo=0.3, seed=seed)
    boards = (scene.boards[0].model_copy(update={"dirt": dirt}), *scene.boards[1:])
    return build_world(scene.model_copy(update={"boards": boards, "camera": sharp(scene.camera)}))


def sharp(camera):  # type: ignore[no-untyped-def]
    return camera.model_copy(update={"psf_sigma_px": 0.0})


@pytest.fixture(scope="module")
def world() -> World:
    return soiled()


@pytest.fixture(scope="module")
def images(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Station 1 evenly lit, with the dirt and without."""
    light = Irradiance.even(len(world.panels), np.pi)
    return tuple(render_fast(build_stage(w), light, 1, 3).values for w in (world, replace(world, dirt=Dirt())))  # type: ignore[return-value]


def test_dirt_is_drawn_by_name_and_stays_on_its_board(world: World) -> None:
    assert np.array_equal(world.dirt.xy_mm, soiled().dirt.xy_mm)
    assert not np.array_equal(world.dirt.xy_mm, soiled(1).dirt.xy_mm)
    assert (np.abs(world.dirt.xy_mm) + 6 <= world.panels.size_mm[0] / 2).all()


def test_clean_is_one_less_the_covered_area() -> None:
    """One spot over the rim of one dot, whose overlap is a lens of two circles."""
    world = build_world(load_scene(QUICK))
    k = int(np.flatnonzero(world.marks.code == 0)[0])
    r, apart = 7.0, 7.0
    spot = Dirt(world.marks.panel[[k]], world.marks.xy_mm[[k]] + [apart, 0], np.array([r]), np.array([0.3]))
    lens = 2 * r**2 * np.arccos(apart / (2 * r)) - apart / 2 * np.sqrt(4 * r**2 - apart**2)
    clean = replace(world, dirt=spot).mark_clean
    assert clean[k] == pytest.approx(1 - lens / (np.pi * r**2), abs=2e-3)
    assert (np.delete(clean, k) == 1).all()
    assert (world.mark_clean == 1).all()


def test_dirty_targets_are_visible_but_not_fully(world: World) -> None:
    views, plain = see(world), see(replace(world, dirt=Dirt()))
    dirty = world.mark_clean < 1
    assert 3 < dirty.sum() < len(dirty)
    assert np.array_equal(views.visible[:, ~dirty], plain.visible[:, ~dirty])
    assert (views.visible[:, dirty] < 1).all()
    assert np.array_equal(views.visible, plain.visible * views.clean)
    assert (plain.diameter_px[1, dirty] > EXPECTED_PX).any()


def test_the_renderer_covers_exactly_the_targets_that_the_truth_calls_dirty(
    world: World, images: tuple[np.ndarray, np.ndarray]
) -> None:
    views, marks = see(world), world.marks
    changed = np.abs(images[0] - images[1]) > 1e-4
    for k in np.flatnonzero((marks.panel == 0) & (marks.code == 0) & (views.visible[1] > 0)):
        x, y = np.rint(views.disc_px[1, k]).astype(int)
        g = np.arange(-10, 11)
        inside = np.hypot(*np.meshgrid(g, g)) < views.diameter_px[1, k] / 2 - 2
        touched = changed[y - 10 : y + 11, x - 10 : x + 11][inside].mean()
        if views.clean[k] == 1:
            assert touched == 0
        elif views.clean[k] < 0.7:
            assert touched > 0


def test_spots_of_ink_in_the_place_of_dots_are_those_dots(images: tuple[np.ndarray, np.ndarray]) -> None:
    """The same closed form covers both, so spots keep the exactness that the certificate shows of dots."""
    world = replace(soiled(), dirt=Dirt())
    marks = world.marks
    dots = (marks.panel == 0) & (marks.code == 0)
    spots = Dirt(
        marks.panel[dots],
        marks.xy_mm[dots],
        marks.diameter_mm[dots] / 2,
        np.full(dots.sum(), world.panels.ink_albedo[0]),
    )
    names = ("panel", "xy_mm", "diameter_mm", "code", "role", "board", "point")
    others = TrueMarks(*[getattr(marks, name)[~dots] for name in names])
    stage = build_stage(replace(world, marks=others, dirt=spots))
    image = render_fast(stage, Irradiance.even(len(world.panels), np.pi), 1, 3).values
    assert np.abs(image - images[1]).max() < 1e-6


def test_a_spot_has_its_albedo(world: World, images: tuple[np.ndarray, np.ndarray]) -> None:
    changed = np.abs(images[0] - images[1]) > 0.05
    assert changed.sum() > 500
    assert np.median(images[0][changed]) == pytest.approx(0.3, abs=1e-5)
