"""What a scene declares once and uses by name."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from conftest import SCENES

from testfield.errors import TestfieldError
from testfield.scene.declared import expanded
from testfield.scene.load import parse_scene, scene_schema


def test_fields_of_its_own_come_before_those_of_its_kind_within_tables_too() -> None:
    kinds = {"wall": {"size_mm": [1, 2], "zone": {"columns": 3, "rows": 4}}}
    found = expanded({"kinds": kinds, "boards": [{"kind": "wall", "name": "A", "zone": {"rows": 5}}]}, "scene")
    assert found == {"boards": [{"name": "A", "size_mm": [1, 2], "zone": {"columns": 3, "rows": 5}}]}
    assert kinds == {"wall": {"size_mm": [1, 2], "zone": {"columns": 3, "rows": 4}}}


def test_a_scene_with_kinds_is_the_scene_written_out() -> None:
    path = SCENES / "camera_cell.toml"
    written = tomli_w.dumps(expanded(tomllib.loads(path.read_text()), "cell"))
    assert "kind" not in written
    assert parse_scene(written, "written") == parse_scene(path.read_text(), "as it is")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"kinds": {"wall": {}}, "boards": [{"kind": "wal"}]}, ("boards[0].kind", "did you mean 'wall'")),
        ({"boards": [{"kind": "wall"}]}, ("boards[0].kind", "wall")),
        ({"kinds": {"wall": 3}}, ("kinds", "[kinds.NAME]")),
        ({"kinds": {"wall": {}}, "cameras": [{"kind": 3}]}, ("cameras[0].kind", "3")),
    ],
)
def test_a_kind_that_nobody_declared_is_refused_by_its_place(data: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(TestfieldError) as refused:
        expanded(data, "scene.toml")
    assert all(word in refused.value.sentence() for word in words)


def test_a_fault_in_a_kind_is_told_where_the_kind_is_used(tmp_path: Path) -> None:
    text = (SCENES / "stitched_wall.toml").read_text().replace("columns = 11", "columns = 0")
    with pytest.raises(TestfieldError, match=r"boards\[0\]\.extension_zone\.columns"):
        parse_scene(text, "wall.toml")


def test_the_schema_for_editors_knows_kinds() -> None:
    schema = scene_schema()
    assert "kinds" in schema["properties"]
    for part in ("BoardPart", "NamedCameraPart", "StationArc", "CheckRandom", "ScaleBarPart"):
        assert "kind" in schema["$defs"][part]["properties"]
