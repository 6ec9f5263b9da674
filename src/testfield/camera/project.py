"""Projection of points into pixels, with analytic Jacobians, and pixels back to rays."""

from dataclasses import dataclass

import numpy as np

from testfield.camera import brown
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix


def project_camera(interior: Interior, xyz_mm: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) in the camera frame.

    NaN where a point lies behind the camera or beyond the radius at which the distortion folds back.
    """
    z = xyz_mm[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = xyz_mm[..., :2] / z[..., None]
    coefficients = interior.parameters[4:]
    good = (z > 0) & (np.hypot(xy[..., 0], xy[..., 1]) < brown.fold_radius(coefficients))
    distorted = brown.distort(np.where(good[..., None], xy, 0.0), coefficients)
    uv = distorted * interior.parameters[:2] + interior.parameters[2:4]
    return np.where(good[..., None], uv, np.nan)


def project(interior: Interior, poses: Poses, xyz_mm: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of world points (n, 3), point i seen from camera-from-world pose i."""
    return project_camera(interior, poses.apply(xyz_mm))


@dataclass(frozen=True)
class ProjectionJacobian:
    """Derivatives of n pixels (n, 2, ·).

    `interior` by the 9 parameters, `camera_point` (px/mm) by the point in the camera frame, `rotation` (px/rad) by
    a small rotation applied after R. The derivative by t is `camera_point` itself.
    """

    interior: np.ndarray
    camera_point: np.ndarray
    rotation: np.ndarray


def project_with_jacobian(
    interior: Interior, poses: Poses, xyz_mm: np.ndarray
) -> tuple[np.ndarray, ProjectionJacobian]:
    """Pixels and their derivatives, without the domain check of `project`: for points known to be in view."""
    rotated = np.einsum("nij,nj->ni", poses.R, xyz_mm)
    camera = rotated + poses.t_mm
    z = camera[:, 2]
    xy = camera[:, :2] / z[:, None]
    coefficients, focal = interior.parameters[4:], interior.parameters[:2]
    distorted = brown.distort(xy, coefficients)
    uv = distorted * focal + interior.parameters[2:4]

    by_interior = np.zeros((len(uv), 2, 9))
    by_interior[:, 0, 0], by_interior[:, 1, 1] = distorted[:, 0], distorted[:, 1]
    by_interior[:, 0, 2] = by_interior[:, 1, 3] = 1.0
    by_interior[:, :, 4:] = focal[:, None] * brown.jacobian_coefficients(xy)

    normalised = np.zeros((len(uv), 2, 3))
    normalised[:, 0, 0] = normalised[:, 1, 1] = 1 / z
    normalised[:, :, 2] = -xy / z[:, None]
    by_camera = focal[:, None] * (brown.jacobian_xy(xy, coefficients) @ normalised)
    return uv, ProjectionJacobian(by_interior, by_camera, -by_camera @ cross_matrix(rotated))


def directions(interior: Interior, uv_px: np.ndarray) -> np.ndarray:
    """Directions (..., 3) in the camera frame with z = 1 of pixels (..., 2); NaN outside the lens' domain."""
    distorted = (uv_px - interior.parameters[2:4]) / interior.parameters[:2]
    xy = brown.undistort(distorted, interior.parameters[4:])
    return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
