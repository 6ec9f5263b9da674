"""Recipes compared on the same frames: which cases that takes, and what their rows say."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.errors import TestfieldError
from testfield.evaluate.case import Case, case
from testfield.evaluate.compared import BROKEN, TRUTH
from testfield.evaluate.execute import FAILURE
from testfield.evaluate.paired import Difference, difference, together
from testfield.measure.recipe import Recipe

WORK = "testfield.evaluate.compared:compared_row"


@dataclass(frozen=True)
class Metric:
    """A figure of which less is better: its `key` in a row, `title`, `unit`, and that unit over the row's."""

    key: str
    title: str
    unit: str
    scale: float = 1.0


CENTRE = Metric("detection.centre_rms_px", "centre error, rms", "px")
COMMON = Metric("common.centre_rms_px", "centre error of targets that all found, rms", "px")
METRICS = (
    CENTRE,
    COMMON,
    Metric("detection.missed", "targets missed", ""),
    Metric("calibration.corner_error_px", "interior orientation, worst corner", "px"),
    Metric("points.rmse_mm", "check points, RMSE", "um", 1000.0),
)
MATTERS = {"px": 0.001, "um": 1.0, "": 0.5}
"""Differences that matter by unit, where nobody names others."""
STATED = (
    ("detection.centre_anees", "centres"),
    ("calibration.interior_anees", "interior orientation"),
    ("points.anees", "check points"),
)
"""Squared errors over stated covariances, a degree of freedom: 1 where what is stated is true."""


@dataclass(frozen=True)
class Compared:
    """`rows` one a case; `differences` of every recipe but the first from the first, by (recipe, metric's key);
    `summary` one row a recipe; `sanity` one row for each of the two whose outcome is known beforehand."""

    rows: pd.DataFrame
    differences: dict[tuple[str, str], Difference]
    summary: pd.DataFrame
    sanity: pd.DataFrame

    @property
    def sane(self) -> bool:
        """Whether the truth scores zero and what is broken loses to every recipe."""
        truth, broken = (self.sanity.loc[self.sanity.recipe == name, CENTRE.key] for name in (TRUTH, BROKEN))
        own = self.summary[CENTRE.key].dropna()
        return bool(len(truth) and len(broken) and (truth.abs() < 1e-9).all() and (broken.min() > own).all())


def cases_of(scenes: Sequence[Path], recipes: Sequence[Recipe], draws: int) -> list[Case]:
    """Every recipe on every draw of every scene, recipes in turns so that whatever else the machine does slows all; and
    one draw of the two sanity rows.

    Raises `TestfieldError` where there are fewer than two recipes, two have one name, or no draws.
    """
    names = [recipe.name for recipe in recipes]
    if len(recipes) < 2:
        raise TestfieldError(f"{len(recipes)} recipe is nothing to compare", "--recipes", "give two or more")
    for name in names:
        if names.count(name) > 1:
            raise TestfieldError(f"two recipes are called '{name}'", "--recipes", "set `name` in one of them")
    if draws < 1:
        raise TestfieldError(f"value {draws} is too few", "--draws", "give 1 or more")
    found: list[Case] = []
    for scene in scenes:
        table = case(scene)
        name = table.labels["scene"]
        if any(name == other.labels["scene"] for other in found):
            raise TestfieldError(f"two scenes are called '{name}'", str(scene), "set `name` in one of them")
        for draw in range(1, draws + 1):
            found += [
                Case({"scene": name, "draw": draw, "recipe": r.name}, WORK, table.scene, noise_seed=draw, recipe=r)
                for r in recipes
            ]
        for kind in (TRUTH, BROKEN):
            found.append(
                Case(
                    {"scene": name, "draw": 1, "recipe": kind},
                    WORK,
                    table.scene,
                    {"sanity": kind},
                    noise_seed=1,
                    recipe=recipes[0],
                )
            )
    return found


def conclude(rows: pd.DataFrame, recipes: Sequence[str], matters: dict[str, float]) -> Compared:
    """What the rows of `cases_of` say; `matters` by unit, from which difference on it matters."""
    own = rows[rows.recipe.isin(recipes)]
    own = own.assign(**{COMMON.key: of_common(own)})
    keys = [(name, metric) for name in recipes[1:] for metric in METRICS if metric.key in own]
    found = [
        difference(_draws(own, recipes[0], metric), _draws(own, name, metric), matters[metric.unit])
        for name, metric in keys
    ]
    return Compared(
        rows=rows,
        differences={(name, metric.key): one for (name, metric), one in zip(keys, together(found), strict=True)},
        summary=pd.DataFrame([_summary(own[own.recipe == name], name) for name in recipes]),
        sanity=rows[rows.recipe.isin([TRUTH, BROKEN])].reset_index(drop=True),
    )


def of_common(rows: pd.DataFrame) -> pd.Series:
    """Each row's centre error in px, rms over those centres that all recipes with figures measured in the same frames:
    who leaves out what is hard gains nothing by it."""
    found = pd.Series(np.nan, rows.index)
    if "dx_px" not in rows:
        return found
    for _, same in rows[rows.dx_px.notna()].groupby(["scene", "draw"]):
        errors = [_errors(row) for row in same.itertuples()]
        both = pd.concat(errors, axis=1, join="inner").to_numpy(float)
        if len(both):
            square = (both**2).mean(axis=0).reshape(-1, 2).mean(axis=1)
            found[same.index] = np.sqrt(square)
    return found


def _errors(row: Any) -> pd.DataFrame:
    """The errors of a row's centres by station and mark, each once."""
    index = pd.MultiIndex.from_arrays([row.station, row.mark])
    table = pd.DataFrame({"x": row.dx_px, "y": row.dy_px}, index=index)
    return table[~table.index.duplicated()]


def _draws(rows: pd.DataFrame, recipe: str, metric: Metric) -> list[np.ndarray]:
    """The figure of a recipe, scene by scene in their order, draws in order."""
    of = rows[rows.recipe == recipe]
    return [
        pd.to_numeric(of[of.scene == scene].sort_values("draw")[metric.key], errors="coerce").to_numpy(float)
        * metric.scale
        for scene in rows.scene.drop_duplicates()
    ]


def _summary(rows: pd.DataFrame, name: str) -> dict[str, Any]:
    """A recipe's figures over all scenes and draws: means of what there is, failures counted."""
    failed = rows[FAILURE].notna() if FAILURE in rows else pd.Series(False, rows.index)
    keys = [*[m.key for m in METRICS], *[key for key, _ in STATED], "detection.found_fraction"]
    keys += ["detection.wrong_code", "detection.false", "time_detect_s", "time_calibrate_s", "time_reconstruct_s"]
    figures = {k: float(pd.to_numeric(rows[k], errors="coerce").mean()) if k in rows else np.nan for k in keys}
    bias, spread = bias_and_spread(rows[~failed])
    return (
        {"recipe": name, "cases": len(rows), "failed": int(failed.sum())}
        | figures
        | {
            "bias_px": bias,
            "spread_px": spread,
        }
    )


def bias_and_spread(rows: pd.DataFrame) -> tuple[float, float]:
    """What stays of centres' errors over the draws, rms over the centres of all scenes, and what changes; of centres
    that were measured in every draw. With one draw nothing can be told apart."""
    means, variances = [], []
    for _, of_scene in rows.groupby("scene"):
        if len(of_scene) < 2 or "dx_px" not in of_scene:
            continue
        tables = [_errors(row) for row in of_scene.itertuples()]
        errors = pd.concat(tables, axis=1, join="inner").to_numpy(float).reshape(-1, len(tables), 2)
        spread = errors.var(axis=1, ddof=1)
        # The mean of n draws still has an n-th of their variance.
        means.append(errors.mean(axis=1) ** 2 - spread / len(tables))
        variances.append(spread)
    if not means:
        return np.nan, np.nan
    bias, spread = (float(np.sqrt(max(np.concatenate(v).mean(), 0.0))) for v in (means, variances))
    return bias, spread
