"""Truth flows along its own side only."""

from pathlib import Path

import pytest

from testfield.store.code import ROOT, imports

MEASURING = ("detect", "calibrate", "adjust", "reconstruct", "uncertainty")
TRUE_SIDE = ("scene", "render", "sensor", "score")


def _rooms_reached(path: Path, seen: set[Path] | None = None) -> set[str]:
    """Rooms that importing a file leads to, directly or through others."""
    seen = set() if seen is None else seen
    rooms: set[str] = set()
    for name in imports(path):
        parts = name.split(".")
        if parts[0] != "testfield" or len(parts) < 2:
            continue
        rooms.add(parts[1])
        base = ROOT.joinpath(*parts[1:])
        for target in (base.with_suffix(".py"), base / "__init__.py", base.parent / "__init__.py"):
            if target.is_file() and target not in seen:
                seen.add(target)
                rooms |= _rooms_reached(target, seen)
    return rooms


@pytest.mark.parametrize("room", MEASURING)
def test_the_measuring_side_never_reaches_the_truth(room: str) -> None:
    files = list((ROOT / room).glob("*.py"))
    assert len(files) > 2
    for path in files:
        assert not _rooms_reached(path) & set(TRUE_SIDE), path


def test_only_render_imports_mitsuba_and_drjit() -> None:
    for path in ROOT.rglob("*.py"):
        if path.parent.name != "render":
            assert not {name.split(".")[0] for name in imports(path)} & {"mitsuba", "drjit"}, path


def test_targets_and_camera_know_no_other_room() -> None:
    for room in ("targets", "camera"):
        for path in (ROOT / room).glob("*.py"):
            assert _rooms_reached(path) <= {room, "choices", "errors", "registry", "store"}, path


def test_the_wall_would_be_seen_to_fall(tmp_path: Path) -> None:
    spy = tmp_path / "spy.py"
    spy.write_text("from testfield.score.camera import true_in_datum\n")
    assert "scene" in _rooms_reached(spy)


def test_a_relative_import_is_no_hole_in_the_wall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import testfield.store.code as code

    monkeypatch.setattr(code, "ROOT", tmp_path / "testfield")
    spy = tmp_path / "testfield/detect/spy.py"
    spy.parent.mkdir(parents=True)
    spy.write_text("from ..score.camera import true_in_datum\n")
    assert "testfield.score.camera" in imports(spy)
