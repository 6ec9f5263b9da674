"""Brown's lens distortion on normalised image coordinates, its Jacobians and its inverse (Brown 1971)."""

import numpy as np


def distort(xy: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Distorted normalised coordinates.

    `xy` (..., 2) normalised (x/z, y/z); `coefficients` (5,) k1 k2 k3 p1 p2. Returns (..., 2).
    """
    k1, k2, k3, p1, p2 = coefficients
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def jacobian_xy(xy: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Derivative of `distort` by the normalised coordinates: (..., 2, 2)."""
    k1, k2, k3, p1, p2 = coefficients
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    off = x * y * slope + 2 * p1 * x + 2 * p2 * y
    return np.stack(
        [
            np.stack([radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, off], -1),
            np.stack([off, radial + y * y * slope + 6 * p1 * y + 2 * p2 * x], -1),
        ],
        axis=-2,
    )


def jacobian_coefficients(xy: np.ndarray) -> np.ndarray:
    """Derivative of `distort` by k1 k2 k3 p1 p2: (..., 2, 5)."""
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    r4, r6 = r2 * r2, r2 * r2 * r2
    return np.stack(
        [
            np.stack([x * r2, x * r4, x * r6, 2 * x * y, r2 + 2 * x * x], -1),
            np.stack([y * r2, y * r4, y * r6, r2 + 2 * y * y, 2 * x * y], -1),
        ],
        axis=-2,
    )


def fold_radius(coefficients: np.ndarray) -> float:
    """Normalised radius at which the radial polynomial turns back, infinity where it never does.

    Beyond it two directions share one pixel, so a projection there is meaningless.
    """
    k1, k2, k3 = coefficients[:3]
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0]) if np.any(coefficients[:3]) else np.array([])
    squares = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
    return float(np.sqrt(min(squares))) if squares else np.inf


def undistort(distorted: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Inverse of `distort` by Newton's method: (..., 2) in, (..., 2) out, NaN where there is no inverse.

    Converges to machine precision inside the fold; a result beyond it, or one that does not return to the start
    within 1e-12, is NaN.
    """
    xy = distorted.copy()
    for _ in range(20):
        residual = distort(xy, coefficients) - distorted
        step = np.linalg.solve(jacobian_xy(xy, coefficients), residual[..., None])[..., 0]
        xy = xy - step
        if not np.any(np.abs(step) > 1e-15):
            break
    good = np.abs(distort(xy, coefficients) - distorted).max(-1) < 1e-12
    good &= np.hypot(xy[..., 0], xy[..., 1]) < fold_radius(coefficients)
    return np.where(good[..., None], xy, np.nan)
