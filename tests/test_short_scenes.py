"""Shipped scenes are short by kinds, and the same world to the byte as written out field by field."""

from pathlib import Path

from conftest import SCENES

from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.store.digests import digest

WRITTEN_OUT = Path(__file__).parent / "written_out"


def test_the_stitched_wall_is_short_and_the_same_world() -> None:
    short = SCENES / "stitched_wall.toml"
    assert len(short.read_text().splitlines()) <= 100
    scene, long = load_scene(short), load_scene(WRITTEN_OUT / "stitched_wall.toml")
    assert scene.model_dump() == long.model_dump()
    assert digest(build_world(scene)) == digest(build_world(long))
