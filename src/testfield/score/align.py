"""Rigid alignment of measured onto true points."""

import numpy as np

from testfield.camera.pose import nearest_rotation

STRAIGHT = 1e-6
"""Points that spread across their row by less than this part of their spread along it lie in a straight row."""


def rigid_fit(measured_mm: np.ndarray, true_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation (6 parameters, no scale) that bring measured (n, 3) nearest to true points (n, 3).

    Of true points in a straight row the turn about the row is free: the rotation is then the smallest that turns the
    measured row into the true one.
    """
    m, t = measured_mm.mean(axis=0), true_mm.mean(axis=0)
    row = row_of(true_mm)
    if row is None:
        R = nearest_rotation((true_mm - t).T @ (measured_mm - m))
    else:
        R = _turn((measured_mm - m).T @ ((true_mm - t) @ row), row)
    return R, t - R @ m


def rigid_basis(points_mm: np.ndarray) -> np.ndarray:
    """(3n, r) motion of all coordinates by three small translations and by as many small rotations about the middle as
    move anything: r = 6; of points in a straight row 5; of a single one 3."""
    centred = points_mm - points_mm.mean(axis=0)
    row = row_of(points_mm)
    if row is None:
        axes = np.eye(3)
    else:
        across = np.linalg.svd(row[None])[2][1:]
        axes = across if row.any() else across[:0]
    basis = np.zeros((len(points_mm), 3, 3 + len(axes)))
    basis[:, :, :3] = np.eye(3)
    for k, axis in enumerate(axes):
        basis[:, :, 3 + k] = np.cross(axis, centred)
    return basis.reshape(3 * len(points_mm), 3 + len(axes))


def row_of(points_mm: np.ndarray) -> np.ndarray | None:
    """(3,) direction of the straight row in which points (n, 3) lie, 0 where all are in one place; None of others."""
    _, size, axes = np.linalg.svd(points_mm - points_mm.mean(axis=0), full_matrices=False)
    if not size[0]:
        return np.zeros(3)
    return axes[0] if len(size) < 2 or size[1] <= STRAIGHT * size[0] else None


def aligned_covariance(cov_mm2: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
    """Covariance (3n, 3n) after a rigid fit over all points: the S-transformation (METHODS section 5.4). Its rank is 3n
    less the columns of `rigid_basis`."""
    basis = rigid_basis(points_mm)
    S = np.eye(len(cov_mm2)) - basis @ np.linalg.solve(basis.T @ basis, basis.T)
    return S @ cov_mm2 @ S.T


def _turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that turns the direction of a (3,) into that of b (3,); none where one is 0."""
    if not (a.any() and b.any()):
        return np.eye(3)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    if a @ b < -1 + 1e-12:  # straight back: about any axis across
        across = np.linalg.svd(a[None])[2][1]
        return 2 * np.outer(across, across) - np.eye(3)
    # Two reflections: in the plane across a + b, after that across a.
    middle = (a + b) / np.linalg.norm(a + b)
    return (2 * np.outer(middle, middle) - np.eye(3)) @ (2 * np.outer(a, a) - np.eye(3))
