"""What is to be compared: scenes, recipes, draws of noise, factors; from a file or from the command line."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import pydantic

from testfield.errors import TestfieldError, gather
from testfield.evaluate.compared import Until
from testfield.evaluate.metrics import MATTERS
from testfield.measure.recipe import Algorithm, Recipe
from testfield.registry import ALGORITHMS
from testfield.scene.shipped import find_scene
from testfield.store.faults import faults_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml, toml_or_nothing

DRAWS = 5
MOST_DRAWS = 10_000
SEE = "see FORMATS.md, a comparison's file"


@dataclass(frozen=True)
class Factor:
    """A place in scenes, named as `case.changed` takes it, that takes some values one after the other."""

    field: str
    values: tuple[Any, ...]
    title: str = ""

    @property
    def name(self) -> str:
        """What pages call it."""
        return self.title or self.field


@dataclass(frozen=True)
class Comparison:
    """Every recipe meets every scene, at every value of every factor, under the same `draws` of noise.

    `matters` is by unit (px, um, "" for numbers of targets) the difference from which on it matters; `source` is what
    messages call the comparison.
    """

    scenes: tuple[Path, ...]
    recipes: tuple[Recipe, ...]
    draws: int = DRAWS
    factors: tuple[Factor, ...] = ()
    matters: Mapping[str, float] = field(default_factory=lambda: dict(MATTERS))
    until: Until = Until.RECONSTRUCT
    source: str = "command line"

    @staticmethod
    def load(path: Path) -> "Comparison":
        """The comparison in a TOML file; paths in it are relative to it.

        Raises `TestfieldError`, of all faults, where a field is unknown or out of range, and where a recipe or a scene
        is.
        """
        content = read_toml(path, "comparison file")
        data = parse_toml(content, str(path))
        try:
            sheet = _Sheet.model_validate(data)
        except pydantic.ValidationError as error:
            raise faults_of(error, _Sheet, data, decoded(content), str(path), SEE) from error
        scenes: list[Path] = []
        recipes: list[Recipe] = []
        gather(
            *(partial(lambda name: scenes.append(_scene_beside(path, name)), name) for name in sheet.scenes),
            *(partial(lambda name: recipes.append(Recipe.load(path.parent / name)), name) for name in sheet.recipes),
            lambda: recipes.extend(recipes_of({stage: getattr(sheet, stage) for stage in ALGORITHMS}, str(path))),
        )
        return Comparison(
            scenes=tuple(scenes),
            recipes=tuple(recipes),
            draws=sheet.draws,
            factors=tuple(Factor(one.field, tuple(one.values), one.title) for one in sheet.factor),
            matters=MATTERS | {"px": sheet.matters_px, "um": sheet.matters_um},
            until=sheet.until,
            source=str(path),
        )

    def check(self) -> "Comparison":
        """The same. Raises `TestfieldError` where there are fewer than two recipes or no scene, where two recipes have
        one name, or a number is out of range."""
        names = [recipe.name for recipe in self.recipes]
        if not self.scenes:
            raise TestfieldError("no scene is named", self.source, "name a scene file, or one that comes along")
        if len(names) < 2:
            raise TestfieldError(
                f"{len(names)} recipe is nothing to compare", f"{self.source}, --recipes", "give two or more"
            )
        for name in names:
            if names.count(name) > 1:
                raise TestfieldError(
                    f"two recipes are called '{name}'", f"{self.source}, --recipes", "set `name` in one of them"
                )
        if not 1 <= self.draws <= MOST_DRAWS:
            raise TestfieldError(
                f"value {self.draws}: 1 to {MOST_DRAWS} are wanted", f"{self.source}, --draws", "give another number"
            )
        for unit, option in (("px", "--effect-px"), ("um", "--effect-um")):
            if not 0 < self.matters[unit] < 1e6:
                raise TestfieldError(
                    f"value {self.matters[unit]:g} is no difference that can matter",
                    f"{self.source}, {option}",
                    "give one above 0",
                )
        return self


def is_comparison(path: Path) -> bool:
    """Whether a file is a comparison's and not a scene's: it names scenes. Of no file at all it is False."""
    return "scenes" in toml_or_nothing(path)


def recipes_of(named: Mapping[str, Sequence[str]], source: str) -> tuple[Recipe, ...]:
    """Recipes with every combination of the algorithms that are named by stage; a stage that names none keeps its
    default. They are called by what distinguishes them. Raises `TestfieldError` where an algorithm is unknown."""
    stages = [stage for stage in ALGORITHMS if named.get(stage)]
    if not stages:
        return ()
    found = []
    for words in itertools.product(*(named[stage] for stage in stages)):
        own = {stage.removesuffix("s"): Algorithm(word) for stage, word in zip(stages, words, strict=True)}
        recipe = replace(Recipe(name=" + ".join(words)), **own)  # type: ignore[arg-type]
        recipe.check(f"{source}, recipe '{recipe.name}'")
        found.append(recipe)
    return tuple(found)


def factor_of(text: str) -> Factor:
    """The factor in a text FIELD=V1,V2, values as TOML writes them. Raises `TestfieldError` where it is none."""
    name, equals, values = text.partition("=")
    if not equals or not name.strip():
        raise TestfieldError(
            f"value '{text}' is no factor", "--factor", "write FIELD=VALUE,VALUE, as camera.f_number=4,8"
        )
    found = parse_toml(f"values = [{values}]", f"--factor {name.strip()}")["values"]
    if not found:
        raise TestfieldError(f"factor '{name.strip()}' has no values", "--factor", "write FIELD=VALUE,VALUE")
    return Factor(name.strip(), tuple(found))


def _scene_beside(path: Path, name: str) -> Path:
    beside = path.parent / name
    return beside if beside.is_file() else find_scene(name if Path(name).name == name else beside)


class _FactorTable(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    field: str = pydantic.Field(min_length=1)
    values: list[Any] = pydantic.Field(min_length=1, max_length=1000)
    title: str = ""


class _Sheet(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    scenes: list[str] = pydantic.Field(min_length=1)
    recipes: list[str] = []
    centroids: list[str] = []
    calibrators: list[str] = []
    reconstructors: list[str] = []
    draws: int = pydantic.Field(DRAWS, ge=1, le=MOST_DRAWS)
    matters_px: float = pydantic.Field(MATTERS["px"], gt=0, lt=1e6)
    matters_um: float = pydantic.Field(MATTERS["um"], gt=0, lt=1e6)
    until: Until = Until.RECONSTRUCT
    factor: list[_FactorTable] = []
