"""Which files are read as meshes at all, decided before a reader may unpack or make room for anything."""

import json
import re
from pathlib import Path

from testfield.errors import TestfieldError
from testfield.scene.step_files import STEP, check_step

FORMATS = (".stl", ".obj", ".ply", ".glb", *STEP)
LARGEST_BYTES = 300_000_000
"""Of six million triangles in a binary STL; more than any scene can be lit with."""
HEADER_BYTES = 20_000_000
"""How much of a file is looked at: a GLB's description, a PLY's header."""
ARCHIVES = (b"PK\x03\x04", b"PK\x05\x06", b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"7z\xbc\xaf", b"Rar!", b"\x28\xb5\x2f\xfd")
"""What zip, gzip, bzip2, xz, 7z, rar and zstd files begin with."""


def check_mesh_file(path: Path, where: str) -> None:
    """Raise `TestfieldError` where a file is of no documented format, an archive, or larger than is read; also where
    it says that it holds more than its bytes can."""
    kind, size = path.suffix.lower(), path.stat().st_size
    if kind not in FORMATS:
        known = ", ".join(name[1:].upper() for name in FORMATS if name != ".stp")
        raise TestfieldError(f"value '{path}': '{path.suffix}' is no format of meshes", where, f"give one of {known}")
    if size > LARGEST_BYTES:
        raise TestfieldError(
            f"value '{path}': the file has {size / 1e6:.0f} MB, and {LARGEST_BYTES / 1e6:.0f} MB are read",
            where,
            "give a coarser mesh",
        )
    with path.open("rb") as file:
        begins = file.read(HEADER_BYTES if kind in (".glb", ".ply") else 1000)
    if begins.startswith(ARCHIVES):
        raise TestfieldError(f"value '{path}': this is an archive", where, "unpack it and give the mesh itself")
    if kind in STEP:
        check_step(begins, path, where)
    counts = {".glb": _of_glb, ".ply": _of_ply}.get(kind, lambda _: [])(begins)
    if any(count > size for count in counts):
        raise TestfieldError(
            f"value '{path}': it says that it holds {max(counts)} items, more than its {size} bytes can",
            where,
            "mend it",
        )


def _of_ply(begins: bytes) -> list[int]:
    header = begins.partition(b"end_header")[0]
    return [int(count) for count in re.findall(rb"element\s+\S+\s+(\d{1,18})", header)]


def _of_glb(begins: bytes) -> list[int]:
    """Numbers of elements that its accessors name: where they have no bytes of their own, a reader makes zeros."""
    try:
        length = int.from_bytes(begins[12:16], "little")
        accessors = json.loads(begins[20 : 20 + length]).get("accessors", [])
        return [int(item["count"]) for item in accessors]
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
        return []  # the reader itself says what is wrong with it
