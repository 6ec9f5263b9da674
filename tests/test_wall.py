"""Which room may import which: no circle, no arrow that runs back up, and no way from the measuring side to the truth.

Imports count wherever they stand: inside functions, under conditions, and relative ones.
"""

from pathlib import Path

import pytest

from testfield.store.code import ROOT, imports

GROUND = ("errors", "version", "seeds", "registry", "choices", "store")
TYPES = ("targets", "camera")
MEASURING = ("characterise", "detect", "adjust", "calibrate", "reconstruct", "uncertainty", "measure")
TRUE_SIDE = ("scene", "render", "sensor", "simulate", "score")
RESULTS = (*GROUND, *TYPES, "statistics", *MEASURING, *TRUE_SIDE)
"""All that a run is made of."""

MAY_IMPORT: dict[str, tuple[str, ...]] = {
    "errors": (),
    "version": (),
    "seeds": (),
    "registry": ("errors",),
    "choices": ("registry",),
    "store": ("errors", "version"),
    "cluster": ("errors", "version", "registry", "store"),
    "statistics": ("errors", "seeds", "store"),
    "targets": GROUND,
    "camera": GROUND,
    # The measuring side.
    "characterise": (*GROUND, "camera"),
    "detect": (*GROUND, *TYPES),
    "adjust": (*GROUND, "camera"),
    "calibrate": (*GROUND, *TYPES, "statistics", "detect", "adjust"),
    "reconstruct": (*GROUND, *TYPES, "statistics", "detect", "adjust", "calibrate"),
    "uncertainty": (*GROUND, *TYPES, "statistics", "detect", "calibrate", "reconstruct"),
    "measure": (*GROUND, *TYPES, "statistics", "detect", "calibrate", "reconstruct", "uncertainty"),
    # The truth.
    "sensor": (*GROUND, "camera"),
    "scene": (*GROUND, *TYPES, "sensor"),
    "render": (*GROUND, *TYPES, "scene"),
    "simulate": (*GROUND, *TYPES, "detect", "scene"),
    # Both.
    "score": (*GROUND, *TYPES, "statistics", *MEASURING, "scene"),
    "plan": (*GROUND, *TYPES, "statistics", "detect", "adjust", "calibrate", "scene", "simulate", "score"),
    # What is authored is seen with what is predicted of it, and a finished run with what came of it.
    "author": (*GROUND, *TYPES, *MEASURING, "scene", "sensor", "score", "plan"),
    "report": (*GROUND, *TYPES, "statistics", *MEASURING, "scene", "score", "simulate", "plan", "author"),
    "chain": (*RESULTS, "report"),
    "evaluate": (*RESULTS, "report", "chain"),
    "certify": (*RESULTS, "evaluate"),
    "bench": (*RESULTS, "plan", "cluster", "report", "chain", "evaluate", "certify"),
    "study": (*RESULTS, "report", "chain", "evaluate", "bench"),
    "api": (*RESULTS, "plan", "author", "report", "chain", "evaluate"),
    "cli": (*RESULTS, "plan", "author", "cluster", "report", "chain", "evaluate", "certify", "bench", "study", "api"),
    "__init__": ("version", "api"),
    "__main__": ("cli",),
}
"""What a room may import, rooms in their order: each stands on earlier ones only.

A run writes its own page, so `report` stands under `chain`: it knows types and never runs anything.
"""


def room_of(path: Path) -> str:
    """The folder or the module below the package that a file belongs to."""
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def rooms_imported(path: Path) -> set[str]:
    """Rooms that a file imports, its own aside."""
    names = [name.split(".") for name in imports(path)]
    there = {parts[1] for parts in names if parts[0] == "testfield" and len(parts) > 1}
    rooms = {name for name in there if (ROOT / name).is_dir() or (ROOT / f"{name}.py").is_file()}
    return rooms - ({room_of(path)} if ROOT in path.parents else set())


def test_every_room_is_in_the_table() -> None:
    assert {room_of(path) for path in ROOT.rglob("*.py")} == set(MAY_IMPORT)


def test_every_room_imports_only_what_the_table_allows() -> None:
    wrong = [
        f"{path.relative_to(ROOT)} -> {room}"
        for path in sorted(ROOT.rglob("*.py"))
        for room in sorted(rooms_imported(path))
        if room not in MAY_IMPORT.get(room_of(path), ())
    ]
    assert not wrong


def test_the_table_has_no_circle_and_no_arrow_that_runs_back_up() -> None:
    order = list(MAY_IMPORT)
    for place, (room, below) in enumerate(MAY_IMPORT.items()):
        assert set(below) <= set(order[:place]), room


def test_the_package_does_not_know_the_studies_that_use_it() -> None:
    for path in ROOT.rglob("*.py"):
        assert not {name for name in imports(path) if name.split(".")[0] == "testfield_studies"}, path


@pytest.mark.parametrize("room", MEASURING)
def test_the_measuring_side_never_reaches_the_truth(room: str) -> None:
    reached, queue = set(), [room]
    while queue:
        below = set(MAY_IMPORT[queue.pop()]) - reached
        reached |= below
        queue += below
    assert not reached & set(TRUE_SIDE)


def test_only_render_imports_mitsuba_and_drjit() -> None:
    for path in ROOT.rglob("*.py"):
        if room_of(path) != "render":
            assert not {name.split(".")[0] for name in imports(path)} & {"mitsuba", "drjit"}, path


def test_an_import_inside_a_function_and_a_relative_one_are_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import testfield.store.code as code

    late = tmp_path / "late.py"
    late.write_text("def f():\n    from testfield.score.camera import true_in_datum\n    return true_in_datum\n")
    assert rooms_imported(late) == {"score"}
    monkeypatch.setattr(code, "ROOT", tmp_path / "testfield")
    spy = tmp_path / "testfield/detect/spy.py"
    spy.parent.mkdir(parents=True)
    spy.write_text("from ..score.camera import true_in_datum\n")
    assert "testfield.score.camera" in imports(spy)
