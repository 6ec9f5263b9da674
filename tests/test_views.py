"""Images of several stations in turn: the same bytes as one by one, and what goes wrong beside is heard."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.camera.images import Radiance
from testfield.errors import TestfieldError
from testfield.render.fast import CELLS_A_PASS, render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import Stage, build_stage
from testfield.render.views import fast_views
from testfield.scene.build import build_world
from testfield.scene.load import load_scene

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"


@pytest.fixture(scope="module")
def stage() -> Stage:
    world = build_world(load_scene(QUICK))
    interior = replace(world.interior, width_px=320, height_px=240)
    return build_stage(replace(world, interior=interior))


def even(stage: Stage) -> Irradiance:
    return Irradiance.even(len(stage.world.panels), np.pi)


def test_images_in_turn_are_those_one_by_one_to_the_byte(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    stations, heard = [3, 0, 5], []
    for room in (CELLS_A_PASS, 20_000):  # in one strip, and in many
        monkeypatch.setattr("testfield.render.fast.CELLS_A_PASS", room)
        alone = [render_fast(stage, even(stage), k, 3) for k in stations]
        images = list(fast_views(stage, even(stage), stations, [1, 1, 1], 3, 64, lambda image: image, heard.append))
        assert [image.station for image in images] == [stage.world.station_name[k] for k in stations]
        assert all(np.array_equal(a.values, b.values) for a, b in zip(alone, images, strict=True))
    assert sum(heard) == pytest.approx(6)
    assert len(heard) > 12


def test_an_image_that_cannot_be_kept_ends_the_work(stage: Stage) -> None:
    kept: list[str] = []

    def keep(image: Radiance) -> str:
        if kept:
            raise TestfieldError("the disk is full", image.station)
        kept.append(image.station)
        return image.station

    names, found = stage.world.station_name, []
    with pytest.raises(TestfieldError, match=names[1]):
        found.extend(fast_views(stage, even(stage), [0, 1, 2, 3], [1] * 4, 3, 64, keep))
    assert kept == [names[0]]


def test_a_blur_that_fails_is_no_image(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise MemoryError("of the blur")

    monkeypatch.setattr("testfield.render.fast.Strip.blur_into", broken)
    with pytest.raises(MemoryError, match="of the blur"):
        list(fast_views(stage, even(stage), [0, 1], [1, 1], 3, 64, lambda image: image))
