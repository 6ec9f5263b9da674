"""Whether errors are as large as was claimed: bands for normalised estimation errors squared, counts of hits, and the
law of the errors over their uncertainties (METHODS sections 5.4 and 9.1)."""

import numpy as np
from scipy.stats import binom, chi2, kstest, norm

from testfield.errors import TestfieldError
from testfield.seeds import normals

NOTHING = 1e-10
"""A variance of less than this part of the largest is none: a fit has taken that direction away."""
DRAWS = 4000
"""From which `joint_hit_band` takes its quantiles: the 1 % outside a 99 % band is then known to a fifth."""
MOST_TRIALS = 1_000_000


def nees_band(freedom: int, p: float = 0.95) -> tuple[float, float]:
    """Within which NEES per degree of freedom lies with probability p, where all claims are true; `freedom` counts the
    degrees of all independent parts together. Points that share a calibration are one part."""
    return float(chi2.ppf(0.5 - p / 2, freedom) / freedom), float(chi2.ppf(0.5 + p / 2, freedom) / freedom)


def trials_to_tell(freedom: int, factor: float, level: float = 0.01, power: float = 0.99) -> int:
    """How many independent trials, each with `freedom` degrees, tell with probability `power` a covariance `factor`
    times too large or too small, by a band that true claims leave with probability `level`.

    Raises `TestfieldError` where the factor is 1, less than 0, or so near 1 that a million trials do not do.
    """
    if factor <= 0 or factor == 1 or freedom < 1:
        raise TestfieldError(
            f"a covariance {factor:g} times wrong in {freedom} degrees of freedom cannot be told",
            "trials_to_tell",
            "ask for a factor above 0 that is not 1, and one degree of freedom or more",
        )

    def told(trials: int) -> bool:
        n = trials * freedom
        low, high = nees_band(n, 1 - level)
        seen = [chi2.cdf(low * n / f, n) + chi2.sf(high * n / f, n) for f in (factor, 1 / factor)]
        return min(seen) >= power

    most = 1
    while not told(most):
        most *= 2
        if most > MOST_TRIALS:
            raise TestfieldError(
                f"{MOST_TRIALS} trials do not tell a covariance {factor:g} times wrong",
                "trials_to_tell",
                "ask for a factor further from 1",
            )
    least = most // 2
    while most - least > 1:
        middle = (least + most) // 2
        least, most = (least, middle) if told(middle) else (middle, most)
    return most


def hit_band(trials: int, p: float, central: float = 0.99) -> tuple[int, int]:
    """Numbers of hits that `trials` independent events of probability p give with probability `central` or more,
    as much being cut off below as above: 931 to 967 of 1000 at 95 % (METHODS section 5.4)."""
    return int(binom.ppf(0.5 - central / 2, trials, p)), int(binom.ppf(0.5 + central / 2, trials, p))


def joint_hit_band(cov: np.ndarray, size: int, p: float = 0.95, central: float = 0.99) -> tuple[int, int]:
    """Numbers of parts that lie in their own regions at `p` with probability `central`, where the claimed joint
    covariance `cov` (d, d) of all parts, each of `size` values, is true: the parts may be correlated.

    By `DRAWS` draws from the covariance, always the same. Of independent parts it is `hit_band`, but for chance.
    """
    parts = [slice(k, k + size) for k in range(0, len(cov), size)]
    variance, axes = np.linalg.eigh(cov)
    known = variance > NOTHING * variance[-1]
    z = normals(0, "joint hits", DRAWS, int(known.sum()))
    error = z @ (axes[:, known] * np.sqrt(variance[known])).T
    hits = np.zeros(DRAWS, int)
    for part in parts:
        own, along = np.linalg.eigh(cov[part, part])
        left = own > NOTHING * own[-1]
        radius = ((error[:, part] @ along[:, left]) ** 2 / own[left]).sum(axis=1)
        hits += radius <= chi2.ppf(p, int(left.sum()))
    low, high = np.quantile(hits, (0.5 - central / 2, 0.5 + central / 2), method="inverted_cdf")
    return int(low), int(high)


def decorrelated(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """(r,) independent standard normal values, if errors (n,) have the claimed covariance (n, n) of rank r: what the
    errors are along its principal axes, over their uncertainties there."""
    variance, axes = np.linalg.eigh(cov)
    known = variance > NOTHING * variance[-1]
    return axes[:, known].T @ error / np.sqrt(variance[known])


def chi_squared(error: np.ndarray, cov: np.ndarray) -> tuple[float, int]:
    """e^T C^+ e of errors (n,) by their stated covariance (n, n), in whatever units, and its degrees of freedom: the
    rank of C. A singular covariance says nothing along the axes that it leaves out."""
    if not len(error):
        return 0.0, 0
    size = np.sqrt(np.diag(cov))
    size = np.where(size > 0, size, 1.0)
    z = decorrelated(error / size, cov / np.outer(size, size))
    return float(z @ z), len(z)


def nees(error: np.ndarray, cov: np.ndarray) -> float:
    """`chi_squared` over its degrees of freedom, NaN of nothing stated: 1 on average where the claim is true."""
    if not (np.isfinite(cov).all() and np.isfinite(error).all()):
        return float("nan")
    value, freedom = chi_squared(error, cov)
    return value / freedom if freedom else float("nan")


def pit_uniformity(z: np.ndarray) -> tuple[float, float]:
    """Largest distance of the probability integral transform of z (n,) from uniform, and how often independent
    standard normal values give one as large (Kolmogorov and Smirnov)."""
    found = kstest(norm.cdf(z), "uniform")
    return float(found.statistic), float(found.pvalue)
