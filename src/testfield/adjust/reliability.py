"""What residuals can tell: the global test, the test of one observation, and how large a gross error must be to be seen
(Baarda 1968)."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi_squared

from testfield.adjust.bundle import Adjustment

SIGNIFICANCE = 0.001
"""Of the test of one observation: one good observation of a thousand is called a gross error."""
NONCENTRALITY = 17.07
"""By which a gross error must shift a chi-squared of one degree of freedom to be found in 80 cases of 100."""
CONTROLLED = 0.01
"""Redundancy below which an observation has no control: an error of it would show nowhere."""


@dataclass(frozen=True)
class GlobalTest:
    """`chi2` over `freedom` degrees of freedom against the 95 % interval (`low`, `high`) of true claims, all three
    divided by the freedom."""

    variance: float
    freedom: int
    low: float
    high: float

    @property
    def passed(self) -> bool:
        """Whether observations scatter as much as they claim."""
        return self.low <= self.variance <= self.high


def global_test(adjustment: Adjustment) -> GlobalTest:
    """The adjustment's variance factor against the interval in which it lies if all covariances are true."""
    freedom = adjustment.freedom
    if freedom < 1:
        return GlobalTest(float("nan"), freedom, float("nan"), float("nan"))
    low, high = chi_squared.ppf([0.025, 0.975], freedom) / freedom
    return GlobalTest(adjustment.chi2 / freedom, freedom, float(low), float(high))


@dataclass(frozen=True)
class Reliability:
    """Of m image observations: `redundancy` (m,) the smaller of the two redundancy numbers, 0 to 1; `test` (m,) the
    residual's size over its own standard deviation, Rayleigh distributed if all is well; `detectable_px` (m,) the
    smallest gross error that is found in 80 cases of 100, infinite without control; `effect` (m,) how far an error of
    that size, unfound, moves any unknown, in the unknown's standard deviations."""

    redundancy: np.ndarray
    test: np.ndarray
    detectable_px: np.ndarray
    effect: np.ndarray

    @property
    def uncontrolled(self) -> np.ndarray:
        """(m,) observations whose errors would show in no residual."""
        return self.redundancy < CONTROLLED

    @property
    def gross_errors(self) -> np.ndarray:
        """(m,) observations that contradict all others at the significance `SIGNIFICANCE`."""
        return self.test**2 > chi_squared.ppf(1 - SIGNIFICANCE, 2)


def reliability(adjustment: Adjustment) -> Reliability:
    """How well each image observation is controlled by all others."""
    network = adjustment.network
    values, vectors = np.linalg.eigh(adjustment.redundancy)
    values = np.clip(values, 0, 1)
    root = np.linalg.cholesky(network.cov_px2)
    white = np.linalg.solve(root, adjustment.residual_px[..., None])[..., 0] * np.sqrt(adjustment.weight)[:, None]
    along = np.einsum("mij,mi->mj", vectors, white)
    test = np.sqrt((np.where(values > CONTROLLED, along**2, 0) / np.maximum(values, CONTROLLED)).sum(axis=1))
    r = values[:, 0]
    with np.errstate(divide="ignore"):
        worst = np.einsum("mij,mj->mi", root, vectors[:, :, 0])
        detectable = np.where(r > CONTROLLED, np.sqrt(NONCENTRALITY / r), np.inf) * np.linalg.norm(worst, axis=1)
        effect = np.where(r > CONTROLLED, np.sqrt(NONCENTRALITY * (1 - r) / r), np.inf)
    return Reliability(r, test, detectable, effect)
