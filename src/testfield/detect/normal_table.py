"""The normal distribution in compiled functions: Taylor series about the points of a table.

The distribution is right to 1e-15, its density to 2e-13.
"""

import math

import numpy as np

from testfield.store.compiled import compiled

FARTHEST, POINTS_A_UNIT, TERMS = 9, 32, 7
"""Beyond the first the distribution is 0 or 1 to 1e-18; between two points the next term is below 1e-15."""


def _table() -> np.ndarray:
    """(2 * FARTHEST * POINTS_A_UNIT, TERMS) coefficients of the distribution's series about the cells' middles."""
    at = (np.arange(2 * FARTHEST * POINTS_A_UNIT) + 0.5) / POINTS_A_UNIT - FARTHEST
    density = np.exp(-0.5 * at * at) / math.sqrt(2 * math.pi)
    # The density's derivatives are Hermite polynomials times the density, of alternating sign.
    hermite = [np.ones_like(at), at]
    for n in range(1, TERMS - 2):
        hermite.append(at * hermite[n] - n * hermite[n - 1])
    whole = np.array([0.5 * math.erfc(-z * math.sqrt(0.5)) for z in at])
    terms = [(-1) ** n * h * density / math.factorial(n + 1) for n, h in enumerate(hermite)]
    return np.column_stack([whole, *terms])


TABLE = _table()


@compiled
def normal(z: float) -> tuple[float, float]:
    """The standard normal distribution and its density at z; of NaN nothing."""
    if not abs(z) < FARTHEST:
        return 1.0 if z > 0 else 0.0, 0.0
    place = (z + FARTHEST) * POINTS_A_UNIT
    k = int(place)
    d = (place - k - 0.5) / POINTS_A_UNIT
    whole, slope = TABLE[k, TERMS - 1], 0.0
    for n in range(TERMS - 2, -1, -1):
        slope = slope * d + whole
        whole = whole * d + TABLE[k, n]
    return whole, slope
