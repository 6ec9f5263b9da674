"""Truth flows along its own side only."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "src/testfield"
MEASURING = ("detect", "calibrate", "adjust", "reconstruct", "uncertainty")
TRUE_SIDE = ("scene", "render", "sensor", "score")


def _imports(path: Path) -> set[str]:
    tree = ast.parse(path.read_text())
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


def _rooms_reached(path: Path, seen: set[Path] | None = None) -> set[str]:
    """Rooms that importing a file leads to, directly or through others."""
    seen = set() if seen is None else seen
    rooms: set[str] = set()
    for name in _imports(path):
        parts = name.split(".")
        if parts[0] != "testfield" or len(parts) < 2:
            continue
        rooms.add(parts[1])
        target = ROOT.joinpath(*parts[1:]).with_suffix(".py")
        if target.is_file() and target not in seen:
            seen.add(target)
            rooms |= _rooms_reached(target, seen)
    return rooms


@pytest.mark.parametrize("room", MEASURING)
def test_the_measuring_side_never_reaches_the_truth(room: str) -> None:
    for path in (ROOT / room).glob("*.py"):
        assert not _rooms_reached(path) & set(TRUE_SIDE), path


def test_only_render_imports_mitsuba_and_drjit() -> None:
    for path in ROOT.rglob("*.py"):
        if path.parent.name != "render":
            assert not {name.split(".")[0] for name in _imports(path)} & {"mitsuba", "drjit"}, path


def test_targets_and_camera_know_no_other_room() -> None:
    for room in ("targets", "camera"):
        for path in (ROOT / room).glob("*.py"):
            assert _rooms_reached(path) <= {room, "errors"}, path


def test_the_wall_would_be_seen_to_fall(tmp_path: Path) -> None:
    spy = tmp_path / "spy.py"
    spy.write_text("from testfield.score.camera import true_in_datum\n")
    assert "scene" in _rooms_reached(spy)
