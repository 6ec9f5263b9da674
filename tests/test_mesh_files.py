"""Only the documented formats are read as meshes, within a size, and no archive is unpacked."""

import json
import struct
import zipfile
from pathlib import Path

import pytest

from testfield.errors import TestfieldError
from testfield.scene import mesh_files
from testfield.scene.mesh_files import check_mesh_file
from testfield.scene.meshes import _read


@pytest.mark.parametrize("name", ["a.zip", "a.3mf", "a.stl", "a.glb", "a.obj", "a.step", "a"])
def test_an_archive_is_refused_whatever_it_is_called(name: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.stl", bytes(1 << 20))
    with pytest.raises(TestfieldError, match=name):
        check_mesh_file(tmp_path / name, "meshes[0].file")


def test_a_file_beyond_the_limit_is_refused_with_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_files, "LARGEST_BYTES", 1_000_000)
    (tmp_path / "a.stl").write_bytes(bytes(2_000_000))
    with pytest.raises(TestfieldError, match="2 MB, and 1 MB"):
        check_mesh_file(tmp_path / "a.stl", "meshes[0].file")


def test_a_file_that_promises_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 9000000000\nend_header\n0 0 0\n")
    table = json.dumps({"accessors": [{"count": 10**10, "componentType": 5126, "type": "VEC3"}]}).encode()
    head = b"glTF" + struct.pack("<II", 2, 20 + len(table)) + struct.pack("<I", len(table)) + b"JSON"
    (tmp_path / "a.glb").write_bytes(head + table)
    for name in ("a.ply", "a.glb"):
        with pytest.raises(TestfieldError, match=name):
            check_mesh_file(tmp_path / name, "meshes[0].file")


def test_sound_meshes_pass() -> None:
    for path in (Path(__file__).parents[1] / "scenes/meshes").iterdir():
        if path.suffix in mesh_files.FORMATS:
            check_mesh_file(path, "meshes[0].file")


@pytest.mark.parametrize("corner", ["1 2", "1 2 3 4", ""])
def test_a_mesh_whose_corners_have_not_three_coordinates_is_refused_or_read(corner: str, tmp_path: Path) -> None:
    lines = [f"v {corner}", *(f"v {k} {k * k} {k**3}" for k in range(8)), "f 1 2 3", "f 2 3 9"]
    for first in (lines, [f"v {corner}" if line[0] == "v" else line for line in lines]):
        (tmp_path / "a.obj").write_text("\n".join(first))
        try:
            _read(tmp_path / "a.obj", "meshes[0].file")
        except TestfieldError as error:
            assert "a.obj" in error.sentence()
