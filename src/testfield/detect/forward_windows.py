"""Windows of pixels around dots, in batches of like size."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

CX, CY, AXX, AXY, AYY, BLUR, CONTRAST, BACKGROUND, CONTRAST_X, CONTRAST_Y, BACKGROUND_X, BACKGROUND_Y = range(12)
GRADIENTS = slice(CONTRAST_X, BACKGROUND_Y + 1)
CLEAR_OF_BLUR = 4.0
"""An edge is felt up to this many standard deviations of pixel and blur beyond it."""
BATCH, MOST_PIXELS = 128, 240_000
"""Dots that are fitted together, and the most pixels of all their windows: each has tens of derivatives."""


@dataclass
class Batch:
    """Some dots with windows of one size: `rows` (n,) which, `corner` (n, 2) px of the first pixel, `values`,
    `inside` (n, m, m), `theta` (n, 12) with the centre relative to the window's middle."""

    rows: np.ndarray
    corner: np.ndarray
    values: np.ndarray
    inside: np.ndarray
    theta: np.ndarray

    def some(self, rows: np.ndarray) -> "Batch":
        """Those of some of the dots, with parameters of their own."""
        return Batch(self.rows[rows], self.corner[rows], self.values[rows], self.inside[rows], self.theta[rows])

    @property
    def half(self) -> int:
        """Pixels on each side of the windows' middle ones."""
        return self.values.shape[1] // 2

    @property
    def middle(self) -> np.ndarray:
        """(n, 2) px of the windows' middle pixels."""
        return self.corner + self.half


def root(matrix: np.ndarray) -> np.ndarray:
    """Symmetric square roots (n, 2, 2) of positive matrices."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.sqrt(np.maximum(values, 0.04))[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def half_axes(theta: np.ndarray) -> np.ndarray:
    """(n, 2, 2) matrices that map the unit circle onto the outline."""
    return theta[:, [AXX, AXY, AXY, AYY]].reshape(-1, 2, 2)


def reach(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) largest half axis, and how far beyond an edge it is felt, in px."""
    return np.abs(np.linalg.eigvalsh(half_axes(theta))).max(axis=1), CLEAR_OF_BLUR * np.hypot(theta[:, BLUR], 0.29)


def window_batches(image: np.ndarray, theta: np.ndarray, radii: float = 1.0) -> Iterator[Batch]:
    """Dots in groups whose windows have one size and whose outlines need about the same number of points.

    Windows reach as far as an edge is felt that lies `radii` half axes from the centre."""
    largest, felt = reach(theta)
    half = np.ceil(radii * largest + felt + 1.5).astype(int)
    half = np.where(half > 16, -(-half // 2) * 2, half)
    points = np.ceil(2 * np.log2(largest / theta[:, BLUR] + 1))
    height, width = image.shape
    for size, count in np.unique(np.column_stack([half, points]), axis=0).astype(int):
        members = np.flatnonzero((half == size) & (points == count))
        offset = np.arange(-size, size + 1)
        batch = max(1, min(BATCH, MOST_PIXELS // (2 * size + 1) ** 2))
        for first in range(0, len(members), batch):
            rows = members[first : first + batch]
            middle = np.rint(theta[rows, :2]).astype(int)
            x, y = middle[:, :1] + offset, middle[:, 1:] + offset
            within = ((y >= 0) & (y < height))[:, :, None] & ((x >= 0) & (x < width))[:, None, :]
            values = image[y.clip(0, height - 1)[:, :, None], x.clip(0, width - 1)[:, None, :]].astype(np.float64)
            local = theta[rows].copy()
            local[:, :2] -= middle
            yield Batch(rows, middle - size, values, within, local)
