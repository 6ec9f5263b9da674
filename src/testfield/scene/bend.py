"""Bent panels: a flat sheet bent without stretching onto a circular cylinder.

Paper coordinates (x, y) are those of the flat sheet. Along the bending axis nothing changes; across it a length of
paper becomes the same length of arc. The sheet's middle stays where it is, with its normal. `curvature_per_mm` is
positive where the middle stands out towards the viewer; `axis_rad` is the bending axis' direction in the sheet,
counter-clockwise from x. All functions take both row by row, give exactly the flat sheet for curvature 0, and work in
the panel's frame.
"""

import numpy as np
from scipy.optimize import brentq


def extent_mm(size_mm: tuple[float, float], axis_rad: float) -> float:
    """Length of the sheet across the bending axis."""
    return float(abs(np.sin(axis_rad)) * size_mm[0] + abs(np.cos(axis_rad)) * size_mm[1])


def curvature_of(bow_mm: float, extent_mm: float) -> float:
    """Curvature in 1/mm of a sheet of a given extent whose middle stands `bow_mm` out from its edges.

    Raises `ValueError` where the sheet would be bent by more than a half circle.
    """
    if bow_mm == 0:
        return 0.0
    most = extent_mm / np.pi
    if abs(bow_mm) > most:
        raise ValueError(f"a sheet of {extent_mm:.0f} mm bent to a half circle has a bow of {most:.1f} mm")
    bow = abs(bow_mm) / (extent_mm / 2)
    # bow = (1 - cos a) / a with a half the angle that the sheet covers.
    half_angle = brentq(lambda a: 2 * np.sin(a / 2) ** 2 / a - bow, 1e-12, np.pi / 2 + 1e-9, xtol=1e-15, rtol=1e-14)
    return float(np.copysign(2 * half_angle / extent_mm, bow_mm))


def to_space(xy_mm: np.ndarray, curvature_per_mm: np.ndarray, axis_rad: np.ndarray) -> np.ndarray:
    """(n, 3) places of paper coordinates (n, 2)."""
    across, s = _across(xy_mm, axis_rad)
    half = curvature_per_mm * s / 2
    aside = s * (np.sinc(2 * half / np.pi) - 1)
    back = -s * np.sin(half) * np.sinc(half / np.pi)
    return np.column_stack([xy_mm + aside[:, None] * across, back])


def frames(xy_mm: np.ndarray, curvature_per_mm: np.ndarray, axis_rad: np.ndarray) -> np.ndarray:
    """(n, 3, 3) orthonormal frames of the surface: columns along paper x, along paper y, and the normal."""
    across, s = _across(xy_mm, axis_rad)
    sine, cosine = np.sin(curvature_per_mm * s), np.cos(curvature_per_mm * s)
    # The direction across the axis turns by (cos - 1) along itself and -sin along z.
    turn = np.column_stack([(cosine - 1)[:, None] * across, -sine])
    columns = np.broadcast_to(np.eye(3), (len(s), 3, 3)).copy()
    columns[:, :, :2] += turn[:, :, None] * across[:, None, :]
    columns[:, :, 2] = np.column_stack([sine[:, None] * across, cosine])
    return columns


def to_paper(xyz_mm: np.ndarray, curvature_per_mm: np.ndarray, axis_rad: np.ndarray) -> np.ndarray:
    """(n, 3) paper x, paper y and height above the surface of points (n, 3)."""
    across, q = _across(xyz_mm[:, :2], axis_rad)
    upright = 1 + curvature_per_mm * xyz_mm[:, 2]
    flat = curvature_per_mm == 0
    k = np.where(flat, 1.0, curvature_per_mm)
    s = np.where(flat, q, np.arctan2(k * q, upright) / k)
    height = np.where(flat, xyz_mm[:, 2], (np.hypot(k * q, upright) - 1) / k)
    return np.column_stack([xyz_mm[:, :2] + (s - q)[:, None] * across, height])


def crossings(start_mm: np.ndarray, slope: np.ndarray, curvature_per_mm: float, axis_rad: float) -> np.ndarray:
    """(n, 2) values t at which rays `start_mm + t * slope`, both (n, 3), meet the whole cylinder; NaN where they miss.

    The cylinder is curvature (q^2 + z^2) + 2 z = 0, with q across the axis: a quadratic in t.
    """
    across = np.array([-np.sin(axis_rad), np.cos(axis_rad)])
    q, dq, z, dz = start_mm[:, :2] @ across, slope[:, :2] @ across, start_mm[:, 2], slope[:, 2]
    a = curvature_per_mm * (dq**2 + dz**2)
    b = curvature_per_mm * (q * dq + z * dz) + dz
    c = curvature_per_mm * (q**2 + z**2) + 2 * z
    with np.errstate(invalid="ignore", divide="ignore"):
        # The form that loses no digits: one root by the sum of equal signs, the other by the product of the roots.
        both = -(b + np.copysign(np.sqrt(b**2 - a * c), b))
        return np.column_stack([c / both, both / a])


def _across(xy_mm: np.ndarray, axis_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 2) across the bending axes, and how far along them (n,) points (n, 2) lie."""
    across = np.column_stack([-np.sin(axis_rad), np.cos(axis_rad)])
    return across, (xy_mm * across).sum(axis=1)
