"""Which factors drive accuracy, by twelve methods on the same runs, and how far the methods can be trusted."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from testfield.seeds import generator
from testfield.uncertainty import grey_relations as relations
from testfield_studies.grey.factors import DUMMY, FACTORS, NAMES

ENOUGH = 200
"""Runs for a regression of second degree."""
ACTS_P = 0.001
"""A factor acts where its terms explain as much in less than this part of shuffles."""
SHUFFLED = 500
"""Shuffles at once."""


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
    """(d,) shares of the variance of log RMSE, by a polynomial of second degree in each factor by itself (of
    first degree where there are few runs)."""
    _, coefficient, _ = _regression(runs)
    shares = coefficient[1:].reshape(len(FACTORS), -1) ** 2
    return shares @ [1 / 3, 1 / 5][: shares.shape[1]] / runs.log.var(ddof=1)


def anova_table(runs: Runs, shuffles: int = 5000) -> pd.DataFrame:
    """Shares, and `p`: in what part of shuffles of a factor its terms, entered last, explain as much as they do.

    The runs of a base row share coordinates, so where factors act together their residuals are not independent, and an
    F test finds factors that do nothing. A shuffle therefore deals a factor's two levels of each base row, A's and B's,
    to the base rows anew and leaves everything else: of a factor that does nothing every shuffle is as likely.
    """
    terms, *_ = _regression(runs)
    blocks, each = len(FACTORS) + 2, (terms.shape[1] - 1) // len(FACTORS)
    rows = len(terms) // blocks
    p = []
    for k, name in enumerate(NAMES):
        own = 1 + each * k + np.arange(each)
        basis = _basis(np.delete(terms, own, axis=1))
        y = _rest(basis, runs.log[:, None])[:, 0]
        by_row = terms[:, own].reshape(rows, blocks, each)
        rng = generator(0, f"grey shuffles/{name}")
        gains: list[float] = []
        for first in range(0, shuffles, SHUFFLED):
            orders = np.array([rng.permutation(rows) for _ in range(min(SHUFFLED, shuffles - first))])
            gains += _gains(basis, y, by_row[orders].reshape(len(orders), -1, each)).tolist()
        here = _gains(basis, y, terms[None][:, :, own])[0]
        p.append((1 + int((np.array(gains) >= here * (1 - 1e-9)).sum())) / (1 + shuffles))
    return pd.DataFrame({"factor": NAMES, "share": anova_shares(runs), "p": p})


def _basis(terms: np.ndarray) -> np.ndarray:
    """(n, r) orthonormal basis of the terms' space."""
    u, s, _ = np.linalg.svd(terms, full_matrices=False)
    return u[:, s > 1e-10 * s[0]]


def _rest(basis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(..., n, e) what a basis (n, r) does not explain of values (..., n, e)."""
    return values - basis @ (basis.T @ values)


def _gains(basis: np.ndarray, y: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(s,) by how much terms (s, n, e) lessen the sum of squares of y (n,), which is free of the basis already."""
    own = _rest(basis, own)
    toward = (own * y[:, None]).sum(axis=1)
    square = own.swapaxes(1, 2) @ own
    return np.einsum("se,sef,sf->s", toward, np.linalg.pinv(square, rcond=1e-10, hermitian=True), toward)


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
    of_each = np.stack([u, (3 * u**2 - 1) / 2], axis=2)[:, :, : 2 if len(u) >= ENOUGH else 1]
    terms = np.concatenate([np.ones((len(u), 1)), of_each.reshape(len(u), -1)], axis=1)
    coefficient = np.linalg.lstsq(terms, runs.log, rcond=None)[0]
    return terms, coefficient, float(((runs.log - terms @ coefficient) ** 2).sum())


# ------------------------------------------------------------------------------------------------ rankings


def places(scores: np.ndarray) -> np.ndarray:
    """(..., d) ranks, 1 for the highest score."""
    return rankdata(-scores, axis=-1)


def drawn_anew(runs: Runs, count: int) -> Iterator[Runs]:
    """Bootstraps: base rows are drawn anew, each with all its runs."""
    rng = generator(0, "grey bootstrap")
    rows = np.arange(len(runs.rmse_mm)).reshape(-1, len(FACTORS) + 2)
    for _ in range(count):
        yield runs.take(rows[rng.integers(0, len(rows), len(rows))].ravel())


def bootstrap(runs: Runs, count: int) -> dict[str, np.ndarray]:
    """(count, d) scores of every method in bootstraps."""
    found: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
    for again in drawn_anew(runs, count):
        for name, method in METHODS.items():
            found[name].append(method(again))
    return {name: np.array(scores) for name, scores in found.items()}


def agreement(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(...,) Kendall's tau-b of scores (..., d) with scores (..., d)."""
    one, two = (np.sign(x[..., :, None] - x[..., None, :]) for x in (np.asarray(first), np.asarray(second)))
    return (one * two).sum(axis=(-2, -1)) / np.sqrt((one**2).sum(axis=(-2, -1)) * (two**2).sum(axis=(-2, -1)))


def acting_factors(tested: pd.DataFrame, again: np.ndarray) -> np.ndarray:
    """(d,) which factors act: `p` is less than ACTS_P, and analysis of variance puts them before the dummy in 97.5 % of
    its bootstraps `again` (k, d)."""
    dummy = NAMES.index(DUMMY)
    before = (again > again[:, [dummy]]).mean(axis=0) >= 0.975
    acts = (tested["p"].to_numpy() < ACTS_P) & before
    acts[dummy] = False
    return acts


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


def dummy_with_offset(runs: Runs, acting: np.ndarray, offsets: tuple[float, ...], count: int) -> pd.DataFrame:
    """Deng's degree of the dummy when its levels are counted from another zero, as degrees or kelvins are: its rank,
    and in what part of bootstraps it stands above an acting factor."""
    dummy = NAMES.index(DUMMY)

    def found(some: Runs, offset: float) -> np.ndarray:
        x = sequences(some.unit)
        x[dummy] += offset
        return relations.DEGREES["Deng"](some.rmse_mm, x)

    rows = []
    for offset in offsets:
        here = found(runs, offset)
        above = [dummy_above(found(again, offset), acting) > 0 for again in drawn_anew(runs, count)]
        rows.append(
            {
                "levels of the dummy": f"{offset:g} to {offset + 1:g}",
                "degree": here[dummy],
                "rank": int(places(here)[dummy]),
                "above an acting factor": float(np.mean(above)),
            }
        )
    return pd.DataFrame(rows)


def turned_round(runs: Runs) -> pd.DataFrame:
    """Deng's degree of every factor, and with that factor's levels turned round: its highest where its lowest was."""
    rows = []
    for k, name in enumerate(NAMES):
        other = runs.unit.copy()
        other[:, k] = 1 - other[:, k]
        turned = replace(runs, unit=other)
        rows.append(
            {"factor": name}
            | {
                f"{degree}{end}": degrees(degree, some, oriented=False)[k]
                for degree in ("Deng", "T-type")
                for end, some in (("", runs), (", turned round", turned))
            }
        )
    return pd.DataFrame(rows)
