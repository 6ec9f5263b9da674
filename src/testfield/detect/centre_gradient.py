"""Ellipse fitted to sub-pixel edges: where the gradient is steepest, by a parabola through three pixels."""

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.ellipse_fit import fit_ellipses
from testfield.detect.patches import central_differences, patches, smallest_diameter
from testfield.registry import register

LEAST_DIAMETER_PX, LEAST_POINTS = 6.0, 12
STEEP = 0.1
"""A pixel may lie on an edge where its gradient exceeds this part of the contrast a px."""

SAMPLING_PX = 0.026
"""What the pixels' grid does to a point's place at a blur of about half a pixel, beside noise."""


@register("centroids", "edge_gradient")
def edge_gradient(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Ellipse fitted to sub-pixel edges, found where the gradient is steepest.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        smooth = p.square(p.values)
        gx, gy = central_differences(smooth)
        across = gx.copy(), gy.copy()  # each smoothed along the edge, as Sobel does
        across[0][:, 1:-1] = (gx[:, :-2] + 2 * gx[:, 1:-1] + gx[:, 2:]) / 4
        across[1][:, :, 1:-1] = (gy[:, :, :-2] + 2 * gy[:, :, 1:-1] + gy[:, :, 2:]) / 4
        points_x, points_y, precision = [], [], []
        for g, axis in ((across[0], 2), (across[1], 1)):
            size = np.abs(g)
            before, after = np.roll(size, 1, axis), np.roll(size, -1, axis)
            bend = before - 2 * size + after
            steepest = (size >= before) & (size > after) & (bend < 0) & (size > STEEP * p.contrast[:, None, None])
            steepest &= (size >= np.abs(across[1] if axis == 2 else across[0])) & p.square(p.use)
            offset = np.where(steepest, (before - after) / np.where(bend == 0, 1, 2 * bend), 0).clip(-0.5, 0.5)
            shift = offset.reshape(p.values.shape)
            points_x.append(p.x + (shift if axis == 2 else 0))
            points_y.append(p.y + (shift if axis == 1 else 0))
            # Noise of the parabola's top, with the smoothing undone: it makes neighbours alike, not better together.
            variance = 1.5 * p.square(p.noise) / np.where(steepest, 2 * bend, 1) ** 2
            # The offset runs along a pixel axis, the fit's distance across the edge.
            slant = size / np.maximum(np.hypot(*across), 1e-12)
            doubt = variance * slant**2 + SAMPLING_PX**2
            precision.append(np.where(steepest, 1 / doubt, 0).reshape(p.values.shape))
        start = xy_px[p.rows] - p.origin
        xy, covariance, moments, count = fit_ellipses(
            np.hstack(points_x), np.hstack(points_y), np.hstack(precision), start, moments_px2[p.rows]
        )
        ok = p.whole & (smallest_diameter(moments_px2[p.rows]) > LEAST_DIAMETER_PX)
        ok &= (count >= LEAST_POINTS) & (p.contrast_over_noise > 10)
        found.put(p.rows, p.centres(xy, covariance, moments, ok))
    return found
