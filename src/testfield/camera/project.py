"""Projection of points into pixels, with analytic Jacobians, and pixels back to rays."""

from dataclasses import dataclass

import numpy as np

from testfield.camera import lens
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix

NEGLIGIBLE_PX = 1e-13


def project_camera(interior: Interior, xyz_mm: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) in the camera frame.

    NaN where a point lies behind the camera or beyond the radius at which the distortion folds back.
    """
    z = xyz_mm[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = xyz_mm[..., :2] / z[..., None]
    c = interior.coefficients
    good = (z > 0) & (np.hypot(xy[..., 0], xy[..., 1]) < interior.lens.reach(c))
    uv = lens.distort(interior.lens, np.where(good[..., None], xy, 0.0), c)
    uv = uv * interior.parameters[:2] + interior.parameters[2:4]
    return np.where(good[..., None], uv + interior.displacement(uv), np.nan)


def project(interior: Interior, poses: Poses, xyz_mm: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of world points (n, 3), point i seen from camera-from-world pose i."""
    return project_camera(interior, poses.apply(xyz_mm))


@dataclass(frozen=True)
class ProjectionJacobian:
    """Derivatives of n pixels (n, 2, ·).

    `interior` by the parameters, `camera_point` (px/mm) by the point in the camera frame, `rotation` (px/rad) by
    a small rotation applied after R. The derivative by t is `camera_point` itself.
    """

    interior: np.ndarray
    camera_point: np.ndarray
    rotation: np.ndarray


def project_unchecked(interior: Interior, camera_mm: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of points (n, 3) in the camera frame, without the domain check of `project`: what an adjustment
    predicts."""
    xy = camera_mm[:, :2] / camera_mm[:, 2:]
    distorted = lens.distort(interior.lens, xy, interior.coefficients)
    uv = distorted * interior.parameters[:2] + interior.parameters[2:4]
    return uv if interior.modes_px is None else uv + interior.displacement(uv)


def camera_jacobian(interior: Interior, camera_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n, 2) of points (n, 3) in the camera frame, their derivatives (n, 2, p) by the interior orientation's
    parameters and (n, 2, 3) by the points; without the domain check of `project`: for points known to be in view."""
    z = camera_mm[:, 2]
    xy = camera_mm[:, :2] / z[:, None]
    c, focal = interior.coefficients, interior.parameters[:2]
    distorted = lens.distort(interior.lens, xy, c)
    uv = distorted * focal + interior.parameters[2:4]

    by_interior = np.zeros((len(uv), 2, len(interior.parameters)))
    by_interior[:, 0, 0], by_interior[:, 1, 1] = distorted[:, 0], distorted[:, 1]
    by_interior[:, 0, 2] = by_interior[:, 1, 3] = 1.0
    by_interior[:, :, 4 : 4 + len(c)] = focal[:, None] * interior.lens.by_coefficients(xy, c)

    by_xy = lens.jacobian_xy(interior.lens, xy, c) * (focal[:, None] / z[:, None, None])
    if interior.modes_px is not None:
        slope = interior.displacement_slope(uv)
        by_interior, by_xy = slope @ by_interior, slope @ by_xy
        by_interior[:, :, 4 + len(c) :] = interior.by_modes(uv)
        uv = uv + interior.displacement(uv)
    along = -(by_xy * xy[:, None, :]).sum(axis=2, keepdims=True)
    return uv, by_interior, np.concatenate([by_xy, along], axis=2)


def project_with_jacobian(
    interior: Interior, poses: Poses, xyz_mm: np.ndarray
) -> tuple[np.ndarray, ProjectionJacobian]:
    """Pixels and their derivatives, without the domain check of `project`: for points known to be in view."""
    rotated = np.einsum("nij,nj->ni", poses.R, xyz_mm)
    uv, by_interior, by_camera = camera_jacobian(interior, rotated + poses.t_mm)
    return uv, ProjectionJacobian(by_interior, by_camera, -by_camera @ cross_matrix(rotated))


def directions(interior: Interior, uv_px: np.ndarray) -> np.ndarray:
    """Directions (..., 3) in the camera frame with z = 1 of pixels (..., 2); NaN outside the lens' domain."""
    plain = uv_px
    for _ in range(30 if interior.field_px is not None else 0):  # a contraction: the field is nearly constant
        before, plain = plain, uv_px - interior.displacement(plain)
        if not np.any(np.abs(plain - before) > NEGLIGIBLE_PX):
            break
    distorted = (plain - interior.parameters[2:4]) / interior.parameters[:2]
    xy = lens.undistort(interior.lens, distorted, interior.coefficients)
    return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
