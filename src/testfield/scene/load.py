"""Read a scene file. Every complaint names the file, the field and the value."""

import difflib
import json
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from testfield.errors import TestfieldError
from testfield.scene.schema import SceneFile
from testfield.scene.sizes import check_sizes
from testfield.store.toml import parse_toml, read_toml

UNITS = ("mm", "um", "px", "deg", "ms", "dn", "e", "ppm", "m", "cm", "rad", "s", "nm")

BRANCHES = (
    "single",
    "pose",
    "arc",
    "ring",
    "grid",
    "random",
    "on_board",
    "on_mesh",
    "area",
    "point",
    "gradient",
    "map",
)
"""Kinds of stations, targets and lights, which pydantic writes into the places of errors."""


def load_scene(path: Path) -> SceneFile:
    """The scene in a TOML file.

    Raises `TestfieldError` where the file is missing, is not TOML, or a field is unknown, absent or out of range.
    """
    return parse_scene(read_toml(path, "scene file"), str(path), path.parent)


def parse_scene(text: str | bytes, source: str, folder: Path = Path()) -> SceneFile:
    """The scene in a TOML text; `source` is what messages call it, `folder` where the files it names are."""
    data = parse_toml(text, source)
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
        raise _speak(error, source) from error
    check_sizes(scene, source)
    return scene


def scene_schema() -> dict[str, Any]:
    """The JSON Schema of scene files, for editors."""
    schema = SceneFile.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "testfield scene", **schema}


def _speak(error: ValidationError, source: str) -> TestfieldError:
    # A misspelt field is also a missing one; the misspelling is what helps.
    first, *rest = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    place = _place(first["loc"])
    value = json.dumps(first["input"], default=str)
    value = value if len(value) <= 60 else value[:57] + "..."
    more = f" (and {len(rest)} more)" if rest else ""
    if first["type"] == "extra_forbidden":
        known = _known_fields(first["loc"])
        name = str(first["loc"][-1])
        return TestfieldError(f"unknown field (value {value}){more}", f"{source}, {place}", _advice(name, known))
    if first["type"] == "missing":
        others = [_place(e["loc"]) for e in rest if e["type"] == "missing"]
        also = f" (and so are {', '.join(others)})" if others else ""
        return TestfieldError(f"this field is required{also}", f"{source}, {place}", "add it")
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:].replace("valid tuple", "list in brackets")
    return TestfieldError(f"value {value}: {message}{more}", f"{source}, {place}", "see `testfield schema`")


def _place(location: tuple) -> str:
    """`boards[2].size_mm` from pydantic's location, without the union's branch names."""
    text = ""
    for key, before in zip(location, (None, *location), strict=False):
        if isinstance(key, int):
            text += f"[{key}]"
        elif not (isinstance(before, int) and key in BRANCHES) and not (before == "environment" and key in BRANCHES):
            text += f".{key}" if text else str(key)
    return text


def _known_fields(location: tuple) -> list[str]:
    """Names that are allowed where an unknown field stands."""
    models: list[type[BaseModel]] = [SceneFile]
    for key in location[:-1]:
        if isinstance(key, int):
            continue
        inside = [_models(m.model_fields[key].annotation) for m in models if key in m.model_fields]
        found = [m for part in inside for m in part]
        kind = [m for m in models if key in str(m.model_fields.get("generator", m.model_fields.get("kind", "")))]
        models = found or kind or models
    return sorted({name for model in models for name in model.model_fields})


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _advice(name: str, known: list[str]) -> str:
    stem, _, unit = name.rpartition("_")
    if unit in UNITS:
        same = [other for other in known if other.rpartition("_")[0] == stem]
        if same:
            return f"give it in the unit of '{same[0]}'"
    near = difflib.get_close_matches(name, known, n=1)
    return f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(known)}"
