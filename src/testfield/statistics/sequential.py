"""The mean of values that come one after the other, known within an interval that holds however often one looks.

An interval of Student's t is right for one number of values that was fixed before. Whoever looks after each value, and
stops when he likes what he sees, is wrong far more often. A confidence sequence is right at all numbers of values at
once, so it may be looked at after each, and the budget may be changed on the way (METHODS section 9.5).
"""

from dataclasses import dataclass

import numpy as np

from testfield.errors import TestfieldError

PRIOR = 0.1
"""Precision of the mixture over mean / standard deviation, c^2: about the effects, of some standard deviations, that
differences under common noise have. It decides how narrow intervals are at which number, never whether they hold."""


@dataclass(frozen=True)
class Sequence:
    """The mean `value` of `draws` values, and the interval from `low` to `high` around it; infinite where the values
    are too few for one."""

    value: float
    low: float
    high: float
    draws: int

    def widened(self, by: float) -> "Sequence":
        """The same with an interval that reaches farther by this, to either side."""
        return Sequence(self.value, self.low - by, self.high + by, self.draws)


def running_mean(values: np.ndarray, error_rate: float) -> Sequence:
    """The mean of independent normal values (n,) of unknown spread, with an interval at 1 - `error_rate` at all n at
    once: the chance that it ever fails to hold the true mean, at whatever n, is `error_rate` at most.

    By the mixture over the effect with the right Haar measure over the spread: with t Student's statistic of a mean m,
    r = c^2 / (n + c^2) and v = n - 1, the ratio ``sqrt(r) ((1 + t^2 / v) / (1 + r t^2 / v))^(n / 2)`` is a test
    martingale at the true m, which exceeds 1 / error_rate with that chance at most (Ville). The interval holds all m at
    which it does not. Source: Wang and Ramdas, Anytime-valid t-tests and confidence sequences for Gaussian means with
    unknown variance, arXiv:2310.03722. Values that are all the same have an interval without width: identical results
    are identical. Raises `TestfieldError` where a value is not finite, or the error rate is none.
    """
    values = np.asarray(values, float)
    if not 0 < error_rate < 1:
        raise TestfieldError(f"value {error_rate:g} is no error rate", "running_mean", "give one between 0 and 1")
    if not np.isfinite(values).all():
        raise TestfieldError("a value is not finite", "running_mean", "leave it out, and say so")
    n = len(values)
    if n == 0:
        return Sequence(np.nan, -np.inf, np.inf, 0)
    value = float(values.mean())
    if n < 2:
        return Sequence(value, -np.inf, np.inf, n)
    if np.ptp(values) == 0:
        return Sequence(float(values[0]), float(values[0]), float(values[0]), n)
    reach = reach_of(n, error_rate) * float(values.std(ddof=1))
    return Sequence(value, value - reach, value + reach, n)


def reach_of(n: int, error_rate: float, prior: float = PRIOR) -> float:
    """Half the width of the interval of n values over their standard deviation; infinite where n is too small."""
    r = prior / (n + prior)
    bound = np.exp(-(2 * np.log(error_rate) + np.log(r)) / n)
    if bound * r >= 1:
        return np.inf
    return float(np.sqrt((n - 1) / n * (bound - 1) / (1 - bound * r)))
