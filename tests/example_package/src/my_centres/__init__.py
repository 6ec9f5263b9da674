"""Centres of bright dots in an image, by the weighted mean of their pixels."""

import numpy as np
from scipy import ndimage


def find_dots(image: np.ndarray, smallest_px: int = 20) -> np.ndarray:
    """(n, 2) centres x, y in px of bright regions of an image (h, w), the first pixel's centre at (0, 0)."""
    image = np.asarray(image, float)
    ground = ndimage.minimum_filter(ndimage.gaussian_filter(image, 1.0), 25)
    level = image - ndimage.maximum_filter(ground, 25)
    regions, n = ndimage.label(level > 0.4 * np.percentile(level, 99.5))
    sizes = ndimage.sum_labels(np.ones_like(level), regions, np.arange(1, n + 1))
    kept = np.flatnonzero(sizes >= smallest_px) + 1
    weight = np.clip(level, 0, None)
    return np.array([centre[::-1] for centre in ndimage.center_of_mass(weight, regions, kept)]).reshape(-1, 2)
