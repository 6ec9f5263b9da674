"""Flatness of points on a plane, by analogy to VDI/VDE 2634 parts 2 and 3."""

import numpy as np

from testfield.score.align import rigid_fit

ROW = 0.01
"""Points that spread across their row by less than this part of their spread along it span no plane."""


def plane_residuals(points_mm: np.ndarray) -> np.ndarray:
    """(n,) signed distances of points (n, 3), four or more, from the plane that fits them best."""
    centred = points_mm - points_mm.mean(axis=0)
    return centred @ _axes(centred)[2]


def flatness(points_mm: np.ndarray) -> float:
    """Range of the distances of points (n, 3) from the plane that fits them best, in mm."""
    return float(np.ptp(plane_residuals(points_mm)))


def form_error(measured_mm: np.ndarray, true_mm: np.ndarray) -> float:
    """By how much the measured form differs from the true one: range in mm of measured less true heights of points
    (n, 3), after a fit of six parameters and less the plane that fits these differences best.

    The heights are taken along the normal of the true points' plane. Two ranges would not do: a bow that is measured
    the wrong way round has the right range.
    """
    R, t = rigid_fit(measured_mm, true_mm)
    centred = true_mm - true_mm.mean(axis=0)
    along, across, normal = _axes(centred)
    off = (measured_mm @ R.T + t - true_mm) @ normal
    plane = np.column_stack([np.ones(len(off)), centred @ along, centred @ across])
    return float(np.ptp(off - plane @ np.linalg.lstsq(plane, off)[0]))


def in_a_row(points_mm: np.ndarray) -> bool:
    """Whether points (n, 3), two or more, lie in a straight row."""
    size = np.linalg.svd(points_mm - points_mm.mean(axis=0), compute_uv=False)
    return bool(size[1] <= ROW * size[0])


def _axes(centred_mm: np.ndarray) -> np.ndarray:
    """(3, 3) directions of largest, middle and smallest spread of points about their middle."""
    return np.linalg.svd(centred_mm, full_matrices=False)[2]
