"""Read a scene file. Every complaint names the file, the field and the value."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from testfield.errors import Faults, TestfieldError, faults_in
from testfield.scene.declared import expanded, with_kinds
from testfield.scene.schema import SceneFile
from testfield.scene.sizes import check_sizes
from testfield.store.faults import faults_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml
from testfield.store.toml_lines import Lines, Location

SEE = "see `testfield schema`"


def load_scene(path: Path) -> SceneFile:
    """The scene in a TOML file.

    Raises `TestfieldError` where the file is missing, is not TOML, or fields are unknown, absent or out of range: all
    of them, with their lines.
    """
    return parse_scene(read_toml(path, "scene file"), str(path), path.parent)


def parse_scene(text: str | bytes, source: str, folder: Path = Path()) -> SceneFile:
    """The scene in a TOML text; `source` is what messages call it, `folder` where the files it names are."""
    data = expanded(parse_toml(text, source), source)
    # The kind of a listed station or target need not be said when it is a single one.
    for name in ("stations", "check_targets"):
        for item in data.get(name, []) if isinstance(data.get(name), list) else []:
            if isinstance(item, dict):
                item.setdefault("generator", "single")
    room = data.get("room")
    lights = room.get("lights") if isinstance(room, dict) else None
    for item in lights if isinstance(lights, list) else []:
        if isinstance(item, dict):
            item.setdefault("kind", "area")
    try:
        scene = SceneFile.model_validate(data).in_folder(folder)
    except ValidationError as error:
        raise faults_of(error, SceneFile, data, _text(text), source, SEE) from error
    with numbered(text, source):
        check_sizes(scene, source)
    return scene


@contextmanager
def numbered(content: str | bytes, source: str) -> Iterator[None]:
    """Add lines to what is raised within: `source, boards[2].size_mm` becomes `source:14, boards[2].size_mm`."""
    try:
        yield
    except TestfieldError as error:
        lines, data = Lines(_text(content)), parse_toml(content, source)
        faults = [_numbered(fault, lines, data, source) for fault in faults_in(error)]
        raise (faults[0] if len(faults) == 1 else Faults(faults)) from error


def _numbered(fault: TestfieldError, lines: Lines, data: dict[str, Any], source: str) -> TestfieldError:
    head = f"{source}, "
    if not fault.where.startswith(head):
        return fault
    place = fault.where.removeprefix(head)
    line = lines.of_place(place) or lines.at(_named(place, data))
    return fault if line is None else TestfieldError(fault.what, f"{source}:{line}, {place}", fault.do)


def _named(place: str, data: dict[str, Any]) -> Location:
    """Where the board, bar or station is listed that a place begins with by its name, as in `control bar and A`."""
    for key, listed in data.items():
        for k, entry in enumerate(listed if isinstance(listed, list) else ()):
            name = entry.get("name") if isinstance(entry, dict) else None
            if name and (place == name or place.startswith((f"{name} and ", f"{name}, "))):
                return (key, k)
    return ()


def _text(content: str | bytes) -> str:
    return content if isinstance(content, str) else decoded(content)


def scene_schema() -> dict[str, Any]:
    """The JSON Schema of scene files, for editors."""
    schema = with_kinds(SceneFile.model_json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "testfield scene", **schema}
