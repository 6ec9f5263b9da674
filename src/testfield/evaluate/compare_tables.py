"""The tables of a comparison, for pages, papers, pull requests and programs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from testfield.evaluate.compare import Compared
from testfield.evaluate.compare_floor import Floor
from testfield.evaluate.compared_columns import LISTS
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.curves import axis_of
from testfield.evaluate.failures import FAILURE, KIND, STAGE, Kind
from testfield.evaluate.metrics import METRICS
from testfield.evaluate.paired import Difference
from testfield.store.atomic import whole
from testfield.store.text import write_text

TITLES = {metric.key: metric for metric in METRICS}


def tables_of(compared: Compared, comparison: Comparison, floor: Floor) -> dict[str, pd.DataFrame]:
    """By the name of their files: differences (`comparison`), the same scene by scene, recipes, ranks, common
    noise, bias and spread, stated uncertainty, curves over factors, failures."""
    return {
        "comparison": differences_table(compared, floor),
        "scenes": scenes_table(compared, floor),
        "recipes": compared.summary,
        "ranks": ranks_table(compared, floor),
        "noise": compared.noise,
        "bias": compared.bias,
        "stated": compared.stated,
        "curves": curves_table(compared, comparison),
        "failures": compared.failures,
    }


def differences_table(compared: Compared, floor: Floor) -> pd.DataFrame:
    """Every pooled difference in a row: figure, recipe, both means, difference with its interval, what is said, on
    which side of the floor, and how much narrower common noise makes it."""
    return pd.DataFrame(
        [{"recipe": recipe} | _row(one, key, floor) for (recipe, key), one in compared.differences.items()]
    )


def scenes_table(compared: Compared, floor: Floor) -> pd.DataFrame:
    """The same scene by scene."""
    return pd.DataFrame(
        [
            {"scene": scene, "recipe": recipe} | _row(one, key, floor)
            for (scene, recipe, key), one in compared.scenes.items()
        ]
    )


def ranks_table(compared: Compared, floor: Floor) -> pd.DataFrame:
    """Ranks, with the side of the floor on which each mean stands."""
    by_title = {metric.title: metric for metric in METRICS}
    sides = [floor.side(by_title[row.figure], row.mean) for row in compared.ranks.itertuples()]
    return compared.ranks.assign(floor=sides)


def curves_table(compared: Compared, comparison: Comparison) -> pd.DataFrame:
    """Curves with the values of their factors beside the levels: `value` as text, `at` where it lies on an axis."""
    curves = compared.curves
    values = {factor.name: factor.values for factor in comparison.factors}
    levels = list(zip(curves.factor, curves.level, strict=True)) if len(curves) else []
    value = [str(values[factor][level]) for factor, level in levels]
    at = [axis_of(values[factor])[0][level] for factor, level in levels]
    return curves.assign(value=value, at=at)


def _row(one: Difference, key: str, floor: Floor) -> dict[str, Any]:
    metric, (low, high) = TITLES[key], one.estimate.interval()
    return {
        "figure": metric.title,
        "unit": metric.unit,
        "first": one.first,
        "this": one.other,
        "difference": one.estimate.value,
        "low": low,
        "high": high,
        "matters from": one.matters,
        "p (Holm)": one.chance,
        "p equivalent (Holm)": one.chance_equivalent,
        "verdict": one.word.value,
        "floor": floor.side(metric, one.estimate.value),
        "draws": one.draws,
        "scenes": one.scenes,
        "unpaired over paired": one.unpaired_u / one.estimate.u if one.estimate.u > 0 else float("nan"),
    }


def shown(tables: Mapping[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    """The same as a page shows them: what a reader looks for, under words."""
    differences = {"figure": "figure", "recipe": "recipe", "first": "first", "this": "this"}
    differences |= {"difference": "difference", "low": "from", "high": "to", "verdict": "verdict", "floor": "floor"}
    differences |= {"draws": "draws", "unpaired over paired": "unpaired"}
    ranks = {name: name for name in ("figure", "recipe", "mean", "floor", "rank", "best", "worst", "draws")}
    ranks |= {"of_draws": "of"}
    counts = {"recipe": "recipe", "cases": "cases", "expected": "targets expected", "missed": "missed"}
    counts |= {"wrong_code": "wrong codes", "false": "false"} | {kind.value: kind.value for kind in Kind}
    times = {"recipe": "recipe", "time_detect_s": "detect, s", "time_calibrate_s": "calibrate, s"}
    times |= {"time_reconstruct_s": "reconstruct, s", "memory_mb": "memory, MB"}
    bias = {name: name for name in ("recipe", "error", "unit", "bias", "spread", "items")}
    noise = {"recipe": "recipe", "correlation": "correlation", "spread": "spread, px", "spread_first": "first's, px"}
    noise |= {"narrower": "narrower", "items": "centres"}
    stated = {"recipe": "recipe", "of": "of", "anees": "NEES", "low": "band from", "high": "to"}
    stated |= {"held_68": "in 68 %", "held_95": "in 95 %", "errors": "errors"}
    failures = {"scene": "scene", "factor": "factor", "draw": "draw", "recipe": "recipe", STAGE: "stage", KIND: "kind"}
    views = {
        "comparison": ("comparison", differences),
        "scenes": ("scenes", {"scene": "scene"} | differences),
        "ranks": ("ranks", ranks),
        "recipes": ("recipes", counts),
        "times": ("recipes", times),
        "noise": ("noise", noise),
        "bias": ("bias", bias),
        "stated": ("stated", stated),
        "failures": ("failures", failures | {FAILURE: "why"}),
    }
    kept = {"noise": "items", "bias": "items", "stated": "errors"}
    found = {}
    for name, (source, columns) in views.items():
        table = tables[source]
        table = table[table[kept[name]] > 0] if name in kept and len(table) else table
        if "figure" in table and len(table):
            unit = table.unit.map(lambda unit: f", {unit}" if unit else "")
            table = table.assign(figure=table.figure + unit)
        found[name] = table[list(columns)].rename(columns=columns) if len(table) else pd.DataFrame()
    return found


def write_tables(tables: Mapping[str, pd.DataFrame], rows: pd.DataFrame, folder: Path) -> None:
    """Write each table that has rows as Parquet, CSV, Markdown and LaTeX, and every case as `cases.csv`."""
    for name, table in tables.items():
        if not len(table):
            for suffix in ("parquet", "csv", "md", "tex"):
                (folder / f"{name}.{suffix}").unlink(missing_ok=True)
            continue
        with whole(folder / f"{name}.parquet") as path:
            table.to_parquet(path, index=False)
        texts = {
            "csv": table.to_csv(index=False),
            "md": markdown(table),
            "tex": table.to_latex(index=False, float_format="%.4g", escape=True, na_rep="--"),
        }
        for suffix, text in texts.items():
            with whole(folder / f"{name}.{suffix}") as path:
                write_text(path, text)
    with whole(folder / "cases.csv") as path:
        write_text(path, rows.drop(columns=list(LISTS), errors="ignore").to_csv(index=False))


def markdown(table: pd.DataFrame) -> str:
    """A table for a pull request or a notebook."""
    rows = [table.columns, ["---"] * len(table.columns), *table.map(_short).itertuples(index=False)]
    return "".join(f"| {' | '.join(str(value) for value in row)} |\n" for row in rows)


def _short(value: Any) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.4g}"
    return "" if value is None else str(value).replace("|", "\\|")
