"""Data snooping (Baarda 1968; Foerstner 1983; Teunissen 2018): which of several possible blunders explain a
misclosure, one at a time, the largest first.

A possible blunder is a matrix H (q, d): d amounts of it would add H @ amounts to the q observations. Observations are
whitened, and whatever is unknown, and every blunder that was found, is projected out; the squared length of what is
left along H is then chi-squared with as many degrees of freedom as H keeps, if all is well.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2 as chi_squared

CONTROLLED = 1e-10
"""Redundancy number below which a blunder is controlled by nothing: it would show nowhere."""
TOLD_APART = 6.0
"""Difference of two test values below which one blunder is not told from another: odds of 20 to 1."""
ENOUGH = 8
"""How many blunders of one kind must be possible before their typical test value tells how well all of them fit."""


@dataclass(frozen=True)
class Blunder:
    """A blunder that was found: its `number` among the possible ones; `sigmas`, what it misses the others by in
    standard deviations of the difference (of several dimensions: the length of the standardised residual);
    `redundancy` (0 to 1, the least); its `amount` (d,) as estimated; `alike`, numbers of those others that explain the
    misclosure as well."""

    number: int
    sigmas: float
    redundancy: float
    amount: np.ndarray
    alike: tuple[int, ...]


@dataclass(frozen=True)
class Snooped:
    """`found` in their order; `sigmas` (k,) of every possible blunder, after those found; `scatter` (k,) the factor by
    which the misfits of its kind exceed their standard deviations on the whole (1: they do not)."""

    found: tuple[Blunder, ...]
    sigmas: np.ndarray
    scatter: np.ndarray


def snoop(
    misclosure: np.ndarray,
    cov: np.ndarray,
    design: np.ndarray,
    possible: list[np.ndarray],
    kind: list[str],
    rank: list[int],
    false_alarm: float,
) -> Snooped:
    """Blunders in `misclosure` (q,) of covariance `cov` (q, q), which follows unknowns by `design` (q, p).

    `possible` blunders (q, d), each of a `kind`; with probability `false_alarm` at most, anything is found where there
    is nothing. Where `ENOUGH` of one kind scatter more than they claim on the whole, the test is of their scatter:
    then the model is to blame, and no single one of them. Of blunders that explain the misclosure alike, that of the
    highest `rank` is called one; among equals the largest.
    """
    root = np.linalg.cholesky(cov)
    white, A = np.linalg.solve(root, misclosure), np.linalg.solve(root, design)
    blunders = [np.linalg.solve(root, H) for H in possible]
    limit = false_alarm / max(len(possible), 1)
    found: list[Blunder] = []
    basis = _basis(A, 1e-10)
    while True:
        left = [_without(basis, H) for H in blunders]
        test = [_test(white, H, before) for H, before in zip(left, blunders, strict=True)]
        scatter = _scatter(test, kind)
        value = np.array([t.value for t in test]) / scatter
        chance = np.array([_log_chance(v, t.rank) for v, t in zip(value, test, strict=True)])
        size = np.sqrt(np.maximum(value, 0))
        for k in [b.number for b in found]:
            chance[k] = 0.0
        if not len(chance) or chance.min() > np.log(limit):
            return Snooped(tuple(found), size, np.sqrt(scatter))
        best = int(np.argmin(chance))
        taken = [b.number for b in found]
        # A rival of more dimensions must explain more: what chance would let each explain is taken off.
        excess = value - np.array([t.rank for t in test])
        alike = [k for k in np.flatnonzero(excess > excess[best] - TOLD_APART).tolist() if k not in taken]
        chosen = max(alike, key=lambda k: (rank[k], k == best))
        alike.remove(chosen)
        amount = np.linalg.lstsq(left[chosen], white, rcond=1e-9)[0]
        found.append(Blunder(chosen, float(size[chosen]), test[chosen].redundancy, amount, tuple(alike)))
        basis = np.column_stack([basis, test[chosen].span])


@dataclass(frozen=True)
class _Test:
    value: float
    rank: int
    redundancy: float
    span: np.ndarray


def _test(white: np.ndarray, H: np.ndarray, before: np.ndarray) -> _Test:
    """The test of one blunder, from what of it is left (q, d) of what it was `before`."""
    lengths = np.linalg.norm(before, axis=0)
    u, s, _ = np.linalg.svd(H / np.maximum(lengths, 1e-300), full_matrices=False)
    kept = s**2 > CONTROLLED
    along = u[:, kept].T @ white
    return _Test(float(along @ along), int(kept.sum()), float(min((s**2).min(initial=1.0), 1.0)), u[:, kept])


def _log_chance(value: float, rank: int) -> float:
    """The logarithm of the chance of a larger chi-squared, also where the chance itself is too small for a number."""
    if not rank:
        return 0.0
    if value < 500 + 10 * rank:
        return float(chi_squared.logsf(value, rank))
    return float(-value / 2 + (rank / 2 - 1) * np.log(value / 2) - gammaln(rank / 2))


def _scatter(test: list[_Test], kind: list[str]) -> np.ndarray:
    """(k,) by how much the tests of each one's kind exceed what they should be, where there are enough to tell."""
    factor = np.ones(len(test))
    for name in set(kind):
        here = [k for k, t in enumerate(test) if kind[k] == name and t.rank]
        if len(here) >= ENOUGH:
            ratio = np.median([test[k].value / chi_squared.median(test[k].rank) for k in here])
            factor[here] = max(float(ratio), 1.0)
    return factor


def _basis(columns: np.ndarray, tolerance: float) -> np.ndarray:
    """An orthonormal basis of the span of columns, each taken at its own size."""
    if not columns.shape[1]:
        return columns
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(columns / size, full_matrices=False)
    return u[:, s > tolerance]


def _without(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns with their part in an orthonormal basis taken away, twice for the digits."""
    for _ in range(2):
        columns = columns - basis @ (basis.T @ columns)
    return columns
