"""Which way a lone target faces, from the shapes of its images.

To first order a disc of radius r with unit normal n has the image moments M = r^2/4 J (I - n n^T) J^T, with J the
derivative of the pixel by the point. So each view gives three equations that are linear in the entries of n n^T.
"""

from collections.abc import Sequence

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project_with_jacobian
from testfield.camera.several import by_camera

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def target_normals(
    interiors: Sequence[Interior],
    camera: np.ndarray,
    poses: Poses,
    there: np.ndarray,
    centre_mm: np.ndarray,
    radius_mm: np.ndarray,
    moments_px2: np.ndarray,
) -> np.ndarray:
    """Unit normals (n, 3) of n targets, towards their cameras.

    `poses` (n * k) camera-from-datum of the views, those of one target together, by the cameras `camera` (n * k) of
    `interiors`; `there` (n, k) which views there are,
    two a target at least; `centre_mm` (n, 3) in the datum frame; `radius_mm` (n,); `moments_px2` (n, k, 2, 2), NaN
    where nobody states a shape: a target without any is taken to face its cameras.
    """
    n, k = there.shape
    by_point = by_camera(_by_camera_point, interiors, camera, poses, np.repeat(centre_mm, k, axis=0))
    J = (by_point @ poses.R).reshape(n, k, 2, 3)
    told = there & np.isfinite(moments_px2).all(axis=(2, 3))
    J = np.where(told[..., None, None], J, 0)
    shape = np.where(told[..., None, None], 4 * moments_px2 / radius_mm[:, None, None, None] ** 2, 0)
    missing = J @ np.swapaxes(J, -1, -2) - shape
    rows, right = [], []
    for a, b in ((0, 0), (0, 1), (1, 1)):
        entries = [J[..., a, i] * J[..., b, j] + (i != j) * J[..., a, j] * J[..., b, i] for i, j in PAIRS]
        rows.append(np.stack(entries, axis=-1))
        right.append(missing[..., a, b])
    equations = np.concatenate(rows, axis=1)
    # The trace of n n^T is one; weighted like all other equations together.
    weight = np.abs(equations).max(axis=(1, 2))
    trace = weight[:, None] * np.array([1.0, 0, 0, 1, 0, 1])
    equations = np.concatenate([equations, trace[:, None, :]], axis=1)
    solution = np.linalg.pinv(equations) @ np.concatenate([*right, weight[:, None]], axis=1)[..., None]
    outer = np.zeros((n, 3, 3))
    for entry, (i, j) in enumerate(PAIRS):
        outer[:, i, j] = outer[:, j, i] = solution[:, entry, 0]
    normal = np.linalg.eigh(outer)[1][:, :, -1]
    toward = poses.origin_mm.reshape(n, k, 3) - centre_mm[:, None, :]
    towards_all = (toward * there[..., None]).sum(axis=1)
    normal = np.where(told.any(axis=1)[:, None], normal, towards_all / np.linalg.norm(towards_all, axis=1)[:, None])
    facing = (np.einsum("nki,ni->nk", toward, normal) * there).sum(axis=1)
    return normal * np.where(facing > 0, 1.0, -1.0)[:, None]


def _by_camera_point(interior: Interior, poses: Poses, xyz_mm: np.ndarray) -> np.ndarray:
    return project_with_jacobian(interior, poses, xyz_mm)[1].camera_point
