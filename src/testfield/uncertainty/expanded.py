"""Expanded uncertainties where standard uncertainties are estimates themselves (GUM, JCGM 100 annex G)."""

import numpy as np
from scipy.stats import norm, t

from testfield.errors import TestfieldError


def effective_freedom(u: np.ndarray, freedom: np.ndarray) -> float:
    """Effective degrees of freedom of the root of the summed squares of independent contributions `u` (n,), each in the
    result's unit and with `freedom` (n,) degrees, infinite where it is known (Welch and Satterthwaite); infinite where
    all are. Raises `TestfieldError` for a negative contribution, one without a degree of freedom, or none above 0."""
    u, freedom = np.broadcast_arrays(np.asarray(u, float), np.asarray(freedom, float))
    if not ((u >= 0).all() and (freedom > 0).all() and u.any()):
        raise TestfieldError(
            "contributions need uncertainties of 0 or more, one above it, and degrees of freedom above 0",
            "effective degrees of freedom", "leave out what was not estimated",
        )  # fmt: skip
    share = u**2 / (u**2).sum()
    rest = float((share**2 / freedom).sum())
    return 1 / rest if rest else np.inf


def expanded_factor(freedom: float, p: float = 0.95) -> float:
    """k of the expanded uncertainty U = k u at `p`: Student's t, as usual of the degrees rounded down."""
    whole = np.floor(freedom) if np.isfinite(freedom) and freedom >= 1 else freedom
    return float(norm.ppf(0.5 + p / 2) if np.isinf(whole) else t.ppf(0.5 + p / 2, whole))
