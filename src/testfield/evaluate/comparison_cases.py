"""The cases of a comparison: each scene at each value of each factor, each draw of noise, each recipe in turn."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w

from testfield.errors import TestfieldError, faults_in, gather
from testfield.evaluate.case import Case, case, changed
from testfield.evaluate.comparison import Comparison, Factor
from testfield.evaluate.known_rows import BROKEN, TRUTH
from testfield.scene.load import load_scene, parse_scene
from testfield.seeds import seed_of

UNKNOWN = "unknown field"
"""What is said of a field that a scene's schema does not have."""
WORK = "testfield.evaluate.compared:compared_row"


@dataclass(frozen=True)
class Setup:
    """A scene at one value of one factor (`level` counts its values; -1 where nothing is varied)."""

    base: Case
    factor: Factor | None = None
    level: int = -1

    @property
    def labels(self) -> dict[str, Any]:
        """What its cases are called by."""
        named = (
            {"factor": "", "level": -1} if self.factor is None else {"factor": self.factor.name, "level": self.level}
        )
        return {"scene": self.base.labels["scene"], **named}


def cases_of(comparison: Comparison) -> list[Case]:
    """Every recipe on every draw of every setup, and one draw of the two sanity rows of each scene.

    Recipes come in turns, and each draw begins with another one, so that whatever else the machine does slows all.
    Raises `TestfieldError` where two scenes have one name, no scene has a factor, or a value is none.
    """
    recipes = comparison.check().recipes
    found: list[Case] = []
    begun: set[str] = set()
    for setup in setups_of(comparison):
        for draw in range(1, comparison.draws + 1):
            first = (draw - 1) % len(recipes)
            for recipe in (*recipes[first:], *recipes[:first]):
                labels = setup.labels | {"draw": draw, "recipe": recipe.name}
                options = {"until": comparison.until.value}
                noise_seed = noise_of(setup.labels["scene"], draw)
                found.append(
                    replace(setup.base, labels=labels, options=options, noise_seed=noise_seed, recipe=recipe, work=WORK)
                )
        if setup.labels["scene"] not in begun:
            begun.add(setup.labels["scene"])
            for kind in (TRUTH, BROKEN):
                labels = setup.labels | {"draw": 0, "recipe": kind}
                found.append(replace(setup.base, labels=labels, options={"sanity": kind}, work=WORK))
    return found


def noise_of(scene: str, draw: int) -> int:
    """The noise seed of a scene's draw: the same for every recipe and every change of the scene, and another one for
    every other scene, since scenes count as independent even where their stations have the same names."""
    return seed_of(draw, f"noise/{scene}") & 0x7FFFFFFF


def setups_of(comparison: Comparison) -> list[Setup]:
    """Every scene, as it is or at the values of each factor that it has."""
    gather(*(partial(load_scene, scene) for scene in comparison.scenes))
    bases = [case(scene) for scene in comparison.scenes]
    names = [base.labels["scene"] for base in bases]
    for scene, name in zip(comparison.scenes, names, strict=True):
        if names.count(name) > 1:
            raise TestfieldError(f"two scenes are called '{name}'", str(scene), "set `name` in one of them")
    if not comparison.factors:
        return [Setup(base) for base in bases]
    found: dict[str, list[Setup]] = {name: [] for name in names}
    for factor in _unique(comparison):
        absent: list[_Absent] = []
        for base in bases:
            try:
                found[base.labels["scene"]] += _levels(base, factor, comparison)
            except _Absent as error:
                absent.append(error)
        if len(absent) == len(bases):
            raise TestfieldError(
                f"no scene here has a field '{factor.field}' (value {_plain(factor.values[0])!r})",
                f"{comparison.source}, factor",
                absent[0].args[0],
            )
    return [setup for setups in found.values() for setup in setups]


class _Absent(Exception):
    """A scene has no such field; says what to do."""


def _unique(comparison: Comparison) -> Iterator[Factor]:
    names = [factor.name for factor in comparison.factors]
    for factor in comparison.factors:
        if names.count(factor.name) > 1:
            raise TestfieldError(
                f"two factors are called '{factor.name}'", comparison.source, "set `title` in one of them"
            )
        yield replace(factor, values=tuple(_hashable(value) for value in factor.values))


def _hashable(value: Any) -> Any:
    return tuple(_hashable(one) for one in value) if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _levels(base: Case, factor: Factor, comparison: Comparison) -> list[Setup]:
    """A scene at each value of a factor. Raises `_Absent` where it has no such field, and `TestfieldError` for a value
    that the field does not take."""
    found = []
    for level, value in enumerate(factor.values):
        where = f"{comparison.source}, factor '{factor.field}' = {_plain(value)!r}"
        try:
            table = changed(base.scene or {}, {factor.field: _plain(value)})
        except TestfieldError as error:
            raise _Absent(error.do) from error
        try:
            parse_scene(tomli_w.dumps(table), "scene", base.folder or Path())
        except TestfieldError as error:
            said = faults_in(error)[0]
            if UNKNOWN in said.what:
                raise _Absent(said.do) from error
            raise TestfieldError(said.what, f"{where}, scene '{base.labels['scene']}'", said.do) from error
        found.append(Setup(replace(base, scene=table), factor, level))
    return found
