"""Ellipses fitted to edge points by their distance, many at once."""

import numpy as np

ROUNDS = 8
FAR_PX = 1.5
OUTLIER = 3.5


def fit_ellipses(
    x: np.ndarray, y: np.ndarray, precision: np.ndarray, centre: np.ndarray, moments: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centres (n, 2), their covariances (n, 2, 2), moments (n, 2, 2) and number of points used (n,).

    `x`, `y` (n, k) points; `precision` (n, k) the inverse variance of a point across the edge, 0 for none; `centre`
    (n, 2) and `moments` (n, 2, 2) to start from. The distance of a point from an ellipse is taken to first order.
    Points far from the others' ellipse are left out.
    """
    shape = np.linalg.inv(4 * moments)
    theta = np.column_stack([centre, shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]])
    there, used = precision > 0, precision > 0
    covariance = np.full((len(x), 5, 5), np.nan)
    for k in range(ROUNDS):
        dx, dy = x - theta[:, :1], y - theta[:, 1:2]
        xx, xy, yy = (theta[:, j, None] for j in (2, 3, 4))
        gx, gy = xx * dx + xy * dy, xy * dx + yy * dy
        q = np.sqrt(np.maximum(dx * gx + dy * gy, 1e-12))
        steep = np.maximum(np.hypot(gx, gy) / q, 1e-9)
        distance = (1 - q) / steep
        if k >= 2:
            # Half of the points there are lie within the median; those that are not sort behind all others.
            ranked = np.sort(np.where(there, np.abs(distance), np.inf), axis=1)
            median = np.take_along_axis(ranked, there.sum(axis=1)[:, None] // 2, axis=1)
            used = there & (np.abs(distance) < np.maximum(OUTLIER * 1.4826 * median, 0.02))
        else:
            used = there & (np.abs(distance) < FAR_PX)
        # By the parameters: how far the edge moves towards the point.
        design = np.stack([-gx / q, -gy / q, dx * dx / (2 * q), dx * dy / q, dy * dy / (2 * q)], -1) / steep[..., None]
        weighted = design * (precision * used)[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ design
        scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
        inverse = np.linalg.pinv(np.nan_to_num(normal * scale[:, :, None] * scale[:, None, :]), 1e-12, hermitian=True)
        covariance = inverse * scale[:, :, None] * scale[:, None, :]
        step = np.einsum("nij,nkj,nk->ni", covariance, weighted, distance)
        limit = np.minimum(1, 1.0 / np.maximum(np.abs(step[:, :2]).max(axis=1), 1e-12))
        theta = theta + limit[:, None] * step
    matrix = theta[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    good = np.isfinite(theta).all(axis=1) & (matrix[:, 0, 0] > 0)
    good &= np.linalg.det(np.where(good[:, None, None], matrix, 0)) > 0
    fitted = np.linalg.inv(np.where(good[:, None, None], matrix, np.eye(2))) / 4
    return theta[:, :2], covariance[:, :2, :2], fitted, np.where(good, used.sum(axis=1), 0)
