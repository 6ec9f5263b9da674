"""Read a scene file. Every complaint names the file, the field and the value."""

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from testfield.errors import Faults, TestfieldError, faults_in
from testfield.scene.declared import expanded_but, with_kinds
from testfield.scene.document import VARY, Document, load_document, read_document
from testfield.scene.named_files import named_file
from testfield.scene.schema import SceneFile
from testfield.scene.sizes import check_sizes
from testfield.store.faults import each_fault_of
from testfield.store.toml_lines import Location, location_of

SEE = "see `testfield schema`"


def load_scene(path: Path) -> SceneFile:
    """The scene in a TOML file, with the files that it includes.

    Raises `TestfieldError` where the file is missing, is not TOML, or fields are unknown, absent or out of range: all
    of them, with their lines.
    """
    return scene_from(load_document(path))


def parse_scene(text: str | bytes, source: str, folder: Path = Path()) -> SceneFile:
    """The scene in a TOML text; `source` is what messages call it, `folder` where the files it names are."""
    return scene_from(read_document(text, source, folder))


def scene_from(document: Document) -> SceneFile:
    """The scene that a document describes. Raises `TestfieldError` as `load_scene` does."""
    source = document.source
    with numbered(document):
        data, strange = expanded_but(deepcopy(document.data), source)
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
    faults = [_numbered(fault, document) for _, fault in strange]
    try:
        scene = SceneFile.model_validate(data).in_folder(document.folder)
    except ValidationError as error:
        # What an entry lacks, and which fields it may have, its kind would have told.
        unknown = tuple(location for location, _ in strange)
        faults += each_fault_of(error, SceneFile, data, "", source, SEE, document.where, unknown)
    if faults:
        # Nothing is built of a wrong scene, so what building would miss is told here.
        faults += [_numbered(fault, document) for fault in _missing_files(data, document)]
        raise Faults(faults)
    with numbered(document):
        check_sizes(scene, source)
    return scene


def _missing_files(data: dict[str, Any], document: Document) -> list[TestfieldError]:
    """Mesh files that a scene names and that are not there."""
    from testfield.scene.meshes import COPIES

    listed = data.get("meshes")
    faults = []
    for k, part in enumerate(listed if isinstance(listed, list) else ()):
        file, name = (part.get("file"), part.get("name")) if isinstance(part, dict) else (None, None)
        if isinstance(file, str) and isinstance(name, str):
            path = named_file(file, f"{COPIES}/{name}{Path(file).suffix}", document.folder)
            if not path.is_file():
                where = f"{document.source}, meshes[{k}].file"
                advice = "paths are relative to the scene file"
                faults.append(TestfieldError(f"value '{path}': no such mesh file", where, advice))
    return faults


@contextmanager
def numbered(document: Document) -> Iterator[None]:
    """Add lines to what is raised within: `source, boards[2].size_mm` becomes `source:14, boards[2].size_mm`, or names
    the included file where that stands."""
    try:
        yield
    except TestfieldError as error:
        faults = [_numbered(fault, document) for fault in faults_in(error)]
        raise (faults[0] if len(faults) == 1 else Faults(faults)) from error


def _numbered(fault: TestfieldError, document: Document) -> TestfieldError:
    head = f"{document.source}, "
    if not fault.where.startswith(head):
        return fault
    place = fault.where.removeprefix(head)
    location = location_of(place)
    if not location or location[0] not in (*document.data, VARY):
        location = _named(place, document.data)
    return TestfieldError(fault.what, document.where(location, place)[1], fault.do) if location else fault


def _named(place: str, data: dict[str, Any]) -> Location:
    """Where the board, bar or station is listed that a place begins with by its name, as in `control bar and A`."""
    for key, listed in data.items():
        for k, entry in enumerate(listed if isinstance(listed, list) else ()):
            name = entry.get("name") if isinstance(entry, dict) else None
            if name and (place == name or place.startswith((f"{name} and ", f"{name}, "))):
                return (key, k)
    return ()


def scene_schema() -> dict[str, Any]:
    """The JSON Schema of scene files, for editors."""
    schema = with_kinds(SceneFile.model_json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "testfield scene", **schema}
