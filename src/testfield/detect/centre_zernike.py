"""Ellipse fitted to sub-pixel edges by Zernike moments (Ghosal and Mehrotra 1993).

In a disc of 7 x 7 pixels about a pixel the moments of order (1,1) and (2,0) tell an ideal step's direction and its
distance from the middle.
"""

from functools import lru_cache

import numpy as np
from scipy.ndimage import correlate

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.ellipse_fit import fit_ellipses
from testfield.detect.patches import patches, smallest_diameter
from testfield.registry import register

SIDE = 7
FINE = 64
SAMPLING_PX = 0.027
"""What the pixels' grid and the edge's bend and blur, of which the moments know nothing, do to a point's place."""
LEAST_DIAMETER_PX, LEAST_POINTS, LEAST_STEP = 8.0, 12, 0.4


@lru_cache
def masks() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(7, 7) weights of the real and the imaginary part of A11 and of A20, integrated over each pixel."""
    at = (np.arange(SIDE * FINE) + 0.5) / (SIDE * FINE) * 2 - 1
    x, y = np.meshgrid(at, at)
    inside = (x * x + y * y <= 1) * (2 / (SIDE * FINE)) ** 2

    def integrated(kernel: np.ndarray) -> np.ndarray:
        return (kernel * inside).reshape(SIDE, FINE, SIDE, FINE).sum(axis=(1, 3))

    round_mask = integrated(2 * (x * x + y * y) - 1)
    # The pixels' rim makes its sum differ from zero by a little; an even image must give nothing.
    return integrated(x), integrated(y), round_mask - integrated(np.ones_like(x)) * round_mask.sum() / np.pi


@register("centroids", "edge_zernike")
def edge_zernike(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Ellipse fitted to sub-pixel edges, found by Zernike moments.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        real, imaginary, second = (correlate(p.square(p.values), m[None], mode="nearest") for m in masks())
        strength = np.maximum(np.hypot(real, imaginary), 1e-12)
        distance = second / strength  # from the pixel to the edge, in radii of the mask, along (real, imaginary)
        flat = np.maximum(1 - distance**2, 1e-3)
        step = 1.5 * strength / flat**1.5
        across_x, across_y = real / strength, imaginary / strength
        px = distance * SIDE / 2
        # Of all pixels near an edge the one counts in whose square the edge's foot lies.
        nearest = (np.abs(px * across_x) <= 0.5) & (np.abs(px * across_y) <= 0.5) & p.square(p.use)
        nearest &= step > LEAST_STEP * p.contrast[:, None, None]
        # Neighbours share most of their pixels: together they are as good as rows of the mask summed along the edge.
        along = (masks()[2].sum(axis=0) ** 2).sum()
        variance = p.square(p.noise) * along * (SIDE / 2) ** 2 / strength**2
        # Along a slanting edge there is more than one such pixel a px.
        share = np.maximum(np.abs(across_x), np.abs(across_y))
        precision = np.where(nearest, share / (variance + SAMPLING_PX**2), 0).reshape(p.values.shape)
        x = p.x + (px * across_x).reshape(p.values.shape)
        y = p.y + (px * across_y).reshape(p.values.shape)
        xy, covariance, moments, count = fit_ellipses(x, y, precision, xy_px[p.rows] - p.origin, moments_px2[p.rows])
        ok = p.whole & (smallest_diameter(moments_px2[p.rows]) > LEAST_DIAMETER_PX)
        ok &= (count >= LEAST_POINTS) & (p.contrast_over_noise > 10)
        found.put(p.rows, p.centres(xy, covariance, moments, ok))
    return found
