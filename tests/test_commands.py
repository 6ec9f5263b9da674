import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from testfield.chain.run import Run
from testfield.cli.main import main

SCENES = Path(__file__).parents[1] / "scenes"


def test_help_answers_in_under_half_a_second() -> None:
    times = []
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "testfield", "--help"], check=True, capture_output=True)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.5


def test_the_schema_is_the_one_that_lies_beside_the_scenes(capsys: pytest.CaptureFixture) -> None:
    assert main(["schema"]) == 0
    printed = capsys.readouterr().out
    assert printed == (SCENES / "scene.schema.json").read_text(), (
        "renew it: testfield schema > scenes/scene.schema.json"
    )


def test_every_field_of_a_scene_has_a_description() -> None:
    from testfield.scene.load import scene_schema

    schema = scene_schema()
    for name, part in {**schema["$defs"], "SceneFile": schema}.items():
        for field, what in part["properties"].items():
            assert "description" in what or "$ref" in what or field == "generator", f"{name}.{field}"


def test_list_shows_every_algorithm_with_a_sentence(capsys: pytest.CaptureFixture) -> None:
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    for name in ("centroids", "ellipse_model", "grey_centroid", "calibrators", "stitched", "reconstructors", "gls"):
        assert name in printed


def test_an_algorithm_of_ones_own_is_found_by_name() -> None:
    from testfield.registry import find, names, register

    @register("centroids", "mine")
    def mine() -> None:
        """Mine."""

    assert find("centroids", "mine") is mine
    assert "mine" in names("centroids")


def test_json_prints_one_object(quick: Run, capsys: pytest.CaptureFixture) -> None:
    assert main(["run", str(SCENES / "quick.toml"), "--out", str(quick.folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scene"] == "quick"


def test_each_stage_alone_says_that_all_is_up_to_date(quick: Run, capsys: pytest.CaptureFixture) -> None:
    for stage in ("render", "expose", "detect", "calibrate", "reconstruct", "score", "report"):
        assert main([stage, str(quick.folder)]) == 0
        assert "up to date" in capsys.readouterr().out


def test_preview_draws_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    picture = tmp_path / "preview.png"
    assert main(["preview", str(SCENES / "quick.toml"), "--out", str(picture)]) == 0
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("scene", sorted(SCENES.glob("*.toml")), ids=lambda p: p.stem)
def test_every_scene_that_is_shipped_is_valid(scene: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["validate", str(scene)]) == 0
    assert "valid" in capsys.readouterr().out
