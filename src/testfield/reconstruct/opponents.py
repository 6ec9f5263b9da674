"""Other people's reconstruction: OpenCV's `triangulatePoints` and COLMAP's multi-view triangulation.

They get undistorted rays and give no covariance, so theirs is the sandwich with a gain found by moving each ray a
little: what a user would have to do who needs one.
"""

from collections.abc import Callable

import cv2
import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.estimate import Solved, estimate_of, settle, to_meet
from testfield.reconstruct.midpoint import UNWEIGHTED
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import rays_of, sights_of
from testfield.registry import register
from testfield.targets.field import Field

STEP = 1e-6
"""By which rays are moved on the plane before the lens: a few thousandths of a pixel."""

Triangulate = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Rays on the plane before the lens (k, 2) and camera-from-datum matrices (k, 3, 4) to a point (3,)."""


def by_opponent(
    observations: Observations, calibration: Calibration, field: Field, name: str, triangulate: Triangulate
) -> Points:
    """Loose targets as points by somebody else's function."""
    seen = sights_of(observations, calibration, field)
    near = settle(to_meet(seen, calibration), calibration, UNWEIGHTED)
    sights, rays = near.sights, near.rays
    n, k = sights.there.shape
    poses = calibration.stations
    matrix = np.concatenate([poses.R, poses.t_mm[:, :, None]], axis=2)
    xyz, gain = np.zeros((n, 3)), np.zeros((n, 3, k, 2))
    for point in range(n):
        there = np.flatnonzero(sights.there[point])
        plane, cameras = rays.plane[point, there], matrix[sights.station[point, there]]
        xyz[point] = triangulate(plane, cameras)
        for ray, column in enumerate(there):
            for axis in (0, 1):
                ends = []
                for sign in (1, -1):
                    moved = plane.copy()
                    moved[ray, axis] += sign * STEP
                    ends.append(triangulate(moved, cameras))
                gain[point, :, column, axis] = (ends[0] - ends[1]) / (2 * STEP)
    # Where an opponent gives no point there is none, nor a covariance; the others' are as they would be without it.
    rays = rays_of(sights, calibration, np.where(np.isfinite(xyz).all(axis=1, keepdims=True), xyz, near.xyz_mm))
    gain = np.einsum(
        "nikl,nklm->nikm", gain, rays.to_line / np.where(rays.depth_mm == 0, 1, rays.depth_mm)[..., None, None]
    )
    solved = Solved(sights, xyz, rays, gain.reshape(n, 3, 2 * k), near.rejected)
    return estimate_of(solved, seen, calibration).points(name, calibration.covariance)


def _opencv(plane: np.ndarray, cameras: np.ndarray) -> np.ndarray:
    """Two views are all that `cv2.triangulatePoints` takes: those whose rays meet most nearly at a right angle."""
    d = np.concatenate([plane, np.ones((len(plane), 1))], axis=1)
    d = np.einsum("kji,kj->ki", cameras[:, :, :3], d / np.linalg.norm(d, axis=1, keepdims=True))
    a, b = np.unravel_index(np.argmin(np.abs(d @ d.T) + np.eye(len(d))), (len(d), len(d)))
    homogeneous = cv2.triangulatePoints(cameras[a], cameras[b], plane[a], plane[b])[:, 0]
    return homogeneous[:3] / homogeneous[3]


@register("reconstructors", "opencv")
def opencv(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """`cv2.triangulatePoints`, on the two rays of each target that cross most nearly at a right angle."""
    return by_opponent(observations, calibration, field, "opencv", _opencv)


@register("reconstructors", "colmap")
def colmap(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """COLMAP's linear multi-view triangulation, by `pycolmap`, which the extra `peers` installs."""
    try:
        import pycolmap
    except ImportError as error:
        raise TestfieldError(
            "pycolmap is not installed", "measure.reconstruct", "pip install 'testfield[peers]'"
        ) from error

    def triangulate(plane: np.ndarray, cameras: np.ndarray) -> np.ndarray:
        rays = np.concatenate([plane, np.ones((len(plane), 1))], axis=1)
        point = pycolmap.triangulate_multi_view_point(list(cameras), rays / np.linalg.norm(rays, axis=1, keepdims=True))
        return np.full(3, np.nan) if point is None else np.asarray(point).ravel()

    return by_opponent(observations, calibration, field, "colmap", triangulate)
