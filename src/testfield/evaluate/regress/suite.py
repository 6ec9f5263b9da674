"""What a regression suite asks for: scenes with changes, recipes, draws of noise, and figures with what matters."""

from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic

from testfield.errors import TestfieldError
from testfield.evaluate.compared import Until
from testfield.measure.recipe import Recipe
from testfield.scene.shipped import find_scene
from testfield.store.faults import faults_of
from testfield.store.sheets import FORMAT
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml

DRAWS, BUDGET, MOST_DRAWS = 8, 32, 10_000
ERROR_RATE = 0.01
ARITHMETIC = 1e-4
"""Part of a figure by which two machines may differ in it though nothing changed: what roundings of radiances leave in
figures (FIGURES.md, Regressions)."""
SEE = "see FORMATS.md, a suite's file"
OF_THE_MACHINE = ("time_", "cpu_", "memory_")
"""How figures begin that belong to a machine as much as to the code."""
FAILURES = "failed"
"""The figure that every suite has: 1 in a draw in which a recipe came to no end, 0 in the others."""


class Better(Enum):
    """Which way a figure should go."""

    LESS = "less"
    MORE = "more"
    SAME = "same"


@dataclass(frozen=True)
class Figure:
    """A figure of a row by its `key`; the difference that `matters`, in the figure's unit or, where `percent`, in
    percent of the baseline's mean; and the scenes that have it by title (empty: all)."""

    key: str
    matters: float
    percent: bool = False
    better: Better = Better.LESS
    scenes: tuple[str, ...] = ()

    @property
    def of_the_machine(self) -> bool:
        """Whether another processor may change it."""
        return self.key.startswith(OF_THE_MACHINE)

    def matters_at(self, level: float) -> float:
        """The difference that matters where the baseline's mean is `level`."""
        return self.matters * abs(level) / 100 if self.percent else self.matters


@dataclass(frozen=True)
class SuiteScene:
    """A scene file with changes, as `case.changed` takes them, and what it is called."""

    path: Path
    title: str
    changes: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True)
class Suite:
    """A suite: every recipe meets every scene under the same draws of noise, numbered from 1.

    `draws` are made before the first look, and more until every figure is decided, `budget` at most; a baseline holds
    as many. `error_rate` is the chance of any false alarm in one check. `arithmetic` is the part of a figure by which
    two machines may differ in it. Of no recipe, each scene is measured as it asks itself.
    """

    name: str
    source: Path
    scenes: tuple[SuiteScene, ...]
    figures: tuple[Figure, ...]
    recipes: tuple[Recipe, ...] = ()
    draws: int = DRAWS
    budget: int = BUDGET
    error_rate: float = ERROR_RATE
    until: Until = Until.RECONSTRUCT
    arithmetic: float = ARITHMETIC

    @staticmethod
    def load(path: Path) -> "Suite":
        """The suite in a TOML file; paths in it are told from its folder.

        Raises `TestfieldError` with every fault, by line, field and value; and where a recipe or a scene is none.
        """
        content = read_toml(path, "suite")
        data = parse_toml(content, str(path))
        try:
            sheet = _Sheet.model_validate(data)
        except pydantic.ValidationError as error:
            raise faults_of(error, _Sheet, data, decoded(content), str(path), SEE) from error
        scenes = tuple(_scene(path, one) for one in sheet.scene)
        suite = Suite(
            name=sheet.name or path.stem,
            source=path,
            scenes=scenes,
            figures=tuple(_figure(one) for one in sheet.figure),
            recipes=tuple(Recipe.load(path.parent / name) for name in sheet.recipes),
            draws=sheet.draws,
            budget=max(sheet.budget, sheet.draws) if "budget" not in data else sheet.budget,
            error_rate=sheet.error_rate,
            until=sheet.until,
            arithmetic=sheet.arithmetic,
        )
        return suite.check()

    def check(self) -> "Suite":
        """The same. Raises `TestfieldError` where names occur twice, the budget is smaller than the first look, or a
        figure is of a scene that is not here."""
        _once([scene.title for scene in self.scenes], f"{self.source}, scene", "set `title` in one of them")
        _once([recipe.name for recipe in self.recipes], f"{self.source}, recipes", "set `name` in one of them")
        _once([figure.key for figure in self.figures], f"{self.source}, figure", "leave one of them out")
        if self.budget < self.draws:
            raise TestfieldError(
                f"value {self.budget}: a budget of {self.draws} or more is wanted, the draws of the first look",
                f"{self.source}, budget",
                "raise it, or lower `draws`",
            )
        titles = {scene.title for scene in self.scenes}
        for figure in self.figures:
            if figure.key == FAILURES:
                raise TestfieldError(
                    f"'{FAILURES}' is in every suite", f"{self.source}, figure", "leave it out of this file"
                )
            for title in figure.scenes:
                if title not in titles:
                    raise TestfieldError(
                        f"no scene here is called '{title}'",
                        f"{self.source}, figure '{figure.key}', scenes",
                        f"scenes here: {', '.join(sorted(titles))}",
                    )
        return self

    def within(self, budget: int | None) -> "Suite":
        """The same with another budget, the first look no later than it. Raises `TestfieldError` for none."""
        if budget is None:
            return self
        if not 2 <= budget <= MOST_DRAWS:
            raise TestfieldError(
                f"value {budget}: with a budget of fewer than 2 draws nothing can be told"
                if budget < 2
                else f"value {budget}: a budget of {MOST_DRAWS} draws at most is wanted",
                "--budget",
                f"give 2 to {MOST_DRAWS} draws of noise",
            )
        return replace(self, budget=budget, draws=min(self.draws, budget))

    def figures_of(self, scene: str) -> tuple[Figure, ...]:
        """The figures that a scene has, and whether its recipe came to an end at all."""
        own = tuple(figure for figure in self.figures if not figure.scenes or scene in figure.scenes)
        return (Figure(FAILURES, 0.05), *own)


def is_suite(data: dict[str, Any]) -> bool:
    """Whether the tables of a file are a suite's, and not a scene's: it says of which figures."""
    return "figure" in data


def baseline_path(suite: Path) -> Path:
    """Where a suite's baseline lies: beside it."""
    return suite.with_name(f"{suite.stem}.baseline.json")


def candidate_path(suite: Path) -> Path:
    """Where a baseline is put that nobody has accepted yet."""
    return suite.with_name(f"{suite.stem}.candidate.json")


def _scene(suite: Path, sheet: "_SceneTable") -> SuiteScene:
    beside = suite.parent / sheet.file
    path = beside if beside.is_file() else find_scene(sheet.file if Path(sheet.file).name == sheet.file else beside)
    title = sheet.title or " ".join([path.stem, *(f"{key}={value}" for key, value in sheet.changes.items())])
    return SuiteScene(path, title, tuple(sheet.changes.items()))


def _figure(sheet: "_FigureTable") -> Figure:
    percent = sheet.matters_percent is not None
    matters = sheet.matters_percent if percent else sheet.matters
    return Figure(sheet.key, float(matters or 0), percent, sheet.better, tuple(sheet.scenes))


def _once(names: list[str], where: str, do: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise TestfieldError(f"'{name}' is here twice", where, do)


Name = Annotated[str, pydantic.Field(min_length=1, max_length=200)]
Matters = Annotated[float, pydantic.Field(gt=0, lt=1e6, allow_inf_nan=False)]


class _SceneTable(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    file: Name
    title: str = pydantic.Field("", max_length=200)
    changes: dict[str, Any] = {}


class _FigureTable(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    key: Name
    matters: Matters | None = None
    matters_percent: Matters | None = None
    better: Better = Better.LESS
    scenes: list[str] = []

    @pydantic.model_validator(mode="after")
    def _one(self) -> "_FigureTable":
        if (self.matters is None) == (self.matters_percent is None):
            raise ValueError("give one of matters and matters_percent")
        return self


class _Sheet(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    format: Literal[1] = FORMAT  # type: ignore[assignment]
    name: str = pydantic.Field("", max_length=200)
    recipes: list[str] = []
    draws: int = pydantic.Field(DRAWS, ge=2, le=MOST_DRAWS)
    budget: int = pydantic.Field(BUDGET, ge=2, le=MOST_DRAWS)
    error_rate: float = pydantic.Field(ERROR_RATE, ge=1e-9, le=0.5)
    until: Until = Until.RECONSTRUCT
    arithmetic: float = pydantic.Field(ARITHMETIC, ge=0, le=0.1)
    scene: list[_SceneTable] = pydantic.Field(min_length=1)
    figure: list[_FigureTable] = pydantic.Field(min_length=1)
