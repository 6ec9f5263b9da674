"""Values of a scene that are set for one run: `camera.focal_length_mm=35`, `boards.A.bow_mm=2`."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import tomli_w

from testfield.errors import Faults, TestfieldError, nearest
from testfield.scene.document import Document
from testfield.store.digests import digest
from testfield.store.toml_lines import Location

OPTION = "--set"
LONGEST_NAME = 80
"""Characters by which changes name a folder; of more, a digest does."""


@dataclass(frozen=True)
class Change:
    """A `value` at a `path`: keys, numbers or names of entries in lists, with dots between."""

    path: str
    value: Any

    @property
    def text(self) -> str:
        """As a person writes it."""
        return f"{self.path}={tomli_w.dumps({'value': self.value}).partition('=')[2].strip()}"

    @staticmethod
    def parse(text: str) -> "Change":
        """The change that a text like `camera.k1=-0.1` asks for: a TOML value or, where it is none, a text. Raises
        `TestfieldError` where it is no such text."""
        path, sign, value = text.partition("=")
        path, value = path.strip(), value.strip()
        if not sign or not value or not all(path.split(".")):
            raise TestfieldError(
                f"value '{text}' sets nothing", OPTION, "write FIELD=VALUE, as camera.focal_length_mm=35"
            )
        try:
            return Change(path, tomllib.loads(f"value = {value}\n")["value"])
        except (tomllib.TOMLDecodeError, RecursionError):
            if value[0] in "[{\"'":
                raise TestfieldError(f"value '{value}' is not valid TOML", f"{OPTION} {path}", "mend it") from None
            return Change(path, value)


def changes_of(values: Mapping[str, Any]) -> tuple[Change, ...]:
    """Changes from a mapping of paths."""
    return tuple(Change(path, value) for path, value in values.items())


def with_changes(document: Document, changes: Iterable[Change], option: str = OPTION) -> Document:
    """The document with these changes, each told in messages by `option` and its text.

    Raises `TestfieldError` where a path leads through a value, or names no entry of a list.
    """
    faults: list[TestfieldError] = []
    for change in changes:
        try:
            location = locate(document.data, change, f"{option} {change.text}")
            document = document.with_values({location: change.value}, {location: f"{option} {change.text}"})
        except TestfieldError as error:
            faults.append(error)
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    return document


def folder_name(changes: Iterable[Change]) -> str:
    """What changes add to the name of a run's folder."""
    name = "".join("-" + re.sub(r"[^A-Za-z0-9_.=+-]+", "_", change.text).strip("_") for change in changes)
    return name if len(name) <= LONGEST_NAME else f"-set-{digest(name)[:12]}"


def locate(data: Any, change: Change, where: str) -> Location:
    """Where in a scene's data a change takes place. Raises `TestfieldError`, at `where`, for an entry of a list that is
    not there."""
    found: list[str | int] = []
    for step in change.path.split("."):
        if isinstance(data, list):
            names = [one.get("name") if isinstance(one, dict) else None for one in data]
            number = int(step) if step.isdigit() and step not in names else -1
            if step in names:
                number = names.index(step)
            if not 0 <= number < len(data):
                known = [str(name) for name in names if name] or [str(k) for k in range(len(data))]
                place = ".".join(map(str, found))
                raise TestfieldError(f"'{place}' has no entry '{step}'", where, nearest(step, known))
            found.append(number)
            data = data[number]
        else:
            found.append(step)
            data = data.get(step, {}) if isinstance(data, dict) else data
    return tuple(found)
