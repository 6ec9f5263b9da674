"""Rigid alignment of measured onto true points."""

import numpy as np

from testfield.camera.pose import nearest_rotation


def rigid_fit(measured_mm: np.ndarray, true_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation (6 parameters, no scale) that bring measured (n, 3) nearest to true points (n, 3)."""
    m, t = measured_mm.mean(axis=0), true_mm.mean(axis=0)
    R = nearest_rotation((true_mm - t).T @ (measured_mm - m))
    return R, t - R @ m


def rigid_basis(points_mm: np.ndarray) -> np.ndarray:
    """(3n, 6) motion of all coordinates by three small translations and three small rotations about the middle."""
    centred = points_mm - points_mm.mean(axis=0)
    basis = np.zeros((len(points_mm), 3, 6))
    basis[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        basis[:, :, 3 + k] = np.cross(axis, centred)
    return basis.reshape(-1, 6)


def aligned_covariance(cov_mm2: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
    """Covariance (3n, 3n) after a rigid fit over all points: the S-transformation (METHODS section 5.4)."""
    basis = rigid_basis(points_mm)
    S = np.eye(len(cov_mm2)) - basis @ np.linalg.solve(basis.T @ basis, basis.T)
    return S @ cov_mm2 @ S.T
