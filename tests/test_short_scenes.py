"""Shipped scenes are short by kinds, and the same world to the byte as written out field by field."""

from pathlib import Path

import pytest
from conftest import SCENES

from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.store.digests import digest

WRITTEN_OUT = Path(__file__).parent / "written_out"


@pytest.mark.parametrize("name, lines", [("stitched_wall.toml", 100), ("quick.toml", 60)])
def test_a_scene_is_short_and_the_same_world(name: str, lines: int) -> None:
    short = SCENES / name
    assert len(short.read_text().splitlines()) <= lines
    scene, long = load_scene(short), load_scene(WRITTEN_OUT / name)
    assert scene.model_dump() == long.model_dump()
    assert digest(build_world(scene)) == digest(build_world(long))
