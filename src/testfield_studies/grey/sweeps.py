"""Sweeps of one factor at a time, as published grey analyses are made."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.stats import t

from testfield.uncertainty import grey_relations as relations
from testfield_studies.grey.factors import NAMES
from testfield_studies.grey.rankings import Runs, sequences


def sweep_table(sweep: pd.DataFrame) -> pd.DataFrame:
    """Sweeps of one factor at a time, every level measured as often as every other: by how much ln RMSE changes from
    one end to the other on a straight line, its standard uncertainty `u` from the scatter of runs at the same level,
    the half width `u95` of its 95 % interval (both NaN where no level was repeated), and the degrees of each sweep.

    Grey degrees get each level's RMSE over its runs. Deng's least and largest differences are taken over all sweeps
    together, as published analyses do.
    """
    rows, errors, levels = [], [], []
    for k, name in enumerate(NAMES):
        own = sweep[sweep["block"] == name].sort_values("base", kind="stable")
        runs = Runs.of(own)
        log = runs.log.reshape(own["base"].nunique(), -1)
        unit = runs.unit.reshape(*log.shape, -1)[:, 0]
        place = unit[:, k] - unit[:, k].mean()
        square, free = log.shape[1] * (place**2).sum(), log.size - len(log)
        within = float(log.var(axis=1).sum() * log.shape[1] / free) if free else np.nan
        errors.append(np.sqrt(np.exp(2 * log).mean(axis=1)))
        levels.append(sequences(unit)[k])
        u = float(np.sqrt(within / square))
        rows.append(
            {
                "factor": name,
                "change of ln RMSE": float(place @ log.sum(axis=1) / square),
                "u": u,
                "u95": u * float(t.ppf(0.975, free)) if free else np.nan,
            }
        )
    table = pd.DataFrame(rows)
    y, x = relations.mean_image(np.array(errors)), relations.mean_image(np.array(levels))
    table["Deng"] = relations.deng(np.zeros(y.shape[1]), x - y)
    for name, degree in relations.DEGREES.items():
        if name != "Deng":
            table[name] = [_degree(degree, a, b) for a, b in zip(errors, levels, strict=True)]
    return table


def _degree(degree: Callable[[np.ndarray, np.ndarray], np.ndarray], error: np.ndarray, level: np.ndarray) -> float:
    if level[0] == 0 and degree in (relations.relative, relations.synthetic):
        return float("nan")  # nothing can be divided by a first level of zero
    return float(degree(error, level[None])[0])
