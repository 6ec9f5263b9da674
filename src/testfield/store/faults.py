"""What a checked table says is wrong with a person's file, in a person's words: every fault, with its line."""

import json
from collections.abc import Callable, Iterable
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from testfield.errors import Faults, TestfieldError, nearest
from testfield.store.toml_lines import Lines, Location

UNITS = ("mm", "um", "px", "deg", "ms", "dn", "e", "ppm", "m", "cm", "rad", "s", "nm")
LONGEST_VALUE = 60
"""Characters of a value that a sentence repeats."""

WORDS = {
    "missing": "this field is required",
    "bool_type": "true or false is wanted",
    "bool_parsing": "true or false is wanted",
    "string_type": "a text in quotes is wanted",
    "string_too_short": "this text is empty",
    "float_type": "a number is wanted",
    "float_parsing": "a number is wanted",
    "int_type": "a whole number is wanted",
    "int_parsing": "a whole number is wanted",
    "int_from_float": "a whole number is wanted",
    "finite_number": "a finite number is wanted",
    "tuple_type": "a list in brackets is wanted",
    "list_type": "a list in brackets is wanted",
    "model_type": "a table is wanted",
    "model_attributes_type": "a table is wanted",
    "dict_type": "a table is wanted",
}
BOUNDS = {
    "greater_than": ("gt", "more than {} is wanted"),
    "greater_than_equal": ("ge", "{} or more is wanted"),
    "less_than": ("lt", "less than {} is wanted"),
    "less_than_equal": ("le", "{} or less is wanted"),
    "too_short": ("min_length", "a list of {} or more is wanted"),
    "too_long": ("max_length", "a list of at most {} is wanted"),
    "string_too_long": ("max_length", "at most {} characters are wanted"),
    "string_pattern_mismatch": ("pattern", "a text like {} is wanted"),
    "literal_error": ("expected", "one of {} is wanted"),
}

OF_THE_KIND = ("missing", "value_error", "union_tag_invalid", "union_tag_not_found")
"""Errors that may come of a table's kind alone; so may unknown fields where the kind says which there are."""

Where = Callable[[Location], tuple[tuple[int, int], str]]
"""Of a location, the number of its file and the line there, and `FILE:LINE, PLACE`."""


def faults_of(
    error: ValidationError,
    model: type[BaseModel],
    data: Any,
    text: str,
    source: str,
    see: str,
    where: Where | None = None,
) -> Faults:
    """All faults that a model finds in a table, as `each_fault_of` lists them."""
    return Faults(each_fault_of(error, model, data, text, source, see, where))


def each_fault_of(
    error: ValidationError,
    model: type[BaseModel],
    data: Any,
    text: str,
    source: str,
    see: str,
    where: Where | None = None,
    unknown: tuple[Location, ...] = (),
) -> list[TestfieldError]:
    """All faults that a model finds in a table, in the order of their lines, misspelt fields first.

    `data` is the table as read from `text`, a TOML document that messages call `source`; `see` says where fields are
    described. A table of several files tells `where` its values stand. A field that is missing only because its name is
    misspelt in the same table is not named. Of tables at `unknown` places, whose kind nobody knows, only what is wrong
    for itself is named.
    """
    where = where or _in_text(Lines(text), source)
    found: list[tuple[bool, tuple[int, int], int, TestfieldError]] = []
    errors = error.errors(include_url=False)
    misspelt = {_parent(one["loc"]) for one in errors if one["type"] == "extra_forbidden"}
    seen: set[Location] = set()
    for one in errors:
        if one["type"] == "missing" and isinstance(one["loc"][-1], str) and _parent(one["loc"]) in misspelt:
            continue
        if one["type"] == "too_short" and any(_within(other["loc"], one["loc"]) for other in errors):
            continue  # entries with faults of their own do not count, and theirs are named
        location = written_location(one["loc"], data)
        if any(location[: len(place)] == place for place in unknown) and (
            one["type"] in OF_THE_KIND or (one["type"] == "extra_forbidden" and len(location) < len(one["loc"]))
        ):
            continue
        if one["type"] == "missing" and isinstance(location[-1], int):
            location = _parent(location)
        if location in seen:
            continue
        seen.add(location)
        line, place = where(location)
        what, do = _sentence(one, model, see)
        fault = TestfieldError(what, place, do)
        found.append((one["type"] != "extra_forbidden", line, len(found), fault))
    return [fault for *_, fault in sorted(found, key=lambda row: row[:3])]


def _in_text(lines: Lines, source: str) -> Where:
    def where(location: Location) -> tuple[tuple[int, int], str]:
        line = lines.at(location) or 1
        return (0, line), f"{source}:{line}, {place_of(location) or 'file'}"

    return where


def written_location(location: Location, data: Any) -> Location:
    """A location without what pydantic adds to it: the kind of an entry, which is no key of the file."""
    kept: list[str | int] = []
    for k, key in enumerate(location):
        last = k == len(location) - 1
        if isinstance(key, int) or (isinstance(data, dict) and key in data) or (last and isinstance(data, dict)):
            if not (last and isinstance(data, dict) and key in data.values() and key not in data):
                kept.append(key)
            data = _inside(data, key)
    return tuple(kept)


def place_of(location: Location) -> str:
    """`boards[2].size_mm`."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in location).lstrip(".")


def _inside(data: Any, key: str | int) -> Any:
    try:
        return data[key]
    except (LookupError, TypeError):
        return None


def _within(location: Location, other: Location) -> bool:
    return len(location) > len(other) and location[: len(other)] == other


def _parent(location: Location) -> Location:
    return location[:-1]


def _sentence(error: ErrorDetails, model: type[BaseModel], see: str) -> tuple[str, str]:
    kind, context = error["type"], error.get("ctx", {})
    value = json.dumps(error["input"], default=str, ensure_ascii=False)
    value = value if len(value) <= LONGEST_VALUE else value[: LONGEST_VALUE - 3] + "..."
    if kind == "extra_forbidden":
        return f"unknown field (value {value})", _advice(str(error["loc"][-1]), fields_at(model, error["loc"]))
    if kind == "missing":
        if isinstance(error["loc"][-1], int):
            return f"value {value}: this list is too short", see
        return WORDS[kind], "add it"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        key, known = str(context.get("discriminator", "")).strip("'"), context.get("expected_tags", "")
        known = known.replace("'", "") or ", ".join(kinds_at(model, error["loc"]))
        tag = context.get("tag")
        if tag:
            return f"no {key} is called '{tag}'", nearest(str(tag), known.split(", "))
        return f"'{key}' is missing", f"give one of {known}"
    if kind == "literal_error" and isinstance(error["input"], str):
        choices = context["expected"].replace(" or ", ", ").replace("'", "").split(", ")
        return f"value {value} is none of {', '.join(choices)}", nearest(error["input"], choices)
    if kind in BOUNDS:
        name, words = BOUNDS[kind]
        return f"value {value}: {words.format(context[name])}", see
    said = WORDS.get(kind) or error["msg"].removeprefix("Value error, ")
    return f"value {value}: {said[0].lower()}{said[1:]}", see


def _advice(name: str, known: Iterable[str]) -> str:
    stem, _, unit = name.rpartition("_")
    if unit in UNITS:
        same = [other for other in known if other.rpartition("_")[0] == stem]
        if same:
            return f"give it in the unit of '{same[0]}'"
    return nearest(name, known)


def fields_at(model: type[BaseModel], location: Location) -> list[str]:
    """Names that are allowed where an unknown field stands."""
    models = [model]
    for key in location[:-1]:
        if isinstance(key, int):
            continue
        inside = [_models(one.model_fields[key].annotation) for one in models if key in one.model_fields]
        found = [one for part in inside for one in part]
        models = found or [one for one in models if key in _kinds(one)] or models
    return sorted({name for one in models for name in one.model_fields})


def kinds_at(model: type[BaseModel], location: Location) -> list[str]:
    """What an entry may be of, where its kind is wrong."""
    models = [model]
    for key in location:
        if isinstance(key, str):
            models = [m for one in models if key in one.model_fields for m in _models(one.model_fields[key].annotation)]
    return sorted({kind for one in models for kind in _kinds(one)})


def _kinds(model: type[BaseModel]) -> list[str]:
    """The values of the field that tells models of a union apart."""
    fields = [model.model_fields[name] for name in ("generator", "kind") if name in model.model_fields]
    return [str(value) for field in fields for value in get_args(field.annotation)]


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]
