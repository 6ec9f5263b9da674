"""What the rows of a comparison say: differences, ranks, curves, bias and spread, stated uncertainty, failures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from testfield.evaluate.bias import bias_table, centre_errors
from testfield.evaluate.common_noise import noise_table
from testfield.evaluate.curves import curve, in_metrics
from testfield.evaluate.failures import FAILURE, KIND, STAGE, Kind
from testfield.evaluate.known_rows import BROKEN, KNOWN, SHIFT_PX, TRUTH, as_known
from testfield.evaluate.metrics import CENTRE, COMMON, CORNER, METRICS, POINTS, Metric
from testfield.evaluate.paired import Difference, difference, together
from testfield.evaluate.ranks import rank_intervals
from testfield.evaluate.stated import stated_table

SETUP = ["scene", "factor", "level"]
TIMES = ("time_detect_s", "time_calibrate_s", "time_reconstruct_s", "memory_mb")


@dataclass(frozen=True)
class Compared:
    """`rows` one a case; `differences` of every recipe but the first from the first, pooled, by (recipe, metric's key);
    `scenes` the same scene by scene, by (scene, recipe, metric's key); tables of one row a recipe (`summary`), a recipe
    and a metric (`ranks`), a recipe and a kind of error (`bias`), a recipe and what it states (`stated`), a factor's
    level, recipe and metric (`curves`), a case that failed (`failures`), of the two whose outcome is known beforehand
    (`sanity`), and of what common noise is worth (`noise`)."""

    rows: pd.DataFrame
    differences: dict[tuple[str, str], Difference]
    scenes: dict[tuple[str, str, str], Difference]
    summary: pd.DataFrame
    ranks: pd.DataFrame
    bias: pd.DataFrame
    stated: pd.DataFrame
    curves: pd.DataFrame
    failures: pd.DataFrame
    sanity: pd.DataFrame
    noise: pd.DataFrame

    @property
    def sane(self) -> bool:
        """Whether the truth scores zero, and what is broken scores what it was broken by."""
        truth, broken = (_of(self.sanity, name, CENTRE) for name in (TRUTH, BROKEN))
        planted = (broken - SHIFT_PX / np.sqrt(2)).abs() < 1e-9
        centres = bool(len(truth) and len(broken) and (truth.abs() < 1e-9).all() and planted.all())
        return centres and not self.otherwise

    @property
    def otherwise(self) -> list[tuple[str, str, str]]:
        """Scene, row and figure, by its key, that had to come out as it is known and did not."""
        keys = [name.removeprefix(KNOWN) for name in self.sanity if name.startswith(KNOWN)]
        return [
            (row["scene"], row["recipe"], key)
            for row in self.sanity.to_dict("records")
            for key in keys
            if np.isfinite(known := float(row[KNOWN + key])) and not as_known(key, float(row[key]), known)
        ]

    @property
    def lost_to_broken(self) -> dict[str, list[str]]:
        """Recipes that err more, and in which figures by their titles, than what is broken on purpose, which should
        lose to all: in any scene, for what is broken errs by another amount in each."""
        found: dict[str, list[str]] = {}
        for metric in (CENTRE, CORNER, POINTS):
            broken = _of(self.sanity, BROKEN, metric).groupby(self.sanity.scene).min()
            for name in self.summary.recipe:
                own = _of(self.rows, name, metric).groupby(self.rows.scene).mean()
                if (own >= broken.reindex(own.index)).any():
                    found.setdefault(name, []).append(metric.title)
        return found

    @property
    def ground_um_per_px(self) -> float:
        """What a pixel is in space at the targets, the middle of all scenes."""
        column = self.rows.get("ground_mm_per_px", pd.Series(dtype=float))
        return 1000 * float(pd.to_numeric(column, errors="coerce").median())


def conclude(rows: pd.DataFrame, recipes: Sequence[str], matters: Mapping[str, float]) -> Compared:
    """What the rows of `cases_of` say; `matters` by unit, from which difference on it matters."""
    rows = rows.assign(**{name: absent for name, absent in (("factor", ""), ("level", -1)) if name not in rows})
    own = rows[rows.recipe.isin(recipes)].dropna(axis=1, how="all")  # what the known rows alone have is no recipe's
    own = own.assign(**{COMMON.key: of_common(own)})
    metrics = [metric for metric in METRICS if metric.key in own]
    tables = {metric: table_of(own, metric) for metric in metrics}
    figures = {metric: by_scene(table, recipes) for metric, table in tables.items()}
    scenes = list(own.scene.drop_duplicates())
    pooled = {
        (name, metric.key): difference(of[recipes[0]], of[name], matters[metric.unit])
        for name in recipes[1:]
        for metric, of in figures.items()
    }
    alone = {
        (scene, name, metric.key): difference(of[recipes[0]][k : k + 1], of[name][k : k + 1], matters[metric.unit])
        for k, scene in enumerate(scenes)
        for name in recipes[1:]
        for metric, of in figures.items()
    }
    ranks = [rank_intervals(of, matters[m.unit]).assign(figure=m.title, unit=m.unit) for m, of in figures.items()]
    ranked = pd.concat(ranks, ignore_index=True) if ranks else pd.DataFrame()
    return Compared(
        rows=rows,
        differences=dict(zip(pooled, together(list(pooled.values())), strict=True)),
        scenes=dict(zip(alone, together(list(alone.values())), strict=True)),
        summary=pd.DataFrame([_summary(own[own.recipe == name], name, ranked) for name in recipes]),
        ranks=ranked,
        bias=bias_table(own, recipes),
        stated=stated_table(own, recipes),
        curves=in_metrics({metric.title: curve(table, recipes) for metric, table in tables.items()}),
        failures=failures_of(own),
        sanity=rows[rows.recipe.isin([TRUTH, BROKEN])].reset_index(drop=True),
        noise=noise_table(own, recipes),
    )


def why_nothing(rows: pd.DataFrame) -> str | None:
    """Where no row has any figure, why the first did not come to one; None where there are figures."""
    if any(pd.to_numeric(rows[metric.key], errors="coerce").notna().any() for metric in METRICS if metric.key in rows):
        return None
    said = rows[FAILURE].dropna() if FAILURE in rows else pd.Series(dtype=object)
    return str(said.iloc[0]) if len(said) else None


def _of(rows: pd.DataFrame, recipe: str, metric: Metric) -> pd.Series:
    """A recipe's figures in the row's unit, not numbers where its cases failed."""
    own = rows[rows.recipe == recipe]
    return pd.to_numeric(own[metric.key], errors="coerce") if metric.key in own else pd.Series(np.nan, own.index)


def table_of(own: pd.DataFrame, metric: Metric) -> pd.DataFrame:
    """A metric in its unit, a row for each scene, factor, level and draw, a column for each recipe."""
    values = pd.to_numeric(own[metric.key], errors="coerce") * metric.scale
    return own.assign(value=values).pivot(index=[*SETUP, "draw"], columns="recipe", values="value")


def by_scene(table: pd.DataFrame, recipes: Sequence[str]) -> dict[str, list[np.ndarray]]:
    """Of each recipe an array (levels, draws) for each scene."""
    scenes = table.index.unique("scene")
    return {name: [table[name].loc[scene].unstack("draw").to_numpy(float) for scene in scenes] for name in recipes}


def of_common(rows: pd.DataFrame) -> pd.Series:
    """Each row's centre error in px, rms over those centres that all recipes with figures measured in the same frames:
    who leaves out what is hard gains nothing by it."""
    found = pd.Series(np.nan, rows.index)
    if "dx_px" not in rows:
        return found
    for _, same in rows[rows.dx_px.notna()].groupby([*(name for name in SETUP if name in rows), "draw"]):
        errors = [centre_errors(row) for row in same.itertuples()]
        both = pd.concat(errors, axis=1, join="inner").to_numpy(float)
        if len(both):
            square = (both**2).mean(axis=0).reshape(-1, 2).mean(axis=1)
            found[same.index] = np.sqrt(square)
    return found


def failures_of(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each case that failed: scene, factor, level, draw, recipe, stage, kind, and why."""
    names = [*SETUP, "draw", "recipe", STAGE, KIND, FAILURE]
    kept = rows[failed(rows) | (_kind(rows) == Kind.NOT_CONVERGED.value)]
    kept = kept.assign(**{name: None for name in names if name not in kept})[names].reset_index(drop=True)
    going_on = kept[FAILURE].isna()  # a calibration that has not converged is used all the same
    return kept.assign(
        **{STAGE: kept[STAGE].mask(going_on, "calibrate"), FAILURE: kept[FAILURE].mask(going_on, "did not converge")}
    )


def failed(rows: pd.DataFrame) -> pd.Series:
    """Which rows' recipes came to no end."""
    return rows[FAILURE].notna() if FAILURE in rows else pd.Series(False, rows.index)


def _kind(rows: pd.DataFrame) -> pd.Series:
    kinds = rows[KIND] if KIND in rows else pd.Series(None, rows.index, dtype=object)
    return kinds.where(kinds.notna(), failed(rows).map({True: Kind.REFUSED.value, False: ""}))


def _summary(rows: pd.DataFrame, name: str, ranks: pd.DataFrame) -> dict[str, Any]:
    """A recipe's figures over all scenes and draws: means over the draws that count for its rank, in the row's unit;
    medians of times, failures counted by kind."""

    def numbers(key: str) -> pd.Series:
        return pd.to_numeric(rows[key], errors="coerce") if key in rows else pd.Series(np.nan, rows.index)

    kinds = _kind(rows)
    means = ranks[ranks.recipe == name].set_index("figure")["mean"] if len(ranks) else {}
    return (
        {"recipe": name, "cases": len(rows), "failed": int(failed(rows).sum())}
        | {kind.value: int((kinds == kind.value).sum()) for kind in Kind}
        | {metric.key: float(means.get(metric.title, np.nan)) / metric.scale for metric in METRICS}
        | {"detection.found_fraction": float(numbers("detection.found_fraction").mean())}
        | {key: numbers(f"detection.{key}").sum() for key in ("expected", "missed", "wrong_code", "false")}
        | {key: float(numbers(key).median()) for key in TIMES}
    )
