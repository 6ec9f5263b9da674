"""What a scene declares once under [kinds] and uses by name: boards, cameras, bars, targets, stations of one kind."""

from typing import Any

from testfield.errors import TestfieldError, nearest

TABLE, FIELD = "kinds", "kind"
USERS = ("boards", "cameras", "scale_bars", "check_targets", "measuring_lines", "stations")
"""Lists whose entries may be of a declared kind."""


def expanded(data: dict[str, Any], source: str) -> dict[str, Any]:
    """A scene's data in which every entry of a declared kind has the fields of its kind; its own come first, within
    tables too. Raises `TestfieldError` for a kind that is not declared."""
    kinds = data.get(TABLE)
    if kinds is None:
        kinds = {}
    if not isinstance(kinds, dict) or not all(isinstance(kind, dict) for kind in kinds.values()):
        raise TestfieldError("this is no list of tables", f"{source}, {TABLE}", "write [kinds.NAME] and its fields")
    whole = {key: value for key, value in data.items() if key != TABLE}
    for users in USERS:
        entries = whole.get(users)
        if isinstance(entries, list):
            whole[users] = [_of_kind(entry, kinds, f"{source}, {users}[{k}]") for k, entry in enumerate(entries)]
    return whole


def with_kinds(schema: dict[str, Any]) -> dict[str, Any]:
    """The JSON Schema of scenes with what `expanded` takes."""
    told = {"description": "Declared once: fields of what is of this kind, by its name.", "type": "object"}
    told["additionalProperties"] = {"type": "object"}  # type: ignore[assignment]
    files = {
        "description": "Files whose fields and parts count as this scene's own, where it has none.",
        "type": "array",
    }
    files["items"] = {"type": "string"}  # type: ignore[assignment]
    properties = schema["properties"] | {"include": files, TABLE: told}
    parts = dict(schema["$defs"])
    for users in USERS:
        items = schema["properties"][users]["items"]
        for reference in _references(items):
            part = parts[reference]
            kind = {"description": "A kind declared under [kinds].", "type": "string"}
            parts[reference] = part | {"properties": part["properties"] | {FIELD: kind}}
    return schema | {"properties": properties, "$defs": parts}


def _of_kind(entry: Any, kinds: dict[str, Any], where: str) -> Any:
    if not isinstance(entry, dict) or FIELD not in entry:
        return entry
    name, own = entry[FIELD], {key: value for key, value in entry.items() if key != FIELD}
    if not isinstance(name, str) or name not in kinds:
        raise TestfieldError(f"no kind is declared as '{name}'", f"{where}.{FIELD}", nearest(str(name), kinds))
    return _merged(kinds[name], own)


def _merged(kind: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    both = dict(kind)
    for key, value in own.items():
        below = both.get(key)
        both[key] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return both


def _references(items: dict[str, Any]) -> list[str]:
    found = [items, *items.get("oneOf", []), *items.get("anyOf", [])]
    return [one["$ref"].rpartition("/")[2] for one in found if "$ref" in one]
