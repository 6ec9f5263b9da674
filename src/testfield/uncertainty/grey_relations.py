"""Grey relational degrees: how alike the course of a factor is to that of a result, by seven published definitions.

All take `reference` (..., n), the result, and `factors` (..., m, n), and return (..., m) degrees; leading axes are
independent problems. None of them knows of chance, and all but the T-type are blind to sign. `deng` and `b_type` ask
for sequences that were brought to one scale before: `mean_image`, `initial_image` or `range_image`.
"""

from collections.abc import Callable

import numpy as np

from testfield.errors import TestfieldError


def mean_image(sequence: np.ndarray) -> np.ndarray:
    """(..., n) sequences divided by their means."""
    return _divided(sequence, np.mean(sequence, axis=-1, keepdims=True), "mean")


def initial_image(sequence: np.ndarray) -> np.ndarray:
    """(..., n) sequences divided by their first values."""
    return _divided(sequence, np.asarray(sequence, float)[..., :1], "first value")


def range_image(sequence: np.ndarray) -> np.ndarray:
    """(..., n) sequences brought to the range from 0 to 1."""
    low = np.min(sequence, axis=-1, keepdims=True)
    return _divided(sequence - low, np.max(sequence, axis=-1, keepdims=True) - low, "range")


def deng(reference: np.ndarray, factors: np.ndarray, rho: float = 0.5, weights: np.ndarray | None = None) -> np.ndarray:
    """Deng's degree: the mean (with `weights` (n,), their weighted mean) of his relational coefficients."""
    xi = deng_coefficients(reference, factors, rho)
    return xi.mean(axis=-1) if weights is None else xi @ (np.asarray(weights, float) / np.sum(weights))


def deng_coefficients(reference: np.ndarray, factors: np.ndarray, rho: float = 0.5) -> np.ndarray:
    """(..., m, n) Deng's relational coefficients; never below rho / (1 + rho).

    They depend on the largest difference of *any* factor: a factor more or less changes the degrees of all others.
    """
    if not 0 < rho <= 1:
        raise TestfieldError(f"rho is {rho:g}", "Deng's degree", "choose it above 0 and not above 1; 0.5 is usual")
    x0, x = _checked(reference, factors, 1)
    gap = np.abs(x - x0[..., None, :])
    least, most = (end(gap, axis=(-2, -1), keepdims=True) for end in (np.min, np.max))
    return np.where(most > 0, (least + rho * most) / np.where(most > 0, gap + rho * most, 1.0), 1.0)


def absolute(reference: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Liu's absolute degree, from the signed areas below the courses that begin at zero. It changes with the unit."""
    x0, x = _checked(reference, factors, 2)
    s0, s = _area(x0 - x0[..., :1])[..., None], _area(x - x[..., :1])
    alike = 1 + np.abs(s0) + np.abs(s)
    return alike / (alike + np.abs(s - s0))


def relative(reference: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Liu's relative degree: the absolute one of the sequences divided by their first values."""
    x0, x = _checked(reference, factors, 2)
    return absolute(initial_image(x0), initial_image(x))


def synthetic(reference: np.ndarray, factors: np.ndarray, theta: float = 0.5) -> np.ndarray:
    """Liu's synthetic degree: `theta` times the absolute and the rest of the relative one."""
    if not 0 <= theta <= 1:
        raise TestfieldError(f"theta is {theta:g}", "the synthetic degree", "choose it from 0 to 1; 0.5 is usual")
    return theta * absolute(reference, factors) + (1 - theta) * relative(reference, factors)


def t_type(reference: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """T-type degree (Tang), from -1 to 1: like signs and like sizes of the increments, each in units of their mean."""
    x0, x = _checked(reference, factors, 2)
    y0, y = _increments(x0)[..., None, :], _increments(x)
    small, large = np.minimum(np.abs(y0), np.abs(y)), np.maximum(np.abs(y0), np.abs(y))
    return (np.sign(y0 * y) * small / np.where(large > 0, large, 1.0)).mean(axis=-1)


def slope(reference: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Slope degree (Dang): increments relative to the mean, compared one by one."""
    x0, x = _checked(reference, factors, 2)
    d0, d = np.diff(mean_image(x0))[..., None, :], np.diff(mean_image(x))
    alike = 1 + np.abs(d0)
    return (alike / (alike + np.abs(d0 - d))).mean(axis=-1)


def b_type(reference: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """B-type degree (Wang): mean differences of the courses, of their first and of their second differences."""
    x0, x = _checked(reference, factors, 3)
    off = x - x0[..., None, :]
    return 1 / (1 + sum(np.abs(np.diff(off, order)).mean(axis=-1) for order in range(3)))


DEGREES: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "Deng": lambda reference, factors: deng(mean_image(reference), mean_image(factors)),
    "absolute": absolute,
    "relative": relative,
    "synthetic": synthetic,
    "T-type": t_type,
    "slope": slope,
    "B-type": lambda reference, factors: b_type(mean_image(reference), mean_image(factors)),
}
"""The seven degrees by name, with the scaling that is usual for each."""


def _area(course: np.ndarray) -> np.ndarray:
    return course[..., 1:-1].sum(axis=-1) + course[..., -1] / 2


def _increments(sequence: np.ndarray) -> np.ndarray:
    step = np.diff(sequence)
    size = np.abs(step).mean(axis=-1, keepdims=True)
    return step / np.where(size > 0, size, 1.0)


def _divided(sequence: np.ndarray, by: np.ndarray, name: str) -> np.ndarray:
    if (np.asarray(by) == 0).any():
        raise TestfieldError(
            f"a sequence cannot be divided by its {name}, which is zero",
            "grey relational degree",
            "choose another scaling, or leave the factor out",
        )
    return np.asarray(sequence, float) / by


def _checked(reference: np.ndarray, factors: np.ndarray, least: int) -> tuple[np.ndarray, np.ndarray]:
    x0, x = np.asarray(reference, float), np.asarray(factors, float)
    if x0.ndim < 1 or x.ndim != x0.ndim + 1 or x.shape[:-2] != x0.shape[:-1] or x.shape[-1] != x0.shape[-1]:
        raise TestfieldError(
            f"a reference of shape {x0.shape} and factors of shape {x.shape} do not belong together",
            "grey relational degree",
            "give (..., n) and (..., m, n)",
        )
    if x0.shape[-1] < least:
        raise TestfieldError(
            f"sequences of {x0.shape[-1]} value(s) are too short", "grey relational degree", f"give {least} or more"
        )
    if not (np.isfinite(x0).all() and np.isfinite(x).all()):
        raise TestfieldError("a sequence has values that are not finite", "grey relational degree", "leave them out")
    return x0, x
