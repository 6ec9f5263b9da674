"""The cases of a suite: each scene under each draw of noise, measured by each recipe; and the figures of their rows."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from testfield.errors import TestfieldError, faults_in
from testfield.evaluate.case import Case, case, changed, scene_table
from testfield.evaluate.comparison_cases import WORK
from testfield.evaluate.failures import FAILURE
from testfield.evaluate.keys import file_digests
from testfield.evaluate.regress.suite import FAILURES, Suite, SuiteScene
from testfield.measure.recipe import Recipe
from testfield.scene.declared import expanded
from testfield.scene.load import parse_scene
from testfield.store.digests import digest

OWN = "as the scene asks"
"""What the recipe is called where a suite names none."""


@dataclass(frozen=True)
class Setup:
    """A scene of a suite measured by one recipe (None: as the scene asks); `scene_digest` is of all
    that the scene is."""

    title: str
    base: Case
    recipe: Recipe | None
    scene_digest: str

    @property
    def recipe_name(self) -> str:
        """What the recipe is called."""
        return OWN if self.recipe is None else self.recipe.name

    @property
    def name(self) -> tuple[str, str]:
        """Scene and recipe."""
        return self.title, self.recipe_name


def setups_of(suite: Suite) -> list[Setup]:
    """Every scene with every recipe. Raises `TestfieldError` where a scene is none, or a change does not suit it."""
    found = []
    for scene in suite.scenes:
        base = _base(suite, scene)
        # Of what the file says, not of how: a board declared once is the board written out.
        whole = digest(expanded(base.scene or {}, str(scene.path)), file_digests(base))
        found += [Setup(scene.title, base, recipe, whole) for recipe in suite.recipes or (None,)]
    return found


def cases_of(setups: Iterable[Setup], draws: Iterable[int], suite: Suite, role: str) -> list[Case]:
    """Each setup under each draw; `role` keeps a check's rows apart from those of the baseline it is held against."""
    draws = list(draws)
    return [
        replace(
            setup.base,
            labels={"scene": setup.title, "recipe": setup.recipe_name, "draw": draw, "role": role},
            options={"until": suite.until.value},
            noise_seed=draw,
            recipe=setup.recipe,
            work=WORK,
        )
        for setup in setups
        for draw in draws
    ]


def values_of(rows: pd.DataFrame, name: tuple[str, str], key: str, draws: Sequence[int]) -> np.ndarray | None:
    """(draws,) a figure of a setup in each of the draws, not a number where there is none; None where no row has it."""
    own = rows[(rows.scene == name[0]) & (rows.recipe == name[1])].set_index("draw").reindex(list(draws))
    failed = own[FAILURE].notna() if FAILURE in own else pd.Series(False, own.index)
    if key == FAILURES:
        return failed.to_numpy(float)
    if key not in own or own[key].map(lambda one: isinstance(one, (str, list, np.ndarray))).any():
        return None
    return pd.to_numeric(own[key], errors="coerce").to_numpy(float)


def why_failed(rows: pd.DataFrame, name: tuple[str, str]) -> str:
    """What the first draw of a setup says that failed; empty where none did."""
    own = rows[(rows.scene == name[0]) & (rows.recipe == name[1])]
    said = own[FAILURE].dropna() if FAILURE in own else own.iloc[:0, 0]
    return str(said.iloc[0]) if len(said) else ""


def numbers_of(rows: pd.DataFrame, name: tuple[str, str]) -> list[str]:
    """Keys of all numbers that a setup's rows have."""
    own = rows[(rows.scene == name[0]) & (rows.recipe == name[1])]
    labels = ("scene", "recipe", "draw", "role")
    return sorted(
        key for key in own if key not in labels and pd.api.types.is_numeric_dtype(own[key]) and own[key].notna().any()
    )


def _base(suite: Suite, scene: SuiteScene) -> Case:
    table: dict[str, Any] = scene_table(scene.path)
    where = f"{suite.source}, scene '{scene.title}', changes"
    try:
        table = changed(table, dict(scene.changes))
    except TestfieldError as error:
        raise TestfieldError(error.what, f"{where}, {error.where}", error.do) from error
    try:
        parse_scene(tomli_w.dumps(table), str(scene.path), scene.path.parent)
    except TestfieldError as error:
        if not scene.changes:
            raise
        said = faults_in(error)[0]
        raise TestfieldError(said.what, f"{where} ({said.where})", said.do) from error
    return replace(case(table, labels={}), folder=scene.path.resolve().parent)
