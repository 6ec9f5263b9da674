"""Means and shares of values that come in clusters: values of one world share its calibration and are not independent,
worlds are. What is sure is read from the spread between clusters (METHODS section 9.2)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta, t

from testfield.errors import TestfieldError
from testfield.seeds import generator

RESAMPLES = 2000


@dataclass(frozen=True)
class Estimate:
    """A value with its standard uncertainty `u`, in the value's unit, and the degrees of freedom that u was estimated
    with (infinite where it is known)."""

    value: float
    u: float
    freedom: float = np.inf

    def interval(self, p: float = 0.95) -> tuple[float, float]:
        """The central interval at p by Student's t; without end where no uncertainty could be estimated."""
        if not self.freedom > 0:
            return -np.inf, np.inf
        reach = float(t.ppf(0.5 + p / 2, self.freedom)) * self.u
        return self.value - reach, self.value + reach

    def chance(self, reference: float) -> float:
        """How often a value whose expectation is the reference is found as far from it, to either side."""
        if not self.freedom > 0:
            return 1.0
        if self.u == 0:
            return float(self.value == reference)
        return float(2 * t.sf(abs(self.value - reference) / self.u, self.freedom))


def cluster_means(values: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """(clusters,) mean of the values (n,) of each cluster; `cluster` (n,) names each value's, in any type that sorts.

    Raises `TestfieldError` where the two differ in length.
    """
    value, cluster = np.asarray(values, float), np.asarray(cluster)
    if value.shape != cluster.shape:
        raise TestfieldError(
            f"{value.shape} values and {cluster.shape} names of clusters", "cluster_means", "give every value its own"
        )
    _, place, count = np.unique(cluster, return_inverse=True, return_counts=True)
    return np.bincount(place, value, len(count)) / count


def mean_of_clusters(means: np.ndarray) -> Estimate:
    """The mean of the means (n,) of independent clusters; its uncertainty from the spread between them, with n - 1
    degrees of freedom. Of one cluster the uncertainty is not a number, of none the value too."""
    n = len(means)
    if n < 2:
        return Estimate(value=float(means[0]) if n else np.nan, u=np.nan, freedom=0)
    return Estimate(value=float(np.mean(means)), u=float(np.std(means, ddof=1) / np.sqrt(n)), freedom=n - 1)


def share_of_clusters(hits: np.ndarray, trials: np.ndarray, p: float = 0.95) -> tuple[float, float, float]:
    """The share of hits (n,) of trials (n,) in n independent clusters, and its interval at `p`.

    By Korn and Graubard: Clopper and Pearson's interval for as many independent trials as have the variance that the
    spread between clusters shows, fewer where few clusters make all of that spread (Satterthwaite). Where all or none
    are hits no spread shows, and a cluster counts as one trial. Of one cluster the interval is 0 to 1, of none
    everything is not a number.
    """
    hits, trials = np.asarray(hits, float), np.asarray(trials, float)
    clusters, total = len(hits), trials.sum()
    if not total:
        return np.nan, np.nan, np.nan
    share = float(hits.sum() / total)
    if clusters < 2:
        return share, 0.0, 1.0
    square = (hits - share * trials) ** 2
    variance = clusters / (clusters - 1) * square.sum() / total**2
    alone = share * (1 - share)
    effective = float(clusters)
    if alone > 0 and variance > 0:
        freedom = np.clip(square.sum() ** 2 / (square**2).sum() - 1, 1, clusters - 1)
        factor = (t.ppf(0.5 + p / 2, total - 1) / t.ppf(0.5 + p / 2, freedom)) ** 2
        effective = min(alone / variance * factor, total)
    return share, *clopper_pearson(share * effective, effective, p)


def clopper_pearson(hits: float, trials: float, p: float = 0.95) -> tuple[float, float]:
    """The interval of a share at `p` or more, from hits of independent trials; both may be fractions."""
    low = beta.ppf(0.5 - p / 2, hits, trials - hits + 1) if hits > 0 else 0.0
    high = beta.ppf(0.5 + p / 2, hits + 1, trials - hits) if hits < trials else 1.0
    return float(low), float(high)


def bootstrap(
    figure: Callable[[np.ndarray], np.ndarray], clusters: int, name: str, p: float = 0.95, resamples: int = RESAMPLES
) -> tuple[float, float, float]:
    """A figure and the interval of its middle `p` where whole clusters are drawn again and again, with replacement.

    `figure` is given (k, clusters) how often each cluster counts, and returns (k,) values; `name` chooses the random
    numbers. The value is that of every cluster once. Of fewer than two clusters the interval has no ends.
    """
    once = np.ones((1, clusters))
    value = float(figure(once)[0]) if clusters else float("nan")
    if clusters < 2:
        return value, -np.inf, np.inf
    rng = generator(1, f"{name}/{clusters}")
    times = rng.multinomial(clusters, np.full(clusters, 1 / clusters), resamples).astype(float)
    low, high = np.quantile(figure(times), (0.5 - p / 2, 0.5 + p / 2))
    return value, float(low), float(high)


def bootstrap_ratio(over: np.ndarray, under: np.ndarray, name: str, p: float = 0.95) -> tuple[float, float, float]:
    """The sum of `over` (n,) over the sum of `under` (n,), a value of each cluster, with its interval by bootstrap."""
    over, under = np.asarray(over, float), np.asarray(under, float)
    return bootstrap(lambda times: (times @ over) / (times @ under), len(over), name, p)
