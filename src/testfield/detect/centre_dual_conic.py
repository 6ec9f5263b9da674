"""Dual conic from gradients (Ouellet and Hebert 2009): every pixel's gradient gives a tangent, and the ellipse is the
one that all tangents touch; no edge has to be found."""

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.patches import (
    back_to_pixels,
    central_differences,
    covariance_of,
    patches,
    smallest_diameter,
    symmetric,
)
from testfield.registry import register

LEAST_DIAMETER_PX = 4.0


@register("centroids", "dual_conic")
def dual_conic(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Dual conic from gradients: the ellipse that the tangents of all pixels touch.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        gx, gy = (g.reshape(p.values.shape) * p.use for g in central_differences(p.square(p.values)))
        size = np.maximum(p.contrast, 1e-9)[:, None]
        a, b = gx / size, gy / size
        c = -(a * p.x + b * p.y)
        # With the tangent (a, b, c): A a^2 + B ab + C b^2 + D ac + E bc + c^2 = 0; the centre is (D/2, E/2). The
        # equation is of the gradient's second order, so a strong gradient counts by its fourth power in the squares;
        # divided by the gradient's length it counts by its square, as its noise demands.
        weight = 1 / np.maximum(a * a + b * b, 1e-6)
        design = np.stack([a * a, a * b, b * b, a * c, b * c], axis=-1)
        normal = np.einsum("nki,nk,nkj->nij", design, weight, design)
        right = -np.einsum("nki,nk->ni", design, weight * c * c)
        scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-30))
        inverse = np.linalg.pinv(normal * scale[:, :, None] * scale[:, None, :], 1e-12, hermitian=True)
        inverse = inverse * scale[:, :, None] * scale[:, None, :]
        A, B, C, D, E = (inverse @ right[..., None])[..., 0].T[..., None]
        # What a change of a tangent does to its equation, and that to the centre.
        by_a, by_b, by_c = 2 * A * a + B * b + D * c, 2 * C * b + B * a + E * c, D * a + E * b + 2 * c
        lever = -(design @ inverse[:, :, 3:]) * weight[..., None] / 2
        influence = [
            back_to_pixels(
                p.square(lever[..., k] * (by_a - p.x * by_c) / size),
                p.square(lever[..., k] * (by_b - p.y * by_c) / size),
            ).reshape(p.values.shape)
            for k in (0, 1)
        ]
        cx, cy = D[:, 0] / 2, E[:, 0] / 2
        half_axes_2 = symmetric(cx * cx - A[:, 0], cx * cy - B[:, 0] / 2, cy * cy - C[:, 0])
        ok = p.whole & (smallest_diameter(moments_px2[p.rows]) > LEAST_DIAMETER_PX) & (p.contrast_over_noise > 10)
        ok &= (half_axes_2[:, 0, 0] > 0) & (np.linalg.det(half_axes_2) > 0)
        covariance = covariance_of(influence[0], influence[1], p.noise)
        found.put(p.rows, p.centres(np.column_stack([cx, cy]), covariance, half_axes_2 / 4, ok))
    return found
