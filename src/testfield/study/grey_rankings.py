"""Which factors drive accuracy, by twelve methods on the same runs, and how far the methods can be trusted."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import f as f_law
from scipy.stats import kendalltau, rankdata

from testfield.seeds import generator
from testfield.study.grey_factors import DUMMY, FACTORS, NAMES
from testfield.uncertainty import grey_relations as relations

ACTS_P = 0.001
"""A factor acts where the analysis of variance says that chance gives as much in less than this part of cases."""


@dataclass(frozen=True)
class Runs:
    """Runs of a design: places `unit` (n, d) in the unit cube, `rmse_mm` (n,), the `base` row (n,) each belongs to and
    its `block` (n,): A, B, or the factor in which it differs from A."""

    unit: np.ndarray
    rmse_mm: np.ndarray
    base: np.ndarray
    block: np.ndarray

    @staticmethod
    def of(table: pd.DataFrame) -> "Runs":
        """The runs in a table of rows, in its order; none of them lost."""
        unit = table[[f"unit {k}" for k in range(len(FACTORS))]].to_numpy(float)
        columns = (table[name].to_numpy() for name in ("rmse_mm", "base", "block"))
        return Runs(unit, *columns)

    def take(self, rows: np.ndarray) -> "Runs":
        """Some of the runs, by their places."""
        return Runs(self.unit[rows], self.rmse_mm[rows], self.base[rows], self.block[rows])

    @property
    def log(self) -> np.ndarray:
        """(n,) logarithms of the errors."""
        return np.log(self.rmse_mm)

    def whole(self) -> "Runs":
        """The runs of those base rows of which none is lost, ordered by base row and block as Saltelli's design is."""
        kept = [np.flatnonzero(self.base == row) for row in np.unique(self.base)]
        order = ["A", *NAMES, "B"]
        full = [
            rows[np.argsort([order.index(b) for b in self.block[rows]])] for rows in kept if len(rows) == len(order)
        ]
        return self.take(np.concatenate(full) if full else np.zeros(0, int))


def sequences(unit: np.ndarray, oriented: bool = True) -> np.ndarray:
    """(d, n) what grey analyses are fed with: the factors' levels, the reciprocal where more of a factor is better."""
    rows = []
    for factor, places in zip(FACTORS, unit.T, strict=True):
        level = np.asarray(factor.level(places), float)
        rows.append(1 / level if oriented and not factor.more_is_worse else level)
    return np.array(rows)


# ------------------------------------------------------------------------------------------------ importance


def anova_shares(runs: Runs) -> np.ndarray:
    """(d,) shares of the variance of log RMSE, by a polynomial of second degree in each factor by itself."""
    _, coefficient, _ = _regression(runs)
    return (coefficient[1:].reshape(-1, 2) ** 2 @ [1 / 3, 1 / 5]) / runs.log.var(ddof=1)


def anova_table(runs: Runs) -> pd.DataFrame:
    """Shares, and the probability that chance alone gives as much (F test of a factor's two terms, entered last)."""
    terms, _, residual = _regression(runs)
    free = len(terms) - terms.shape[1]
    p = []
    for k in range(len(FACTORS)):
        without = np.delete(terms, [1 + 2 * k, 2 + 2 * k], axis=1)
        rest = runs.log - without @ np.linalg.lstsq(without, runs.log, rcond=None)[0]
        gain = ((rest**2).sum() - residual) / 2
        p.append(float(f_law.sf(gain / (residual / free), 2, free)) if free > 0 else np.nan)
    return pd.DataFrame({"factor": NAMES, "share": anova_shares(runs), "p": p})


def explained(runs: Runs) -> float:
    """The part of the variance of log RMSE that the factors explain one by one, without interactions, adjusted."""
    terms, _, residual = _regression(runs)
    n = len(terms)
    return float(1 - residual / max(n - terms.shape[1], 1) / runs.log.var(ddof=1))


def sobol(runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """(d,) first-order and total indices of log RMSE by the estimators that SALib uses (Saltelli 2010, Jansen)."""
    y = runs.log.reshape(-1, len(FACTORS) + 2)
    y = (y - y.mean()) / y.std()
    a, ab, b = y[:, :1], y[:, 1:-1], y[:, -1:]
    variance = np.concatenate([a, b]).var()
    return (b * (ab - a)).mean(axis=0) / variance, 0.5 * ((a - ab) ** 2).mean(axis=0) / variance


def rank_correlation(runs: Runs) -> np.ndarray:
    """(d,) Spearman's coefficient of each factor and the error, without its sign."""
    ranks = rankdata(np.column_stack([runs.rmse_mm, runs.unit]), axis=0)
    return np.abs(np.corrcoef(ranks, rowvar=False)[0, 1:])


def degrees(name: str, runs: Runs, oriented: bool = True) -> np.ndarray:
    """(d,) grey degrees of the factors with the error, runs in the order they are given."""
    x = sequences(runs.unit, oriented)
    if name == RANGE:
        return relations.deng(relations.range_image(runs.rmse_mm), relations.range_image(x))
    return relations.DEGREES[name](runs.rmse_mm, x)


RANGE = "Deng, by ranges"
GREY = (*relations.DEGREES, RANGE)
ANOVA, TOTAL, FIRST, SPEARMAN = "analysis of variance", "Sobol, total", "Sobol, first order", "rank correlation"
METHODS: dict[str, Callable[[Runs], np.ndarray]] = {
    ANOVA: anova_shares,
    TOTAL: lambda runs: sobol(runs)[1],
    FIRST: lambda runs: sobol(runs)[0],
    SPEARMAN: rank_correlation,
} | {name: lambda runs, name=name: degrees(name, runs) for name in GREY}  # type: ignore[misc]
"""Methods by name: runs to (d,) scores, more for the more important."""


def _regression(runs: Runs) -> tuple[np.ndarray, np.ndarray, float]:
    u = 2 * runs.unit - 1
    terms = np.concatenate([np.ones((len(u), 1)), np.stack([u, (3 * u**2 - 1) / 2], axis=2).reshape(len(u), -1)], 1)
    coefficient = np.linalg.lstsq(terms, runs.log, rcond=None)[0]
    return terms, coefficient, float(((runs.log - terms @ coefficient) ** 2).sum())


# ------------------------------------------------------------------------------------------------ rankings


def places(scores: np.ndarray) -> np.ndarray:
    """(..., d) ranks, 1 for the highest score."""
    return rankdata(-scores, axis=-1)


def bootstrap(runs: Runs, count: int) -> dict[str, np.ndarray]:
    """(count, d) scores of every method; base rows are drawn anew, each with all its runs."""
    rng = generator(0, "grey bootstrap")
    blocks = len(FACTORS) + 2
    rows = np.arange(len(runs.rmse_mm)).reshape(-1, blocks)
    found: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
    for _ in range(count):
        again = runs.take(rows[rng.integers(0, len(rows), len(rows))].ravel())
        for name, method in METHODS.items():
            found[name].append(method(again))
    return {name: np.array(scores) for name, scores in found.items()}


def agreement(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(k,) Kendall's tau of rankings (k, d) with (k, d) or (d,)."""
    second = np.broadcast_to(second, first.shape)
    return np.array([kendalltau(a, b).statistic for a, b in zip(first, second, strict=True)])


def dummy_above(scores: np.ndarray, acting: np.ndarray) -> np.ndarray:
    """(...,) how many of the `acting` factors (d,) score no higher than the dummy."""
    dummy = NAMES.index(DUMMY)
    return (scores[..., acting] <= scores[..., [dummy]]).sum(axis=-1)


def in_other_orders(runs: Runs, name: str, count: int) -> np.ndarray:
    """(count, d) grey degrees with the same runs in other orders."""
    rng = generator(0, "grey order")
    return np.array([degrees(name, runs.take(rng.permutation(len(runs.rmse_mm)))) for _ in range(count)])


def reversals(runs: Runs, name: str) -> list[tuple[str, str, str]]:
    """Pairs of factors (before, behind) whose order turns when a third is left out of the analysis: (left out, ...)."""
    x = sequences(runs.unit)
    image = relations.range_image if name == RANGE else relations.mean_image
    y, x = image(runs.rmse_mm), image(x)
    full = relations.deng(y, x)
    found = []
    for out in range(len(FACTORS)):
        rest = np.delete(np.arange(len(FACTORS)), out)
        less = relations.deng(y, x[rest])
        for i, a in enumerate(rest):
            for j, b in enumerate(rest):
                if full[a] > full[b] and less[i] < less[j]:
                    found.append((NAMES[out], NAMES[a], NAMES[b]))
    return found


def dummy_with_offset(runs: Runs, offsets: tuple[float, ...]) -> pd.DataFrame:
    """Deng's degree and rank of the dummy when its levels are counted from another zero, as degrees or kelvins are."""
    dummy = NAMES.index(DUMMY)
    rows = []
    for offset in offsets:
        x = sequences(runs.unit)
        x[dummy] += offset
        found = relations.DEGREES["Deng"](runs.rmse_mm, x)
        rows.append({"levels of the dummy": f"{offset:g} to {offset + 1:g}", "degree": found[dummy],
                     "rank": int(places(found)[dummy])})  # fmt: skip
    return pd.DataFrame(rows)


# ------------------------------------------------------------------------------------------------ one at a time


def sweep_table(sweep: pd.DataFrame) -> pd.DataFrame:
    """Sweeps of one factor at a time: by how much the error truly changes, and the degrees of each sweep.

    Deng's least and largest differences are taken over all sweeps together, as published analyses do.
    """
    rows, errors, levels = [], [], []
    for k, name in enumerate(NAMES):
        own = sweep[sweep["block"] == name].sort_values("base")
        runs = Runs.of(own)
        errors.append(runs.rmse_mm)
        levels.append(sequences(runs.unit)[k])
        rows.append({"factor": name, "change of ln RMSE": float(runs.log[-1] - runs.log[0])})
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


def with_errors(runs: Runs, rmse_mm: np.ndarray) -> Runs:
    """The same runs with other errors."""
    return replace(runs, rmse_mm=rmse_mm)
