"""What a scene declares once under [kinds] and uses by name: boards, cameras, bars, targets, stations of one kind; and
what the catalogue declares for all scenes."""

from copy import deepcopy
from typing import Any

from testfield.errors import Faults, TestfieldError, nearest
from testfield.scene.catalogue import catalogue
from testfield.store.faults import place_of
from testfield.store.toml_lines import Location

Strange = tuple[Location, TestfieldError]
"""A place in a scene and what is wrong with the kind that stands there."""

TABLE, FIELD = "kinds", "kind"
USERS = ("boards", "cameras", "scale_bars", "check_targets", "measuring_lines", "stations")
"""Lists whose entries may be of a declared kind."""
CAMERA = "camera"
"""The table that may be, too; the `sensor` of its kind is the scene's."""
LIGHTS = ("area", "point")
"""Kinds of lights that are not declared anywhere."""
CATALOGUES = {"boards": "boards", "cameras": "cameras", CAMERA: "cameras", "lights": "lights"}
"""Which list of the catalogue serves which users."""


def with_catalogue(data: dict[str, Any]) -> bool:
    """Declare in a scene's data, under [kinds], what it uses of the catalogue; whether that was anything."""
    kinds = data.get(TABLE, {})
    found: dict[str, Any] = {}
    for users, entries in _entries(data).items():
        known = catalogue(CATALOGUES[users]) if users in CATALOGUES else {}
        for entry in entries:
            name = entry.get(FIELD) if isinstance(entry, dict) else None
            if isinstance(name, str) and name in known and isinstance(kinds, dict) and name not in kinds:
                found[name] = deepcopy(known[name]["fields"])
    if found:
        data[TABLE] = {**kinds, **found}
    return bool(found)


def expanded(data: dict[str, Any], source: str) -> dict[str, Any]:
    """A scene's data in which every entry of a declared kind has the fields of its kind; its own come first, within
    tables too. Raises `TestfieldError` for kinds that are not declared."""
    whole, faults = expanded_but(data, source)
    if faults:
        raise faults[0][1] if len(faults) == 1 else Faults([fault for _, fault in faults])
    return whole


def expanded_but(data: dict[str, Any], source: str) -> tuple[dict[str, Any], list[Strange]]:
    """A scene's data as `expanded` gives them, where entries of a kind that is not declared stay without it, and the
    places and faults of these. Raises `TestfieldError` where [kinds] is no list of tables."""
    strange: list[Strange] = []
    kinds = data.get(TABLE)
    if kinds is None:
        kinds = {}
    if not isinstance(kinds, dict) or not all(isinstance(kind, dict) for kind in kinds.values()):
        raise TestfieldError("this is no list of tables", f"{source}, {TABLE}", "write [kinds.NAME] and its fields")
    declared: dict[str, Any] = kinds

    def of_kind(entry: Any, location: Location, users: str) -> Any:
        try:
            return _of_kind(entry, declared, f"{source}, {place_of(location)}", users)
        except TestfieldError as fault:
            strange.append((location, fault))
            return {key: value for key, value in entry.items() if key != FIELD}

    whole = {key: value for key, value in data.items() if key != TABLE}
    for users in USERS:
        entries = whole.get(users)
        if isinstance(entries, list):
            whole[users] = [of_kind(one, (users, k), users) for k, one in enumerate(entries)]
    room = whole.get("room")
    if isinstance(room, dict) and isinstance(room.get("lights"), list):
        lights = [
            one if isinstance(one, dict) and one.get(FIELD) in LIGHTS else of_kind(one, ("room", "lights", k), "lights")
            for k, one in enumerate(room["lights"])
        ]
        whole["room"] = room | {"lights": lights}
    if isinstance(whole.get(CAMERA), dict) and FIELD in whole[CAMERA]:
        camera = of_kind(whole[CAMERA], (CAMERA,), CAMERA)
        sensor, own = camera.pop("sensor", {}), whole.get("sensor", {})
        whole[CAMERA] = camera
        if sensor and isinstance(own, dict):
            whole["sensor"] = _merged(sensor, own)
    return whole, strange


def with_kinds(schema: dict[str, Any]) -> dict[str, Any]:
    """The JSON Schema of scenes with what `expanded` takes."""
    told = {"description": "Declared once: fields of what is of this kind, by its name.", "type": "object"}
    told["additionalProperties"] = {"type": "object"}  # type: ignore[assignment]
    files = {
        "description": "Files whose fields and parts count as this scene's own, where it has none.",
        "type": "array",
    }
    files["items"] = {"type": "string"}  # type: ignore[assignment]
    varied = {"description": "What `testfield sweep` varies; no part of the scene.", "type": "object"}
    properties = schema["properties"] | {"include": files, "vary": varied, TABLE: told}
    parts = dict(schema["$defs"])
    lists = [schema["properties"][users]["items"] for users in USERS]
    for reference in (one for items in lists for one in _references(items)):
        parts[reference] = _with_kind(parts[reference], "A kind declared under [kinds], or of the catalogue.")
    parts["CameraPart"] = _with_kind(parts["CameraPart"], "A kind declared under [kinds], or of the catalogue.")
    return schema | {"properties": properties, "$defs": parts}


def _with_kind(part: dict[str, Any], description: str) -> dict[str, Any]:
    return part | {"properties": part["properties"] | {FIELD: {"description": description, "type": "string"}}}


def _entries(data: dict[str, Any]) -> dict[str, list[Any]]:
    room, camera = data.get("room"), data.get(CAMERA)
    found = {users: data[users] for users in USERS if isinstance(data.get(users), list)}
    if isinstance(room, dict) and isinstance(room.get("lights"), list):
        found["lights"] = room["lights"]
    return found | {CAMERA: [camera]}


def _of_kind(entry: Any, kinds: dict[str, Any], where: str, users: str) -> Any:
    if not isinstance(entry, dict) or FIELD not in entry:
        return entry
    name, own = entry[FIELD], {key: value for key, value in entry.items() if key != FIELD}
    if not isinstance(name, str) or name not in kinds:
        raise TestfieldError(f"no kind is declared as '{name}'", f"{where}.{FIELD}", _advice(str(name), kinds, users))
    return _merged(kinds[name], own)


def _advice(name: str, kinds: dict[str, Any], users: str) -> str:
    if users not in CATALOGUES:
        return nearest(name, kinds)
    known = [*kinds, *catalogue(CATALOGUES[users]), *(LIGHTS if users == "lights" else ())]
    near = nearest(name, known)
    if near.startswith("did"):
        return near
    declared = f"declared here: {', '.join(kinds)}; " if kinds else ""
    return f"{declared}`testfield list {CATALOGUES[users]}` shows the catalogue"


def _merged(kind: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    both = dict(kind)
    for key, value in own.items():
        below = both.get(key)
        both[key] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return both


def _references(items: dict[str, Any]) -> list[str]:
    found = [items, *items.get("oneOf", []), *items.get("anyOf", [])]
    return [one["$ref"].rpartition("/")[2] for one in found if "$ref" in one]
