"""The Monte Carlo method of GUM supplement 1 (JCGM 101) with its adaptive stop, for many quantities at once.

Blocks of trials give each four figures: mean, standard deviation, and both ends of the coverage interval. It goes on
until twice the standard deviation of every figure's average over the blocks is no more than the tolerance.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

P = 0.95
STANDARD_BLOCK = 10_000
"""Trials in a block; the standard's J = 100 / (1 - P) is less for any P up to 0.99."""
VALIDATING = 5.0
"""Where the linear result is judged, the Monte Carlo is to be this much finer than its tolerance."""


def tolerance(u: np.ndarray, digits: int = 1) -> np.ndarray:
    """(q,) half a unit in the last of the `digits` significant digits of u: with u = c 10^l, it is 10^l / 2."""
    with np.errstate(divide="ignore"):
        exponent = np.floor(np.log10(u)) - (digits - 1)
    # 0.0996 to one digit is 0.1: rounding may carry.
    exponent = np.where(np.rint(u / 10.0**exponent) >= 10**digits, exponent + 1, exponent)
    return 0.5 * 10.0**exponent


@dataclass(frozen=True)
class MonteCarlo:
    """What `trials` gave for q quantities.

    `value`, `u`, `low`, `high` (q,) with the coverage interval at `p`; `s` (4, q) standard deviations of these four;
    `blocks` of the trials. `gaussian` where trials were too few for quantiles and the interval is value +- k u, as
    the supplement allows for models that are costly.
    """

    value: np.ndarray
    u: np.ndarray
    low: np.ndarray
    high: np.ndarray
    s: np.ndarray
    trials: int
    blocks: int
    p: float
    gaussian: bool

    def settled(self, delta: np.ndarray) -> np.ndarray:
        """(q,) whether all four figures are known to within a tolerance (q,)."""
        return np.asarray((2 * self.s <= delta).all(axis=0))


def adaptive(
    block: Callable[[int], np.ndarray],
    delta: np.ndarray,
    most_trials: int,
    p: float = P,
    shortest: bool = False,
) -> MonteCarlo:
    """Blocks number 0, 1, ... of (M, q) trials until all four figures of all quantities are settled to `delta` (q,), or
    the trials are used up. Two blocks are drawn at least."""
    parts: list[np.ndarray] = []
    figures: list[np.ndarray] = []
    while True:
        parts.append(block(len(parts)))
        figures.append(_figures(parts[-1], p, shortest))
        drawn = sum(len(part) for part in parts)
        if len(parts) < 2:
            continue
        s = np.std(figures, axis=0, ddof=1) / np.sqrt(len(figures))
        if (2 * s <= delta).all() or drawn + len(parts[-1]) > most_trials:
            # The figures are those of all trials together; only their spread is the blocks'.
            value, u, low, high = _figures(np.concatenate(parts), p, shortest)
            return MonteCarlo(value, u, low, high, s, drawn, len(parts), p, False)


def of_few(values: np.ndarray, claimed_u: np.ndarray, p: float = P) -> MonteCarlo:
    """The figures of (T, q) trials, too costly for blocks of thousands; the distribution is taken for Gaussian.

    How well the figures are known follows from the larger of u and `claimed_u` (q,): few trials that happen to lie
    close together must not seem certain.
    """
    T, k = len(values), float(norm.ppf(0.5 + p / 2))
    value, u = values.mean(axis=0), values.std(axis=0, ddof=1)
    spread = np.maximum(u, claimed_u)
    of_value, of_u = spread / np.sqrt(T), spread / np.sqrt(2 * (T - 1))
    of_end = np.hypot(of_value, k * of_u)
    s = np.array([of_value, of_u, of_end, of_end])
    return MonteCarlo(value, u, value - k * u, value + k * u, s, T, 1, p, True)


def _figures(values: np.ndarray, p: float, shortest: bool) -> np.ndarray:
    """(4, q) mean, standard deviation and ends of the interval of (M, q) trials."""
    ordered = np.sort(values, axis=0)
    m = len(values)
    covered = round(p * m)
    if shortest:
        first = np.argmin(ordered[covered:] - ordered[: m - covered], axis=0)
    else:
        first = np.full(values.shape[1], (m - covered) // 2)
    low, high = (np.take_along_axis(ordered, rows[None], axis=0)[0] for rows in (first, first + covered))
    return np.array([values.mean(axis=0), values.std(axis=0, ddof=1), low, high])


@dataclass(frozen=True)
class Validation:
    """The linear result judged by Monte Carlo (JCGM 101 clause 8).

    `d_low`, `d_high` (q,) how far the ends of both intervals are apart; `delta` (q,) the tolerance. `verdict` (q,):
    `yes` where both are within it, `no` where not, `open` where trials were too few to tell.
    """

    d_low: np.ndarray
    d_high: np.ndarray
    delta: np.ndarray
    verdict: np.ndarray


def validate(value: np.ndarray, u: np.ndarray, trials: MonteCarlo, digits: int = 1) -> Validation:
    """Judge value (q,) with standard uncertainty u (q,) whose expanded one is that of a Gaussian."""
    U, delta = norm.ppf(0.5 + trials.p / 2) * u, tolerance(u, digits)
    d_low, d_high = np.abs(value - U - trials.low), np.abs(value + U - trials.high)
    worst = np.maximum(d_low, d_high)
    doubt = np.where(trials.settled(delta / VALIDATING), 0.0, 2 * trials.s[2:].max(axis=0))
    verdict = np.select([worst + doubt <= delta, worst - doubt > delta], ["yes", "no"], "open")
    return Validation(d_low, d_high, delta, verdict)
