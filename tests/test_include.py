"""A scene of several files is the scene written out, and every fault is told in the file where it stands."""

from pathlib import Path

import pytest
from conftest import IN_FULL, SCENES

from testfield.chain.run import begin
from testfield.errors import TestfieldError
from testfield.evaluate.case import case
from testfield.evaluate.execute import run_name
from testfield.scene.document import load_document
from testfield.scene.load import load_scene

QUICK = IN_FULL.read_text()
HEAD, _, REST = QUICK.partition("[volume]")
BODY, _, STATIONS = REST.partition("[[stations]]")
CAMERA, _, ROOM = BODY.partition("[room]")


def split(folder: Path, **changed: str) -> Path:
    """quick.toml in four files, one of them in a folder of its own and included by another."""
    texts = {
        "cell.toml": f'include = ["parts/camera.toml", "room.toml"]\n{HEAD}[[stations]]{STATIONS}',
        "parts/camera.toml": f'include = ["../volume.toml"]\n[camera]{CAMERA.partition("[camera]")[2]}',
        "volume.toml": f"[volume]{CAMERA.partition('[camera]')[0]}",
        "room.toml": f'include = ["volume.toml"]\n[room]{ROOM}',
    }
    (folder / "parts").mkdir()
    for name, text in (texts | {key.replace("__", "/") + ".toml": value for key, value in changed.items()}).items():
        (folder / name).write_text(text)
    return folder / "cell.toml"


def test_a_scene_in_four_files_is_the_scene_in_one(tmp_path: Path) -> None:
    assert load_scene(split(tmp_path)).in_folder(SCENES) == load_scene(SCENES / "quick.toml")


def test_own_fields_come_first_and_lists_of_tables_are_joined(tmp_path: Path) -> None:
    path = tmp_path / "one.toml"
    path.write_text('include = ["two.toml", "three.toml"]\n[camera]\nk1 = 1\nx = [1]\n[[boards]]\nname = "A"\n')
    (tmp_path / "two.toml").write_text('[camera]\nk1 = 2\nk2 = 2\nx = [2]\n[[boards]]\nname = "B"\n')
    (tmp_path / "three.toml").write_text('include = ["two.toml"]\n[camera]\nk2 = 3\nk3 = 3\n[[boards]]\nname = "C"\n')
    document = load_document(path)
    assert document.data["camera"] == {"k1": 1, "k2": 2, "k3": 3, "x": [1]}
    assert [board["name"] for board in document.data["boards"]] == ["A", "B", "C"]
    assert document.where(("boards", 2, "name"))[1] == f"{tmp_path / 'three.toml'}:6, boards[0].name"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("room", '[room]\nambient_w_m2_sr = 0.6\n[[boards]]\nname = "A"\nsize_mm = 3\nposition_mm = [0, 0, 0]',
         ("room.toml:5, boards[0].size_mm",)),
        ("room", f"[room]{ROOM}\n[cameraa]", ("room.toml", "cameraa", "did you mean 'camera'")),
        ("room", "[room", ("room.toml", "not valid TOML")),
        ("volume", 'include = ["cell.toml"]', ("volume.toml:1, include[0]", "a circle", "cell.toml")),
        ("parts__camera", 'include = ["../volum.toml"]', ("camera.toml:1, include[0]", "did you mean '../volume")),
        ("volume", "include = 3", ("volume.toml:1, include", "[")),
    ],
)  # fmt: skip
def test_a_fault_is_told_in_its_own_file_and_line(name: str, text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(TestfieldError) as refused:
        load_scene(split(tmp_path, **{name: text}))
    said = " ".join(fault.sentence() for fault in getattr(refused.value, "faults", (refused.value,)))
    assert all(word in said for word in words), said


def test_a_fault_in_an_included_kind_is_told_where_the_kind_is_declared(tmp_path: Path) -> None:
    path = split(tmp_path, room='[kinds.wall]\nsize_mm = "large"\n[[boards]]\nname = "B"\nposition_mm = [0, 0, 0]')
    path.write_text(path.read_text() + '\n[[boards]]\nname = "A"\nkind = "wall"\nposition_mm = [0, 0, 0]\n')
    with pytest.raises(TestfieldError, match=r"room\.toml:2, kinds\.wall\.size_mm"):
        load_scene(path)


def test_checks_of_the_world_name_the_included_file(tmp_path: Path) -> None:
    path = split(tmp_path, room=f"[room]{ROOM}".replace("first_code = 21", "first_code = 11"))
    with pytest.raises(TestfieldError, match=r"room\.toml:\d+"):
        begin(path, tmp_path / "run", None, 1)


def test_a_runs_folder_stands_alone_and_its_cases_see_what_is_included(tmp_path: Path) -> None:
    path = split(tmp_path)
    run, _ = begin(path, tmp_path / "run", None, 1)
    before, own = run_name(case(path)), load_scene(path)
    room = (tmp_path / "room.toml").read_text()
    (tmp_path / "room.toml").write_text(room.replace("ambient_w_m2_sr = 0.6", "ambient_w_m2_sr = 0.5"))
    assert run_name(case(path)) != before
    for included in ("room.toml", "volume.toml", "parts/camera.toml"):
        (tmp_path / included).unlink()
    assert load_scene(run.folder / "scene.toml") == own.in_folder(run.folder)


def test_files_that_an_included_file_names_lie_beside_it(tmp_path: Path) -> None:
    hull = (SCENES / "on_a_hull.toml").read_text()
    top, _, mesh = hull.partition("[[meshes]]")
    body, _, rest = mesh.partition("\n[")
    (tmp_path / "bodies/meshes").mkdir(parents=True)
    (tmp_path / "bodies/meshes/hull.stl").write_bytes((SCENES / "meshes/hull.stl").read_bytes())
    (tmp_path / "bodies/hull.toml").write_text(f"[[meshes]]{body}\n")
    (tmp_path / "scene.toml").write_text(f'include = ["bodies/hull.toml"]\n{top}\n[{rest}')
    run, _ = begin(tmp_path / "scene.toml", tmp_path / "run", None, 1)
    assert len(run.world.meshes) == 1
    assert list((tmp_path / "run").rglob("*.stl"))
