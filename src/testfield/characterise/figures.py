"""A figure with its standard uncertainty, and straight lines through points that have one."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Figure:
    """`value` with its standard uncertainty `u` (NaN where it cannot be stated) in `unit`."""

    value: float
    u: float
    unit: str

    def to_json(self) -> dict[str, float | str | None]:
        """As JSON: what is no number is null."""
        return {
            "value": float(self.value) if np.isfinite(self.value) else None,
            "u": float(self.u) if np.isfinite(self.u) else None,
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Line:
    """A straight line: `slope`, `offset`, their standard uncertainties, and by how much points scatter about it over
    what they state (`scatter`, 1 where as stated)."""

    slope: float
    offset: float
    u_slope: float
    u_offset: float
    scatter: float


def through_origin(x: np.ndarray, y: np.ndarray, cov_y: np.ndarray) -> Line:
    """The line y = slope x by ordinary least squares, as EMVA 1288 asks for gain and responsivity.

    x, y (n,), `cov_y` (n, n) of y; the uncertainty is propagated through the estimator and widened by the scatter of
    the residuals where that is larger than stated (Birge ratio).
    """
    weight = x / float(x @ x)
    slope = float(weight @ y)
    u = float(np.sqrt(weight @ cov_y @ weight))
    scatter = _scatter(y - slope * x, np.sqrt(np.diag(cov_y)), 1)
    return Line(slope, 0.0, u * max(scatter, 1.0), 0.0, scatter)


def straight(x: np.ndarray, y: np.ndarray, u_y: np.ndarray) -> Line:
    """The line y = slope x + offset by weighted least squares, widened as `through_origin` is. x, y, u_y (n,)."""
    A = np.column_stack([x - x.mean(), np.ones(len(x))]) / u_y[:, None]
    inverse = np.linalg.inv(A.T @ A)
    slope, middle = inverse @ (A.T @ (y / u_y))
    scatter = _scatter(y - slope * (x - x.mean()) - middle, u_y, 2)
    J = np.array([[1.0, 0.0], [-x.mean(), 1.0]])
    cov = J @ inverse @ J.T * max(scatter, 1.0) ** 2
    u_slope, u_offset = (float(v) for v in np.sqrt(np.diag(cov)))
    return Line(float(slope), float(middle - slope * x.mean()), u_slope, u_offset, scatter)


def _scatter(residual: np.ndarray, u: np.ndarray, parameters: int) -> float:
    free = len(residual) - parameters
    return float(np.sqrt(np.sum((residual / u) ** 2) / free)) if free > 0 else 1.0
