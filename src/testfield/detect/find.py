"""Find blobs that may be dots: brighter than their surroundings, of a dot's size and an ellipse's shape."""

import cv2
import numpy as np

from testfield.camera.images import SensorSheet

NOISE_FACTOR = 6.0
STRIP = 32
FLATTEST = 0.2
"""Smallest ratio of an ellipse's axes: a circle seen at 78 degrees."""


def find_blobs(
    image_dn: np.ndarray, sheet: SensorSheet, smallest_px: float, largest_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) and second moments (n, 2, 2) of blobs that are about elliptic.

    `image_dn` (h, w) float32 with bright marks. A pixel belongs to a blob where it exceeds the mean of its
    neighbourhood by more than noise explains, which neither uneven light nor a bright background changes.
    """
    window = int(largest_px) | 1
    mean = cv2.blur(image_dn, (window, window), borderType=cv2.BORDER_REFLECT)
    bright = np.empty(image_dn.shape, np.uint8)
    for top in range(0, len(image_dn), STRIP):  # strips fit into the processor's cache: twice as fast
        part = slice(top, top + STRIP)
        limit = NOISE_FACTOR**2 * sheet.variance_dn2(mean[part])
        excess = np.maximum(image_dn[part] - mean[part], 0)
        np.greater(excess * excess, limit, out=bright[part], casting="unsafe")
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright, connectivity=4)
    x0, y0, width, height, area = stats.T
    h, w = image_dn.shape
    small = 0.5 * np.pi / 4 * smallest_px**2
    keep = (area >= max(small * FLATTEST, 6)) & (np.maximum(width, height) <= 1.3 * largest_px)
    keep &= (
        (np.maximum(width, height) >= 0.7 * smallest_px) & (x0 > 0) & (y0 > 0) & (x0 + width < w) & (y0 + height < h)
    )
    keep[0] = False

    # Moments of all kept blobs in one sweep over their pixels.
    rows, columns = np.nonzero(keep[labels])
    number = np.cumsum(keep) - 1
    blob = number[labels[rows, columns]]
    n = int(keep.sum())
    if n == 0:
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    size = np.bincount(blob, minlength=n)
    cx, cy = (np.bincount(blob, weights=v, minlength=n) / size for v in (columns, rows))
    dx, dy = columns - cx[blob], rows - cy[blob]
    xx, xy, yy = (np.bincount(blob, weights=v, minlength=n) / size for v in (dx * dx, dx * dy, dy * dy))
    xx, yy = xx + 1 / 12, yy + 1 / 12  # a pixel is a square, not a point
    determinant = xx * yy - xy * xy
    # A filled ellipse has area 4 pi sqrt(det of moments); anything with holes, arms or corners has less.
    fullness = size / (4 * np.pi * np.sqrt(determinant))
    spread = np.sqrt((xx - yy) ** 2 + 4 * xy * xy)
    ratio = np.sqrt((xx + yy - spread) / (xx + yy + spread))
    elliptic = (fullness > 0.86) & (ratio > FLATTEST)
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    return np.column_stack([cx, cy])[elliptic], moments[elliptic]
