"""A figure over the values of a factor, with bands, and its difference from the first recipe's."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from testfield.evaluate.paired import difference
from testfield.statistics.clusters import Estimate, mean_of_clusters

COLUMNS = ("factor", "level", "recipe", "mean", "low", "high", "difference", "difference_low", "difference_high")


def curve(table: pd.DataFrame, recipes: Sequence[str]) -> pd.DataFrame:
    """Means with 95 % bands at each level of each factor, and of the difference from the first recipe.

    `table` is indexed by scene, factor, level, draw and has a column a recipe. Scenes are the units where several have
    a level, draws where only one does.
    """
    rows = []
    for (factor, level), part in table.groupby(["factor", "level"], sort=False):
        if level < 0:
            continue
        for name in recipes:
            figures = _by_scene(part, name)
            own, other = mean_over(figures), difference(_by_scene(part, recipes[0]), figures, 1.0).estimate
            ends = {"low": own.interval()[0], "high": own.interval()[1]}
            off = dict(zip(COLUMNS[-3:], (other.value, *other.interval()), strict=True))
            rows.append({"factor": factor, "level": level, "recipe": name, "mean": own.value} | ends | off)
    return pd.DataFrame(rows, columns=list(COLUMNS))


def mean_over(figures: Sequence[np.ndarray]) -> Estimate:
    """The mean of figures, given scene by scene as arrays of draws; of a single scene the draws are the units."""
    good = [values[np.isfinite(values)] for values in figures]
    good = [values for values in good if len(values)]
    return mean_of_clusters(good[0] if len(good) == 1 else np.array([values.mean() for values in good]))


def axis_of(values: Sequence[object]) -> tuple[np.ndarray, list[str] | None]:
    """Where a factor's values lie on an axis, and what they are called there if they are no numbers."""
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        return np.array(values, float), None
    return np.arange(len(values), dtype=float), [str(value) for value in values]


def _by_scene(part: pd.DataFrame, name: str) -> list[np.ndarray]:
    return [part[name].loc[[scene]].to_numpy(float) for scene in part.index.unique("scene")]


def in_metrics(curves: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """One table from one for each metric's title."""
    tables = [table.assign(figure=title) for title, table in curves.items() if len(table)]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=[*COLUMNS, "figure"])
