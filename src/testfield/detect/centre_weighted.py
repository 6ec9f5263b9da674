"""Centroid weighted with the squared grey value: bright pixels count more, edges less."""

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.patches import covariance_of, moments_above, patches
from testfield.registry import register


@register("centroids", "weighted_centroid")
def weighted_centroid(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Centroid weighted with the squared grey value above the surroundings.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        grey = np.where(p.use & (p.values > (p.black + p.contrast / 4)[:, None]), p.values - p.black[:, None], 0)
        total = np.maximum((grey**2).sum(1), 1e-12)
        cx, cy = (grey**2 * p.x).sum(1) / total, (grey**2 * p.y).sum(1) / total
        by_pixel = 2 * grey / total[:, None]
        covariance = covariance_of(by_pixel * (p.x - cx[:, None]), by_pixel * (p.y - cy[:, None]), p.noise)
        bright = (grey > p.contrast[:, None] / 2).astype(float)
        ok = (bright.sum(1) >= 6) & (p.contrast_over_noise > 4)
        found.put(
            p.rows, p.centres(np.column_stack([cx, cy]), covariance, moments_above(p.values, p.x, p.y, bright), ok)
        )
    return found
