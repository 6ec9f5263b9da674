"""Intervals of medians, of rms, of shares, and of what worlds in pairs tell (METHODS section 9.2)."""

import numpy as np
from scipy.stats import binom, chi2

from testfield.statistics.clusters import bootstrap_ratio, clopper_pearson

LEAST_WORLDS = 6
"""Fewer worlds give no 95 % interval of a median, and no bootstrap that could be believed."""


def median_of(values: np.ndarray) -> dict[str, float]:
    """Median with the 95 % interval that order statistics give whatever the distribution; of fewer than six values
    their range. What is not finite counts as beyond all; of no values everything is NaN."""
    v = np.sort(np.where(np.isfinite(values), values, np.inf))
    if not len(v):
        return {"worlds": 0, "median": np.nan, "low": np.nan, "high": np.nan}
    k = int(binom.ppf(0.025, len(v), 0.5))
    middle = float(v[(len(v) - 1) // 2 : len(v) // 2 + 1].mean())
    ends = {"low": float(v[max(k - 1, 0)]), "high": float(v[min(len(v) - k, len(v) - 1)])}
    return {"worlds": len(v), "median": middle} | ends


def rms_of(values: np.ndarray) -> tuple[float, float, float]:
    """Root mean square and its 95 % interval for errors that are normal about zero."""
    n, rms = len(values), float(np.sqrt(np.mean(np.square(values))))
    return rms, rms * np.sqrt(n / chi2.ppf(0.975, n)), rms * np.sqrt(n / chi2.ppf(0.025, n))


def share_of(count: float, n: float) -> tuple[float, float, float]:
    """A share and its 95 % interval by Clopper and Pearson; NaN of nothing."""
    return (count / n, *clopper_pearson(count, n)) if n > 0 else (np.nan, np.nan, np.nan)


def ratio_of(over: np.ndarray, under: np.ndarray) -> tuple[float, float, float]:
    """Ratio of two rms, row k of both being of the same world, and its 95 % interval by bootstrap over the worlds."""
    found = np.array(_ratio_of_sums(over**2, under**2))
    value, low, high = np.sign(found) * np.sqrt(np.abs(found))
    return float(value), float(low), float(high)


def lag_of(turns: np.ndarray) -> tuple[float, float, float]:
    """Correlation about zero of neighbouring links' turns (worlds, links), and its 95 % interval by bootstrap over the
    worlds; NaN of a single link."""
    if turns.shape[1] < 2:
        return float("nan"), float("nan"), float("nan")
    return _ratio_of_sums((turns[:, 1:] * turns[:, :-1]).mean(axis=1), (turns**2).mean(axis=1))


def _ratio_of_sums(over: np.ndarray, under: np.ndarray) -> tuple[float, float, float]:
    """Ratio of sums over worlds (n,), with its interval; of too few worlds that of no knowledge, of none NaN."""
    if not len(over):
        return float("nan"), float("nan"), float("nan")
    value, low, high = bootstrap_ratio(over, under, "stitching/bootstrap")
    return (value, low, high) if len(over) >= LEAST_WORLDS else (value, -np.inf, np.inf)
