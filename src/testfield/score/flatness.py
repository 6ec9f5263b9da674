"""Flatness of points on a plane, by analogy to VDI/VDE 2634 parts 2 and 3."""

import numpy as np


def plane_residuals(points_mm: np.ndarray) -> np.ndarray:
    """(n,) signed distances of points (n, 3), four or more, from the plane that fits them best."""
    centred = points_mm - points_mm.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    return centred @ normal


def flatness(points_mm: np.ndarray) -> float:
    """Range of the distances of points (n, 3) from the plane that fits them best, in mm."""
    return float(np.ptp(plane_residuals(points_mm)))
