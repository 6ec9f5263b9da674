"""What comes along is found by name, in the repository and in an installed package."""

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.scene.shipped import find_field, find_scene, shipped_scenes

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scenes"


def test_a_scene_is_found_by_name_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("quick", "quick.toml", Path("quick")):
        assert find_scene(name).read_bytes() == (SCENES / "quick.toml").read_bytes()
    assert find_field("plate").read_bytes() == (SCENES / "fields/plate.toml").read_bytes()


def test_a_path_wins_over_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quick.toml").write_text("")
    assert find_scene("quick.toml") == Path("quick.toml")
    (tmp_path / "quick").mkdir()  # a folder is no scene
    assert find_scene("quick").parent == SCENES


def test_a_wrong_name_gets_the_nearest_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TestfieldError, match="stitched_wall"):
        find_scene("stiched_wall")
    with pytest.raises(TestfieldError, match="'quick' alone"):
        find_scene("scenes/quick.toml")


def test_scenes_are_listed_with_what_they_are(capsys: pytest.CaptureFixture) -> None:
    assert main(["list", "scenes", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["scenes"]
    assert set(listed) == {path.stem for path in SCENES.glob("*.toml")} == set(shipped_scenes())
    assert all(row["what"] for row in listed.values())


def test_a_wheel_holds_what_the_program_reads(tmp_path: Path) -> None:
    for name in ("src", "scenes"):
        unwanted = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / name, tmp_path / name, symlinks=True, ignore=unwanted)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / name)
    words = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", "made", "."]
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    with zipfile.ZipFile(next((tmp_path / "made").glob("*.whl"))) as wheel:
        held = {name for name in wheel.namelist() if ".dist-info/" not in name}
    source = ROOT / "src/testfield"
    wanted = {path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file()}
    wanted |= {f"shipped/{path.relative_to(SCENES).as_posix()}" for path in SCENES.rglob("*") if path.is_file()}
    wanted = {f"testfield/{name}" for name in wanted if "__pycache__" not in name}
    assert wanted - held == set()
