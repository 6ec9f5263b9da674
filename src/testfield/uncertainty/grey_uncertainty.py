"""Grey standard uncertainty of small samples, and what it is in the words of statistics.

Sort the sample, cumulate it, and look how far it stays below the straight line from nothing to its total. These gaps,
divided by the sample's size, are the *grey coefficient vector* of the sample (one for each coordinate). Its largest
component times 2.5 is the grey standard uncertainty, which is exactly Peters' formula, 1.25 times the mean absolute
deviation; its sum, suitably scaled, is exactly Downton's estimator, that is Gini's mean difference. Both are linear in
the ordered sample, so they do not depend on the order in which it was measured, follow a shift and a change of unit,
and need no law; that they estimate sigma without bias is true of the normal law only.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import gammaln

from testfield.errors import TestfieldError

SUP_NORM_FACTOR = 2.5
"""Of the grey standard uncertainty; sqrt(2 pi) = 2.5066 would be right for the normal law."""


def grey_coefficients(sample: np.ndarray, axis: int = -1) -> np.ndarray:
    """Grey coefficient vectors of samples along `axis`.

    Parameters
    ----------
    sample : (..., n, ...) values in any unit, n >= 2.

    Returns
    -------
    (..., n - 1, ...) gaps (k mean - sum of the k smallest) / n, k = 1 ... n - 1, in the sample's unit; none is below 0.
    """
    return np.maximum(_gaps(np.sort(_checked(sample, axis), axis=-1)), 0).swapaxes(axis, -1)


def gaps_as_measured(sample: np.ndarray, axis: int = -1) -> np.ndarray:
    """The same gaps without sorting first, so that they depend on the order of the values; of either sign.

    This is the other reading of the published definition. It is here to be compared with, not to be used.
    """
    return _gaps(_checked(sample, axis)).swapaxes(axis, -1)


def sup_norm_uncertainty(sample: np.ndarray, axis: int = -1, unbiased: bool = False) -> np.ndarray:
    """Grey standard uncertainty: 2.5 times the largest gap, which is 1.25 times the mean absolute deviation (Peters).

    `unbiased` scales it so that its expectation is sigma for the normal law: by sqrt(2 pi) / 2.5 sqrt(n / (n - 1)).
    """
    u = SUP_NORM_FACTOR * grey_coefficients(sample, axis).max(axis=axis)
    n = np.shape(sample)[axis]
    return u * np.sqrt(2 * np.pi * n / (n - 1)) / SUP_NORM_FACTOR if unbiased else u


def l1_norm_uncertainty(sample: np.ndarray, axis: int = -1) -> np.ndarray:
    """2 sqrt(pi) / (n - 1) times the sum of the gaps (Downton): unbiased for the normal law as it is."""
    n = np.shape(sample)[axis]
    return 2 * np.sqrt(np.pi) / (n - 1) * grey_coefficients(sample, axis).sum(axis=axis)


def bessel_uncertainty(sample: np.ndarray, axis: int = -1, unbiased: bool = False) -> np.ndarray:
    """The experimental standard deviation with n - 1; `unbiased` divides it by c4(n), for the normal law."""
    values = _checked(sample, axis)
    s = values.std(axis=-1, ddof=1)
    return s / bessel_bias(values.shape[-1]) if unbiased else s


def bessel_bias(n: int) -> float:
    """c4(n): the expectation of the experimental standard deviation of n normal values of sigma 1."""
    return float(np.sqrt(2 / (n - 1)) * np.exp(gammaln(n / 2) - gammaln((n - 1) / 2)))


def unsorted_uncertainty(sample: np.ndarray, axis: int = -1) -> np.ndarray:
    """2.5 times the largest gap of the values in the order they were measured in: another order, another value."""
    return SUP_NORM_FACTOR * np.abs(gaps_as_measured(sample, axis)).max(axis=axis)


ESTIMATORS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "grey, largest gap": lambda sample: sup_norm_uncertainty(sample),
    "grey, largest gap, unbiased": lambda sample: sup_norm_uncertainty(sample, unbiased=True),
    "grey, sum of gaps": lambda sample: l1_norm_uncertainty(sample),
    "Bessel": lambda sample: bessel_uncertainty(sample),
    "Bessel, unbiased": lambda sample: bessel_uncertainty(sample, unbiased=True),
}
"""Estimators of a standard uncertainty from (..., n) samples by name; the unbiased ones are so for the normal law."""


def _gaps(values: np.ndarray) -> np.ndarray:
    n = values.shape[-1]
    # Deviations are cumulated, not values: so nothing is lost where values are large and their scatter is small.
    return -np.cumsum(values - values.mean(axis=-1, keepdims=True), axis=-1)[..., :-1] / n


def _checked(sample: np.ndarray, axis: int) -> np.ndarray:
    values = np.asarray(sample, float)
    if values.ndim == 0 or values.shape[axis] < 2:
        raise TestfieldError(
            f"a sample of shape {values.shape} has less than two values", "grey uncertainty", "give two or more"
        )
    if not np.isfinite(values).all():
        raise TestfieldError("a sample has values that are not finite", "grey uncertainty", "leave them out")
    return values.swapaxes(axis, -1)
