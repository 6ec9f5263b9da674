"""The jackknife: what a figure would be without one cluster after the other (METHODS section 9.3)."""

import numpy as np
from scipy.stats import t


def jackknife(value: float, left_out: np.ndarray, p: float = 0.95) -> tuple[float, float, float]:
    """A figure and its interval at `p`, from what it is without each of its n clusters in turn, `left_out` (n,).

    Student's t of n - 1 degrees of freedom, for clusters may be few; of fewer than two the interval is not a number.
    """
    left, n = np.asarray(left_out, float), len(left_out)
    if n < 2:
        return value, np.nan, np.nan
    u = np.sqrt((n - 1) / n * ((left - left.mean()) ** 2).sum())
    reach = float(u * t.ppf(0.5 + p / 2, n - 1))
    return value, value - reach, value + reach


def jackknife_ratio(
    over: np.ndarray, under: np.ndarray, power: float = 1.0, p: float = 0.95
) -> tuple[float, float, float]:
    """(sum of `over` / sum of `under`) ** power over clusters (n,), with its interval at `p` by the jackknife on
    logarithms.

    Of the clusters that have both sums above 0; everything is not a number where there are none, and so is the
    interval of a single one.
    """
    a, b = np.asarray(over, float), np.asarray(under, float)
    here = (a > 0) & (b > 0)
    a, b = a[here], b[here]
    if not len(a):
        return np.nan, np.nan, np.nan
    value = float((a.sum() / b.sum()) ** power)
    if len(a) == 1:
        return value, np.nan, np.nan
    _, low, high = jackknife(0.0, power * np.log((a.sum() - a) / (b.sum() - b)), p)
    return value, float(value * np.exp(low)), float(value * np.exp(high))
