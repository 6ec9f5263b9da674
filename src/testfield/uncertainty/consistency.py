"""Whether errors are as large as was claimed: bands for normalised estimation errors squared, counts of hits, and the
law of the errors over their uncertainties (METHODS section 5.4)."""

import numpy as np
from scipy.stats import binom, chi2, kstest, norm

NOTHING = 1e-10
"""A variance of less than this part of the largest is none: a fit has taken that direction away."""


def nees_band(freedom: int, p: float = 0.95) -> tuple[float, float]:
    """Within which NEES per degree of freedom lies with probability p, where all claims are true; `freedom` counts the
    degrees of all independent parts together. Points that share a calibration are one part."""
    return float(chi2.ppf(0.5 - p / 2, freedom) / freedom), float(chi2.ppf(0.5 + p / 2, freedom) / freedom)


def hit_band(trials: int, p: float, central: float = 0.99) -> tuple[int, int]:
    """Numbers of hits that `trials` independent events of probability p give with probability `central` or more,
    as much being cut off below as above: 931 to 967 of 1000 at 95 % (METHODS section 5.4)."""
    return int(binom.ppf(0.5 - central / 2, trials, p)), int(binom.ppf(0.5 + central / 2, trials, p))


def zeta(value: np.ndarray, reference: np.ndarray, u: np.ndarray, u_reference: np.ndarray | float = 0) -> np.ndarray:
    """Zeta scores (ISO 13528): differences from the reference over the standard uncertainty of both together; twice
    E_n with k = 2."""
    return (value - reference) / np.hypot(u, u_reference)


def decorrelated(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """(r,) independent standard normal values, if errors (n,) have the claimed covariance (n, n) of rank r: what the
    errors are along its principal axes, over their uncertainties there."""
    variance, axes = np.linalg.eigh(cov)
    known = variance > NOTHING * variance[-1]
    return axes[:, known].T @ error / np.sqrt(variance[known])


def pit_uniformity(z: np.ndarray) -> tuple[float, float]:
    """Largest distance of the probability integral transform of z (n,) from uniform, and how often independent
    standard normal values give one as large (Kolmogorov and Smirnov)."""
    found = kstest(norm.cdf(z), "uniform")
    return float(found.statistic), float(found.pvalue)
