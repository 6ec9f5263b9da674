"""Projection of points into pixels, with analytic Jacobians, and pixels back to rays."""

from dataclasses import dataclass

import numpy as np

from testfield.camera import lens
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix

NEGLIGIBLE_PX = 1e-13


def project_camera(interior: Interior, xyz_mm: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) in the camera frame.

    NaN where a point lies behind the camera (of a fisheye: beyond its last angle), or where the distortion folds back.
    """
    uv, _, good = lens.image_of_rays(interior.lens, xyz_mm, interior.coefficients)
    uv = np.where(good[..., None], uv, 0.0) * interior.parameters[:2] + interior.parameters[2:4]
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
    distorted = lens.formula_of_rays(interior.lens, camera_mm, interior.coefficients)[0]
    uv = distorted * interior.parameters[:2] + interior.parameters[2:4]
    return uv if interior.modes_px is None else uv + interior.displacement(uv)


def camera_jacobian(interior: Interior, camera_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n, 2) of points (n, 3) in the camera frame, their derivatives (n, 2, p) by the interior orientation's
    parameters and (n, 2, 3) by the points; without the domain check of `project`: for points known to be in view."""
    c, focal = interior.coefficients, interior.parameters[:2]
    distorted, by_rays = lens.formula_of_rays(interior.lens, camera_mm, c)
    uv = distorted * focal + interior.parameters[2:4]

    by_interior = np.zeros((len(uv), 2, len(interior.parameters)))
    by_interior[:, 0, 0], by_interior[:, 1, 1] = distorted[:, 0], distorted[:, 1]
    by_interior[:, 0, 2] = by_interior[:, 1, 3] = 1.0
    ray = camera_mm if interior.lens.by_angle else camera_mm[:, :2] / camera_mm[:, 2:]
    np.multiply(focal[:, None], interior.lens.by_coefficients(ray, c), out=by_interior[:, :, 4 : 4 + len(c)])
    by_point = by_rays
    by_point *= focal[:, None]
    if interior.modes_px is not None:
        slope = interior.displacement_slope(uv)
        by_interior, by_point = slope @ by_interior, slope @ by_point
        by_interior[:, :, 4 + len(c) :] = interior.by_modes(uv)
        uv = uv + interior.displacement(uv)
    return uv, by_interior, by_point


def project_with_jacobian(
    interior: Interior, poses: Poses, xyz_mm: np.ndarray
) -> tuple[np.ndarray, ProjectionJacobian]:
    """Pixels and their derivatives, without the domain check of `project`: for points known to be in view."""
    rotated = np.einsum("nij,nj->ni", poses.R, xyz_mm)
    uv, by_interior, by_camera = camera_jacobian(interior, rotated + poses.t_mm)
    return uv, ProjectionJacobian(by_interior, by_camera, -by_camera @ cross_matrix(rotated))


def directions(interior: Interior, uv_px: np.ndarray) -> np.ndarray:
    """Directions (..., 3) in the camera frame of pixels (..., 2), NaN outside the lens' domain: with z = 1 before the
    camera, of length one where a fisheye looks sideways and back."""
    plain = uv_px
    for _ in range(30 if interior.field_px is not None else 0):  # a contraction: the field is nearly constant
        before, plain = plain, uv_px - interior.displacement(plain)
        if not np.any(np.abs(plain - before) > NEGLIGIBLE_PX):
            break
    distorted = (plain - interior.parameters[2:4]) / interior.parameters[:2]
    return lens.rays_of_image(interior.lens, distorted, interior.coefficients)


def plane_of(interior: Interior, uv_px: np.ndarray) -> np.ndarray:
    """Places (..., 2) of pixels (..., 2) on the plane z = 1, NaN where there is none."""
    ray = directions(interior, uv_px)
    return np.where(ray[..., 2:] == 1, ray[..., :2], np.nan)
