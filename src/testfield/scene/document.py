"""A scene's text with all that it includes, and which value was written where.

A scene's own fields come first, within tables too, then those of the files it includes, in their order. Lists of tables
(boards, stations, lights) are joined in that order; every other list is a value of its own. A file that is included
twice counts once.
"""

import os
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import tomli_w

from testfield.errors import TestfieldError, nearest
from testfield.scene.declared import FIELD, TABLE, with_catalogue
from testfield.store.faults import place_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml
from testfield.store.toml_lines import Lines, Location

INCLUDE = "include"
VARY = "vary"
"""The table that says what `testfield sweep` varies; nothing of the scene itself."""
MOST_FILES = 100


@dataclass(frozen=True)
class Written:
    """One file of a document: what messages call it, its text, and for each list of the document that it has a share
    in, by its keys, where its entries begin and how many there are."""

    source: str
    text: str
    spans: Mapping[Location, tuple[int, int]]

    @cached_property
    def lines(self) -> Lines:
        """Lines of its values."""
        return Lines(self.text)

    def own(self, location: Location) -> Location | None:
        """A location of the document as this file counts it; None where it lies in the entries of another file."""
        depth = next((k for k, key in enumerate(location) if isinstance(key, int)), len(location))
        if depth == len(location):
            return location
        begin, count = self.spans.get(location[:depth], (0, 0))
        number = int(location[depth]) - begin
        return (*location[:depth], number, *location[depth + 1 :]) if 0 <= number < count else None

    def line(self, location: Location) -> int | None:
        """The line on which exactly this value is written."""
        own = self.own(location)
        return None if own is None else self.lines.of.get(own)


@dataclass(frozen=True)
class Document:
    """A scene as a plain table, `data`, that messages call `source`; files that it names are relative to `folder`.
    `changes` were made for one run: values by location, with what messages call each. Kinds `of_catalogue` that it uses
    are declared in `data` like its own."""

    source: str
    folder: Path
    data: dict[str, Any]
    parts: tuple[Written, ...]
    changes: Mapping[Location, str] = field(default_factory=dict)
    of_catalogue: bool = False

    @property
    def alone(self) -> bool:
        """Whether the file holds all of it."""
        return len(self.parts) == 1 and not self.changes and not self.of_catalogue

    @property
    def content(self) -> bytes:
        """A scene file of the same scene that needs no other: its own text where that is one, else written out without
        comments."""
        return (self.parts[0].text if self.alone else tomli_w.dumps(self.data)).encode()

    def where(self, location: Location, said: str = "") -> tuple[tuple[int, int], str]:
        """For sorting, the file's number and line; and `FILE:LINE, PLACE` of a value, or of the table in which it would
        stand. `said` is the place as a message has it."""
        for length in range(len(location), 0, -1):
            if location[:length] in self.changes:
                return (-1, 0), self.changes[location[:length]]
        for length in range(len(location), 0, -1):
            found = self._line(location[:length])
            if found is None:
                continue
            number, line = found
            declared = self._in_kind(location)
            if length < len(location) and declared is not None and declared[0] != number:
                number, line, own = declared
                said = ""
            else:
                own = self.parts[number].own(location) or location
            place = said if said and own == location else place_of(own)
            return (number, line), f"{self.parts[number].source}:{line}, {place}"
        for changed, called in self.changes.items():
            if changed[: len(location)] == location:
                return (-1, 0), called
        return (0, 0), f"{self.source}, {said or place_of(location) or 'file'}"

    def with_values(self, values: Mapping[Location, Any], called: Mapping[Location, str]) -> "Document":
        """The same document with other values. Raises `TestfieldError` where a location leads through a value or past
        the end of a list."""
        data = deepcopy(self.data)
        for location, value in values.items():
            *way, last = location
            inside: Any = data
            try:
                for step in way:
                    inside = inside.setdefault(step, {}) if isinstance(inside, dict) else inside[step]
                inside[last] = deepcopy(value)
            except (TypeError, IndexError, KeyError) as error:
                where = called.get(location, place_of(location))
                raise TestfieldError(
                    "the scene has no such place", where, "name tables and entries of lists"
                ) from error
        return replace(self, data=data, changes={**self.changes, **called})

    def _line(self, location: Location) -> tuple[int, int] | None:
        for number, part in enumerate(self.parts):
            line = part.line(location)
            if line is not None:
                return number, line
        return None

    def _in_kind(self, location: Location) -> tuple[int, int, Location] | None:
        """File, line and location of a value that an entry has from its kind."""
        inside: Any = self.data
        for depth, key in enumerate(location):
            try:
                inside = inside[key]
            except (LookupError, TypeError):
                return None
            if isinstance(inside, dict) and isinstance(inside.get(FIELD), str):
                declared = (TABLE, inside[FIELD], *location[depth + 1 :])
                found = self._line(declared)
                return None if found is None else (*found, declared)
        return None


def load_document(path: Path) -> Document:
    """The document in a scene file, with all that it includes. Raises `TestfieldError` as `read_document` does."""
    content = read_toml(path, "scene file")
    data, parts = _Reader().read(content, str(path), path.parent, (path.resolve(),))
    return Document(str(path), path.parent, data, tuple(parts), of_catalogue=with_catalogue(data))


def read_document(content: str | bytes, source: str, folder: Path = Path()) -> Document:
    """The document in a TOML text that messages call `source`; files that it includes are relative to `folder`.

    Raises `TestfieldError` where it is no TOML, or includes what is not there, is no TOML, or includes it in turn.
    """
    data, parts = _Reader().read(content, source, folder, ())
    return Document(source, folder, data, tuple(parts), of_catalogue=with_catalogue(data))


class _Reader:
    """Reads a text and what it includes; knows what it has read."""

    def __init__(self) -> None:
        self.taken: set[Path] = set()

    def read(
        self, content: str | bytes, source: str, folder: Path, above: tuple[Path, ...]
    ) -> tuple[dict[str, Any], list[Written]]:
        data = parse_toml(content, source)
        text = content if isinstance(content, str) else decoded(content)
        parts = [Written(source, text, _spans(data))]
        names = data.pop(INCLUDE, [])
        data.pop(VARY, None)
        if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
            raise _at(parts[0], "this is no list of files", (INCLUDE,), 'write include = ["cameras.toml"]')
        for k, name in enumerate(names):
            path = Path(os.path.normpath(folder / name))
            here = path.resolve()
            if here in above:
                circle = " includes ".join(one.name for one in (*above[above.index(here) :], here))
                raise _at(parts[0], f"a circle: {circle}", (INCLUDE, k), "leave one of them out")
            if here in self.taken:
                continue
            self.taken.add(here)
            if len(self.taken) > MOST_FILES:
                raise _at(parts[0], f"more than {MOST_FILES} files are included", (INCLUDE, k), "join some of them")
            if not path.is_file():
                beside = [os.path.relpath(one, folder) for one in path.parent.glob("*.toml")]
                raise _at(parts[0], f"no such file: '{name}'", (INCLUDE, k), nearest(name, beside) if beside else "")
            more, others = self.read(read_toml(path, "included file"), str(path), path.parent, (*above, here))
            files_seen_from(more, path.parent, folder)
            begin: dict[Location, int] = {}
            _joined(data, more, (), begin)
            parts += [replace(one, spans=_moved(one.spans, begin)) for one in others]
        return data, parts


def _at(part: Written, what: str, location: Location, do: str) -> TestfieldError:
    return TestfieldError(what, f"{part.source}:{part.lines.at(location) or 1}, {place_of(location)}", do)


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _spans(data: dict[str, Any]) -> dict[Location, tuple[int, int]]:
    found: dict[Location, tuple[int, int]] = {}
    left: list[tuple[Location, Any]] = [((), data)]
    while left:
        location, value = left.pop()
        if isinstance(value, dict):
            left += [((*location, key), one) for key, one in value.items()]
        elif isinstance(value, list):
            found[location] = (0, len(value))
    return found


def _moved(spans: Mapping[Location, tuple[int, int]], begin: Mapping[Location, int]) -> dict[Location, tuple[int, int]]:
    return {at: (first + begin.get(at, 0), count) for at, (first, count) in spans.items()}


def _joined(own: dict[str, Any], other: dict[str, Any], at: Location, begin: dict[Location, int]) -> None:
    """Put what only `other` has into `own`; `begin` gets where entries of `other` begin in joined lists."""
    for key, value in other.items():
        here, mine = (*at, key), own.get(key)
        if mine is None:
            own[key] = value
        elif isinstance(mine, dict) and isinstance(value, dict):
            _joined(mine, value, here, begin)
        elif here[0] != TABLE and _is_list_of_tables(mine) and _is_list_of_tables(value):
            begin[here] = len(mine)
            own[key] = mine + value


def files_seen_from(data: dict[str, Any], there: Path, folder: Path) -> None:
    """Name files that the data of a scene in the folder `there` name as they are seen from another folder."""
    if there.resolve() == folder.resolve():
        return
    if isinstance(data.get(INCLUDE), list):
        data[INCLUDE] = [os.path.relpath(there / name, folder) for name in data[INCLUDE]]
    room, meshes = data.get("room"), data.get("meshes")
    environment = room.get("environment") if isinstance(room, dict) else None
    for part in (*(meshes if isinstance(meshes, list) else ()), environment):
        if isinstance(part, dict) and isinstance(part.get("file"), str) and not Path(part["file"]).is_absolute():
            part["file"] = os.path.relpath(there / part["file"], folder)
