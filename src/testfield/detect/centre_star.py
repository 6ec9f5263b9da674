"""Star operator (Foerstner and Guelch 1987): the point where the lines along all gradients come closest to meeting."""

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.patches import (
    back_to_pixels,
    central_differences,
    covariance_of,
    moments_above,
    patches,
    smallest_diameter,
)
from testfield.registry import register

LEAST_DIAMETER_PX = 4.0


@register("centroids", "star")
def star(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Star operator: where the lines along all gradients come closest to meeting.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        gx, gy = (g.reshape(p.values.shape) * p.use for g in central_differences(p.square(p.values)))
        # A gradient's line misses the centre c by e = gx (y - cy) - gy (x - cx), in units of the gradient.
        xx, xy, yy = (gy * gy).sum(1), -(gx * gy).sum(1), (gx * gx).sum(1)
        determinant = np.maximum(xx * yy - xy * xy, 1e-30)
        right_x, right_y = (gy * (gy * p.x - gx * p.y)).sum(1), (gx * (gx * p.y - gy * p.x)).sum(1)
        cx = (yy * right_x - xy * right_y) / determinant
        cy = (xx * right_y - xy * right_x) / determinant
        dx, dy = p.x - cx[:, None], p.y - cy[:, None]
        e = gx * dy - gy * dx
        # Sum of (gy, -gx) e is zero at the centre; its change with each gradient, through the normal matrix' inverse.
        by_gx, by_gy = (gy * dy, -gx * dy - e), (-gy * dx + e, gx * dx)
        inverse = [[yy / determinant, -xy / determinant], [-xy / determinant, xx / determinant]]
        influence = []
        for row in inverse:
            along_x, along_y = (
                -sum(r[:, None] * part for r, part in zip(row, by, strict=True)) for by in (by_gx, by_gy)
            )
            pixel = back_to_pixels(p.square(along_x * p.use), p.square(along_y * p.use))
            influence.append(pixel.reshape(p.values.shape))
        covariance = covariance_of(influence[0], influence[1], p.noise)
        bright = (p.use & (p.values > (p.black + p.contrast / 2)[:, None])).astype(float)
        ok = p.whole & (smallest_diameter(moments_px2[p.rows]) > LEAST_DIAMETER_PX) & (p.contrast_over_noise > 10)
        found.put(
            p.rows, p.centres(np.column_stack([cx, cy]), covariance, moments_above(p.values, p.x, p.y, bright), ok)
        )
    return found
