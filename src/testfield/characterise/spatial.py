"""Nonuniformity of a stack of frames: the parts of columns, rows and pixels (EMVA 1288 release 4.0, section 8)."""

from dataclasses import dataclass

import cv2
import numpy as np

PARTS = ("total", "column", "row", "pixel")
SMOOTH_PX = 31
"""Window of the running mean that is taken for uneven light; much wider than any pixel's pattern."""


@dataclass(frozen=True)
class Spatial:
    """Spatial variances in DN squared of `PARTS`, each with its standard uncertainty; the mean in DN."""

    mean_dn: float
    s2_dn2: np.ndarray
    u_s2_dn2: np.ndarray


def spatial_of(mean_dn: np.ndarray, temporal_dn2: float, frames: int) -> Spatial:
    """Variances from the mean of `frames` frames, (M, N), whose temporal variance is `temporal_dn2`.

    EMVA 1288 release 4.0: the variances of the means of columns and rows are freed of what temporal noise leaves in
    them, and the three parts solved for. The uncertainty is that of a variance over so many independent values.
    """
    M, N = mean_dn.shape
    mean = float(mean_dn.mean())
    left = temporal_dn2 / frames
    measured = float(mean_dn.var(ddof=1))
    of_columns, of_rows = float(mean_dn.mean(axis=0).var()), float(mean_dn.mean(axis=1).var())
    s2, cav, rav = measured - left, of_columns - left / M, of_rows - left / N
    free = M * N - M - N
    column = (M * N - M) / free * cav - N / free * (s2 - rav)
    row = (M * N - N) / free * rav - M / free * (s2 - cav)
    pixel = M * N / free * (s2 - cav - rav)
    u_pixel = np.sqrt(2 / (M * N)) * max(pixel + left, 0)
    u_column = np.sqrt(2 / max(N - 1, 1)) * max(of_columns, 0)
    u_row = np.sqrt(2 / max(M - 1, 1)) * max(of_rows, 0)
    u_total = np.sqrt(u_pixel**2 + u_column**2 + u_row**2)
    return Spatial(mean, np.array([s2, column, row, pixel]), np.array([u_total, u_column, u_row, u_pixel]))


def without_uneven_light(mean_dn: np.ndarray) -> tuple[np.ndarray, float]:
    """The image (M, N) without what changes slowly over it, and the share of a white pattern's variance that is left.

    A running mean is subtracted. It also takes the part 1 / n of each pixel's own variance, n the pixels of the window.
    """
    size = min(SMOOTH_PX, min(mean_dn.shape) // 2 * 2 - 1)
    if size < 3:
        return mean_dn - mean_dn.mean(), 1.0
    smooth = cv2.blur(np.ascontiguousarray(mean_dn, np.float64), (size, size), borderType=cv2.BORDER_REFLECT)
    return mean_dn - smooth, 1 - 1 / size**2


def root(s2: float, u_s2: float) -> tuple[float, float]:
    """A standard deviation and its uncertainty from a variance; 0 of a variance below 0, for noise made it so, with an
    uncertainty that reaches as far as the variance's."""
    value = float(np.sqrt(max(s2, 0.0)))
    return value, float(u_s2 / (2 * value)) if s2 > u_s2 else float(np.sqrt(max(s2, 0.0) + u_s2) - value)
