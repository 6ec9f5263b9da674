"""A point fitted to known distances from measured end points: accuracy without a registration (METHODS section 3).

A target in the middle, the vertex, is measured; so are end points around it, whose distances from the vertex are known
better than they are measured. The point that fits these distances best is set against the measured vertex.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from testfield.errors import TestfieldError

FLAT = 0.01
"""Directions to the end points whose smallest singular value is less than this part of the largest lie in a plane."""
MOST_STEPS, SETTLED = 50, 1e-12

Weights = Literal["equal", "covariance"]


@dataclass(frozen=True)
class FittedPoint:
    """The point fitted to m lengths, and what its residuals and the measured vertex say.

    `xyz_mm` (3,); `cov_mm2` (3, 3) its covariance, propagated from that of end points and lengths; `residual_mm` (m,)
    known minus fitted lengths. `s0` from the residuals: in mm with equal weights, else a pure number. `dop` (3,) square
    roots of the cofactors; `dispersion` s0 times these. `bias_mm` (3,) measured vertex minus fitted point, with
    `cov_bias_mm2` (3, 3). `mean_relative` the mean of residual over length, which is minus the scale error that the
    fit left in the residuals, with `u_mean_relative`. `gain` (3, m) is the change of the point with each length,
    `directions` (m, 3) point from the end points to the fitted one, and `cov_length_mm2` (m, m) is the covariance of
    known minus measured lengths.
    """

    xyz_mm: np.ndarray
    cov_mm2: np.ndarray
    residual_mm: np.ndarray
    s0: float
    dop: np.ndarray
    bias_mm: np.ndarray
    cov_bias_mm2: np.ndarray
    mean_relative: float
    u_mean_relative: float
    gain: np.ndarray
    directions: np.ndarray
    cov_length_mm2: np.ndarray

    @property
    def dispersion(self) -> np.ndarray:
        """(3,) the fitted point's uncertainty as its residuals tell it, in mm."""
        return self.s0 * self.dop

    @property
    def s_sys_mm(self) -> float:
        """What one length scatters by, from the residuals: with equal weights the radial uncertainty of an end point
        and its known length together. Unlike the dispersion it does not shrink with more end points."""
        return float(np.sqrt(self.residual_mm @ self.residual_mm / (len(self.residual_mm) - 3)))

    @property
    def expected_s_sys_mm(self) -> float:
        """The root of the mean square of `s_sys_mm` that the claimed covariance foretells."""
        left = np.eye(len(self.residual_mm)) - self.directions @ self.gain
        return float(np.sqrt(np.trace(left @ self.cov_length_mm2 @ left.T) / (len(self.residual_mm) - 3)))

    @property
    def bias_chi2(self) -> float:
        """b^T Cov(b)^-1 b: of true claims chi-squared with three degrees of freedom."""
        return float(self.bias_mm @ np.linalg.solve(self.cov_bias_mm2, self.bias_mm))

    def scale_bias_mm(self, scale_error: float, lengths_mm: np.ndarray) -> np.ndarray:
        """(3,) the bias that a relative scale error of all measured coordinates makes; zero where the end points lie
        around the vertex as mirror images."""
        return scale_error * self.gain @ lengths_mm


def fit_point(
    ends_mm: np.ndarray,
    lengths_mm: np.ndarray,
    vertex_mm: np.ndarray,
    cov_mm2: np.ndarray,
    u_length_mm: np.ndarray,
    weights: Weights = "equal",
) -> FittedPoint:
    """The point whose distances from measured end points (m, 3) are nearest to the known lengths (m,), m >= 4.

    `vertex_mm` (3,) is the measured vertex, where the fit starts; `cov_mm2` (3m + 3, 3m + 3) the joint covariance of
    the end points and, last, the vertex; `u_length_mm` (m,). `weights`: `equal`, or `covariance`, the inverse of the
    covariance of all lengths together. Raises `TestfieldError` for too few end points, and for such as lie with the
    vertex in a plane: the distances do not change with a small step across it, and a mirror image fits as well.
    """
    m = len(lengths_mm)
    if m < 4:
        raise TestfieldError(f"{m} lengths determine no point with a check on it", "lengths", "give four or more")
    of_ends, P = cov_mm2[: 3 * m, : 3 * m], vertex_mm.astype(float)
    for _ in range(MOST_STEPS):
        residual, J, S = _linear(P, ends_mm, lengths_mm, of_ends, u_length_mm)
        _observable(J)
        W = np.eye(m) if weights == "equal" else np.linalg.inv(S)
        step = np.linalg.solve(J.T @ W @ J, J.T @ W @ residual)
        P = P + step
        if np.linalg.norm(step) <= SETTLED * lengths_mm.max():
            break
    else:
        raise TestfieldError(
            "the fit of the point does not settle", "lengths", "look for a wrong length or two end points exchanged"
        )
    residual, J, S = _linear(P, ends_mm, lengths_mm, of_ends, u_length_mm)
    W = np.eye(m) if weights == "equal" else np.linalg.inv(S)
    cofactor = np.linalg.inv(J.T @ W @ J)
    gain = cofactor @ J.T @ W
    covariance = gain @ S @ gain.T
    # dP/dQ: an end point that moves along its direction does what a longer length does.
    K = gain @ _along(J)
    with_vertex = K @ cov_mm2[: 3 * m, 3 * m :]
    left = np.eye(m) - J @ gain
    relative = 1 / (m * lengths_mm)
    return FittedPoint(
        P,
        covariance,
        residual,
        float(np.sqrt(residual @ W @ residual / (m - 3))),
        np.sqrt(np.diag(cofactor)),
        vertex_mm - P,
        cov_mm2[3 * m :, 3 * m :] + covariance - with_vertex - with_vertex.T,
        float(relative @ residual),
        float(np.sqrt(relative @ left @ S @ left.T @ relative)),
        gain,
        J,
        S,
    )


def without_correlation(cov_mm2: np.ndarray) -> np.ndarray:
    """The same covariance (3n, 3n) with every point's own (3, 3) alone: what one has who ignores that points share a
    calibration."""
    n = len(cov_mm2) // 3
    return cov_mm2 * np.kron(np.eye(n), np.ones((3, 3)))


def _linear(
    P: np.ndarray, ends: np.ndarray, lengths: np.ndarray, of_ends: np.ndarray, u_length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (m,), directions from the end points to P (m, 3), and the covariance (m, m) of the residuals."""
    off = P - ends
    distance = np.linalg.norm(off, axis=1)
    if distance.min() <= 1e-9 * lengths.max():
        raise TestfieldError("an end point lies in the vertex", "ends", "give other end points")
    J = off / distance[:, None]
    along = _along(J)
    return lengths - distance, J, along @ of_ends @ along.T + np.diag(u_length**2)


def _along(J: np.ndarray) -> np.ndarray:
    """(m, 3m) what each distance sees of all end points' coordinates, but for the sign."""
    m = len(J)
    blocks = np.zeros((m, m, 3))
    blocks[np.arange(m), np.arange(m)] = J
    return blocks.reshape(m, 3 * m)


def _observable(J: np.ndarray) -> None:
    _, size, axes = np.linalg.svd(J)
    if size[2] < FLAT * size[0]:
        normal = ", ".join(f"{v:+.3f}" for v in axes[2])
        raise TestfieldError(
            f"vertex and end points lie in a plane, so the point is unobservable along its normal ({normal})",
            "ends",
            "add end points in front of and behind that plane",
        )
