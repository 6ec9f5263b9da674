"""Least-squares template matching (Gruen 1985): an ideal blurred disc, moved, stretched and brightened until it fits.

The template's edge has one width, the noise is taken as alike in all pixels and judged by what is left over, and the
light as even: what the forward model knows better is left out here on purpose.
"""

import numpy as np
from scipy.special import ndtr

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.patches import patches, smallest_diameter
from testfield.registry import register

EDGE_PX = 0.75
ROUNDS = 12
LEAST_DIAMETER_PX = 3.0


@register("centroids", "template")
def template(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Least-squares matching of an ideal blurred disc.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        shape = np.linalg.inv(4 * moments_px2[p.rows])
        theta = np.column_stack(
            [xy_px[p.rows] - p.origin, shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1], p.contrast, p.black]
        )
        good, converged = np.isfinite(theta).all(axis=1) & (p.contrast > 0), np.zeros(len(theta), bool)
        safe = np.array([0, 0, 0.05, 0, 0.05, 1.0, 0.0])
        # The template is drawn once, a circle as large as the dot, and its edge is stretched with it.
        radius = 2 * np.maximum(np.linalg.det(moments_px2[p.rows]), 1e-3) ** 0.25
        for _ in range(ROUNDS):
            theta[~good] = safe
            model, design = _drawn(theta, radius, p.x, p.y)
            weighted = design * p.use[..., None]
            residual = p.values - model
            normal = np.swapaxes(weighted, 1, 2) @ design
            scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
            unit = np.nan_to_num(normal * scale[:, :, None] * scale[:, None, :])
            inverse = np.linalg.pinv(unit, 1e-12, hermitian=True) * scale[:, :, None] * scale[:, None, :]
            step = np.einsum("nij,nkj,nk->ni", inverse, weighted, residual)
            limit = np.minimum(1, 0.5 / np.maximum(np.abs(step[:, :2]).max(axis=1), 1e-12))
            theta = theta + limit[:, None] * step
            good &= np.isfinite(theta).all(axis=1) & (theta[:, 2] > 0) & (theta[:, 2] * theta[:, 4] > theta[:, 3] ** 2)
            good &= np.abs(theta[:, :2]).max(axis=1) < p.side / 3
            converged = good & (np.abs(step[:, :2]).max(axis=1) < 1e-3)
        theta[~good] = safe
        freedom = np.maximum(p.use.sum(1) - theta.shape[1], 1)
        variance = (p.use * residual**2).sum(1) / freedom
        moments = np.linalg.inv(theta[:, [2, 3, 3, 4]].reshape(-1, 2, 2)) / 4
        ok = converged & (smallest_diameter(moments_px2[p.rows]) > LEAST_DIAMETER_PX) & (p.contrast_over_noise > 4)
        expected = (p.use * p.noise).sum(1) / np.maximum(p.use.sum(1), 1)
        found.put(
            p.rows,
            p.centres(theta[:, :2], variance[:, None, None] * inverse[:, :2, :2], moments, ok, variance / expected),
        )
    return found


def _drawn(theta: np.ndarray, radius: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixel values (n, k) and their derivatives (n, k, 7)."""
    cx, cy, xx, xy, yy, contrast, background = (theta[:, k, None] for k in range(7))
    dx, dy = x - cx, y - cy
    gx, gy = xx * dx + xy * dy, xy * dx + yy * dy
    q = np.sqrt(np.maximum(dx * gx + dy * gy, 1e-12))
    steep = radius[:, None] / EDGE_PX
    z = (1 - q) * steep
    inside = ndtr(z)
    by_q = -contrast * steep * np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
    parts = [-by_q * gx / q, -by_q * gy / q, by_q * dx * dx / (2 * q), by_q * dx * dy / q, by_q * dy * dy / (2 * q)]
    return background + contrast * inside, np.stack([*parts, inside, np.ones_like(inside)], axis=-1)
