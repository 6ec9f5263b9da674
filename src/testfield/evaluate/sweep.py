"""A sweep: a scene of which some fields are varied, by its own [vary] table or by a file that names the scene."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pydantic

from testfield.errors import TestfieldError, gather, nearest
from testfield.evaluate.case import Case
from testfield.evaluate.sweep_design import MOST_CASES, Design, Levels, combinations, count_of
from testfield.scene.changes import Change, with_changes
from testfield.scene.document import VARY, Document, load_document, read_document
from testfield.scene.load import numbered, scene_from
from testfield.scene.shipped import find_scene
from testfield.store.faults import faults_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml

SEE = "see scenes/README.md"
MOST_DRAWS = 10_000


class _Range(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")

    low: float = pydantic.Field(allow_inf_nan=False)
    high: float = pydantic.Field(allow_inf_nan=False)
    levels: int = pydantic.Field(5, ge=2, le=10_000_000)
    log: bool = False
    whole: bool = False

    @pydantic.model_validator(mode="after")
    def _ordered(self) -> "_Range":
        if self.low >= self.high:
            raise ValueError(f"low {self.low:g} is not below high {self.high:g}")
        if self.log and self.low <= 0:
            raise ValueError(f"low {self.low:g} has no logarithm")
        return self


class _Vary(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")

    design: Design = Design.GRID
    samples: int = pydantic.Field(32, ge=2, le=10_000_000)
    draws: int = pydantic.Field(1, ge=1, le=MOST_DRAWS)
    seed: int = pydantic.Field(1, ge=0)
    fields: dict[str, list[Any] | _Range] = pydantic.Field(min_length=1)


class _Sheet(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")

    scene: str | None = None
    vary: _Vary


@dataclass(frozen=True)
class Sweep:
    """A scene's `document`, the `fields` that are varied by their `design`, and how many `draws` of noise each
    combination gets. `source` is the file that asks for it."""

    document: Document
    fields: Mapping[str, Levels]
    design: Design
    samples: int
    draws: int
    seed: int
    source: str

    @staticmethod
    def load(path: Path) -> "Sweep":
        """The sweep of a scene with [vary], or of a file with `scene` and [vary].

        Raises `TestfieldError`, of all faults, where there is no [vary], a field is none of the scene's, or a value is
        none that it takes.
        """
        path = find_scene(path)
        content = read_toml(path, "scene or sweep file")
        data = parse_toml(content, str(path))
        own = isinstance(data.get("scene"), str)
        if VARY not in data:
            raise TestfieldError("nothing is varied here", str(path), "add [vary.fields] with FIELD = [values]")
        asked = data if own else {VARY: data[VARY]}
        try:
            sheet = _Sheet.model_validate(asked)
        except pydantic.ValidationError as error:
            raise faults_of(error, _Sheet, asked, decoded(content), str(path), SEE) from error
        document = load_document(_scene_beside(path, str(sheet.scene))) if own else load_document(path)
        fields = {name: _levels(one) for name, one in sheet.vary.fields.items()}
        with numbered(read_document(content, str(path), path.parent)):
            empty = [name for name, one in sheet.vary.fields.items() if one == []]
            if empty:
                raise TestfieldError("an empty list varies nothing", f"{path}, vary.fields.{empty[0]}", "add values")
        sweep = Sweep(
            document, fields, sheet.vary.design, sheet.vary.samples, sheet.vary.draws, sheet.vary.seed, str(path)
        )
        return sweep.check()

    @property
    def name(self) -> str:
        """The scene's name."""
        return str(self.document.data.get("name", "scene"))

    @property
    def size(self) -> tuple[int, str]:
        """How many cases there are, and how that comes about."""
        count, how = count_of(self.design, self.fields, self.samples)
        return count * self.draws, how if self.draws == 1 else f"{how}, {self.draws} draws of noise each"

    def check(self) -> "Sweep":
        """The same sweep. Raises `TestfieldError` where its size, a field or a value is impossible."""
        self.points()
        count, how = self.size
        if count > MOST_CASES:
            raise TestfieldError(
                f"{count:,} cases ({how}), and {MOST_CASES:,} are allowed",
                f"{self.source}, vary.draws",
                "give fewer draws",
            )
        scene_from(self.document)
        tried = [
            Change(path, value)
            for path, one in self.fields.items()
            for value in (one.values or (one.at(0.0), one.at(1.0)))
        ]
        gather(*(_Try(self, change) for change in tried))
        return self

    def points(self) -> list[dict[str, Any]]:
        """The values of the fields for each combination."""
        try:
            return combinations(self.design, self.fields, self.samples, self.seed)
        except TestfieldError as error:
            raise TestfieldError(error.what, f"{self.source}, {error.where}", error.do) from error

    def changed(self, values: Mapping[str, Any]) -> Document:
        """The scene's document with these values."""
        return with_changes(self.document, (Change(*item) for item in values.items()), f"{self.source}, vary.fields")

    def cases(self) -> list[Case]:
        """A case for each combination and draw, labelled by the values."""
        found = []
        for number, values in enumerate(self.points()):
            table = self.changed(values).data
            labels = {"scene": self.name, "case": number, **{path: _shown(value) for path, value in values.items()}}
            for draw in range(1, self.draws + 1):
                one = labels if self.draws == 1 else labels | {"draw": draw}
                seed = None if self.draws == 1 else draw
                found.append(Case(labels=one, scene=table, noise_seed=seed, folder=self.document.folder))
        return found


@dataclass(frozen=True)
class _Try:
    """Whether the scene takes a value."""

    sweep: Sweep
    change: Change

    def __call__(self) -> None:
        scene_from(self.sweep.changed({self.change.path: self.change.value}))


def _levels(one: list[Any] | _Range) -> Levels:
    if isinstance(one, list):
        return Levels(values=tuple(one))
    return Levels((), one.low, one.high, one.levels, one.log, one.whole)


def _shown(value: Any) -> Any:
    return str(value) if isinstance(value, (list, dict)) else value


def _scene_beside(path: Path, name: str) -> Path:
    beside = path.parent / name
    if not beside.is_file() and Path(name).name != name:
        there = [one.name for one in beside.parent.glob("*.toml")]
        raise TestfieldError(f"no such scene: '{name}'", f"{path}, scene", nearest(beside.name, there) if there else "")
    return beside if beside.is_file() else find_scene(name)
