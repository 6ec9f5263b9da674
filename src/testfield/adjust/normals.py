"""Which way a lone target faces, from the shapes of its images.

To first order a disc of radius r with unit normal n has the image moments M = r^2/4 J (I - n n^T) J^T, with J the
derivative of the pixel by the point. So each view gives three equations that are linear in the entries of n n^T.
"""

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project_with_jacobian

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def target_normal(
    interior: Interior, poses: Poses, centre_mm: np.ndarray, radius_mm: float, moments_px2: np.ndarray
) -> np.ndarray:
    """Unit normal (3,) of a target, towards its cameras.

    `poses` (k) camera-from-datum of the views, k >= 2; `centre_mm` (3,) in the datum frame; `moments_px2` (k, 2, 2).
    """
    k = len(poses)
    _, jacobian = project_with_jacobian(interior, poses, np.broadcast_to(centre_mm, (k, 3)))
    J = jacobian.camera_point @ poses.R
    missing = J @ np.swapaxes(J, 1, 2) - 4 * moments_px2 / radius_mm**2
    rows, right = [], []
    for a, b in ((0, 0), (0, 1), (1, 1)):
        rows.append(np.stack([J[:, a, i] * J[:, b, j] + (i != j) * J[:, a, j] * J[:, b, i] for i, j in PAIRS], axis=1))
        right.append(missing[:, a, b])
    # The trace of n n^T is one; weighted like all other equations together.
    trace = np.array([[1.0, 0, 0, 1, 0, 1]]) * np.abs(np.concatenate(rows)).max()
    solution, *_ = np.linalg.lstsq(np.vstack([*rows, trace]), np.concatenate([*right, [trace.max()]]), rcond=None)
    outer = np.zeros((3, 3))
    for (i, j), value in zip(PAIRS, solution, strict=True):
        outer[i, j] = outer[j, i] = value
    normal = np.linalg.eigh(outer)[1][:, -1]
    return normal if ((poses.origin_mm - centre_mm) @ normal).sum() > 0 else -normal
