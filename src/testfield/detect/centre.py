"""What every centroid estimator takes and gives, and the windows that they all cut."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

WINDOW, RING_BEGINS, RING_CLEARANCE_PX = 1.6, 2.0, 1.8
"""Pixels up to WINDOW half-axes from the centre are used, but none whose distance from a possible ring is so small
that the ring's blurred edge would reach it."""

MOST_PIXELS = 400_000
"""Pixels of windows in one batch, whatever their size."""


@dataclass(frozen=True)
class Centres:
    """Measured dots, n rows.

    `xy_px` (n, 2), `cov_px2` (n, 2, 2), `moments_px2` (n, 2, 2) of the dot's area, `contrast_dn`, `background_dn`
    (n,) the dot's and the surroundings' level, `chi2` (n,) misfit per degree of freedom, `misfit` (n,) rms residual
    beyond noise as a fraction of the contrast, `ok` (n,) whether it was measured.
    """

    xy_px: np.ndarray
    cov_px2: np.ndarray
    moments_px2: np.ndarray
    contrast_dn: np.ndarray
    background_dn: np.ndarray
    chi2: np.ndarray
    misfit: np.ndarray
    ok: np.ndarray

    @staticmethod
    def empty(n: int) -> "Centres":
        """n dots, none measured yet."""
        nan = np.full(n, np.nan)
        return Centres(
            np.full((n, 2), np.nan),
            np.full((n, 2, 2), np.nan),
            np.full((n, 2, 2), np.nan),
            nan,
            nan.copy(),
            nan.copy(),
            nan.copy(),
            np.zeros(n, bool),
        )

    def put(self, rows: np.ndarray, part: "Centres") -> None:
        """Write a part's rows."""
        for name, values in vars(part).items():
            getattr(self, name)[rows] = values

    def completed(self, rough: "Centres") -> "Centres":
        """The same with the rough moments, contrast and background of every measured dot of which there are none: a
        dot's size, contrast and ring are read with these."""
        known = {}
        for name in ("moments_px2", "contrast_dn", "background_dn"):
            own = np.asarray(getattr(self, name))
            absent = self.ok & ~np.isfinite(own).all(axis=tuple(range(1, own.ndim)))
            known[name] = np.where(absent.reshape(-1, *[1] * (own.ndim - 1)), getattr(rough, name), own)
        return replace(self, **known)


def half_widths(moments_px2: np.ndarray) -> np.ndarray:
    """(n,) half-widths in px of square windows that hold `WINDOW` half-axes, in steps that make few groups."""
    largest = 2 * np.sqrt(np.linalg.eigvalsh(moments_px2)[:, 1])
    need = np.ceil(WINDOW * largest + 1.5)
    step = np.maximum(2, 2.0 ** np.floor(np.log2(need) - 3))
    return (np.ceil(need / step) * step).astype(int)


def usable(q: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    """Which pixels a fit may use: `q` is the distance from the centre in half-axes, `dx`, `dy` the offset in px."""
    px_per_q = np.hypot(dx, dy) / np.maximum(q, 1e-9)
    return (q <= WINDOW) & (((RING_BEGINS - q) * px_per_q >= RING_CLEARANCE_PX) | (q <= 1.1))


def windows(
    image: np.ndarray, xy_px: np.ndarray, half: np.ndarray, most: int = 256
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Windows of equal size in batches: rows, pixel values (m, k), their x and y (m, k), and which of them exist.

    A window may reach over the image's edge; a target near it is measured from the pixels there are.
    """
    for part, size in batches(half, most):
        middle = np.rint(xy_px[part]).astype(np.int32)
        values, inside = cut_out(image, middle, size)
        offset = np.arange(-size, size + 1, dtype=np.int32)
        dy, dx = (g.ravel() for g in np.meshgrid(offset, offset, indexing="ij"))
        yield part, values.astype(np.float64), middle[:, :1] + dx, middle[:, 1:] + dy, inside


def batches(half: np.ndarray, most: int) -> Iterator[tuple[np.ndarray, int]]:
    """At most `most` rows whose windows have the same half-width, and that half-width."""
    for size in np.unique(half):
        rows = np.flatnonzero(half == size)
        batch = max(1, min(most, MOST_PIXELS // (2 * size + 1) ** 2))
        for start in range(0, len(rows), batch):
            yield rows[start : start + batch], int(size)


def cut_out(image: np.ndarray, middle: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (m, k) of square windows of half-width `size` about pixels (m, 2), and which of them exist."""
    height, width = image.shape
    side = 2 * size + 1
    if np.all((middle >= size) & (middle < [width - size, height - size])):
        view = np.lib.stride_tricks.sliding_window_view(image, (side, side))
        values = view[middle[:, 1] - size, middle[:, 0] - size].reshape(-1, side * side)
        return values, np.ones(values.shape, bool)
    offset = np.arange(-size, size + 1, dtype=np.int32)
    dy, dx = (g.ravel() for g in np.meshgrid(offset, offset, indexing="ij"))
    x, y = middle[:, :1] + dx, middle[:, 1:] + dy
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return image[y.clip(0, height - 1), x.clip(0, width - 1)], inside
