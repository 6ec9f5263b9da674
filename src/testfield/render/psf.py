"""The optics' blur and the pixel's area as one weighting of cells: exact, not a filter over finished pixels."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.signal import oaconvolve
from scipy.special import erf

from testfield.store.compiled import compiled

AIRY_MARGIN_PX = 32
"""Diffracted light is followed this far. What goes farther (2 airy / (pi^2 32 px), under 1 % at f/8 and 3.45 um) would
be an even veil; it is left in proportion to the rest."""
AIRY_GRID_PX = 256
MOSTLY = 0.3
"""Part of the pixels with cells of their own beyond which it takes less time to weigh every cell."""
NEAR_PX = 8
"""Up to here what a pixel sends is weighed cell by cell; beyond, its spread's slope is even across a pixel to 1e-5."""
DIFFRACTION_CELLS = 6
"""Frequencies that cells alias are weaker the smaller the cells; with 6 an edge's profile errs by 0.002 of its step."""


@dataclass(frozen=True)
class PointSpread:
    """A pixel's weights of cells.

    `cells` along each side of a pixel; `margin` pixels that the weights reach beyond it; `line` the weights of a row
    of cells where rows and columns separate, else `plane` those of the square of cells.
    """

    cells: int
    margin: int
    line: np.ndarray | None = None
    plane: np.ndarray = field(default_factory=lambda: np.ones((1, 1)))

    def blurred(self, pixels: np.ndarray, row: np.ndarray, column: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Pixels without their margin, of `pixels` (rows, columns) that lie in a margin all around.

        Pixels are alike in all their cells but for those at `row`, `column` (k,), which have `cells` (k, n^2).
        """
        n, m = self.cells, self.margin
        height, width = pixels.shape
        if len(row) > MOSTLY * pixels.size:
            fine = np.repeat(np.repeat(pixels, n, axis=0), n, axis=1)
            fine.reshape(height, n, width, n).transpose(0, 2, 1, 3)[row, column] = cells.reshape(-1, n, n)
            return self.weigh(fine, height - 2 * m, width - 2 * m)
        pixels = pixels.copy()
        pixels[row, column] = cells @ np.full(n * n, 1 / (n * n), np.float32)
        if self.line is None:
            return self._diffracted(pixels, row, column, cells)
        line = self.line.reshape(2 * m + 1, n).astype(np.float32)
        whole = line.sum(axis=1)
        image = cv2.sepFilter2D(pixels, -1, whole, whole, borderType=cv2.BORDER_CONSTANT)[m : height - m, m : width - m]
        rest = (cells - pixels[row, column][:, None]).reshape(-1, n, n)
        image = np.ascontiguousarray(image)
        _send(image, row, column, rest, line)
        return image

    def _diffracted(self, pixels: np.ndarray, row: np.ndarray, column: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """As `blurred` where rows and columns of weights do not separate.

        Near a pixel the weights of all its cells count, far from it those of the pixel and their slopes across it.
        """
        n, m = self.cells, self.margin
        weights = self.plane.reshape(2 * m + 1, n, 2 * m + 1, n).transpose(1, 3, 0, 2)
        whole = weights.sum(axis=(0, 1))
        image = _correlated(pixels, whole)
        if n == 1:
            return image
        rest = cells - pixels[row, column][:, None]
        at = (np.arange(n) + 0.5) / n - 0.5
        near = slice(m - NEAR_PX, m + NEAR_PX + 1)
        for moment, ways in ((np.repeat(at, n), "a"), (np.tile(at, n), "b")):
            slope = np.einsum(f"{ways},abyx->yx", at, weights) / (n * (at @ at))
            slope[near, near] = 0
            dipole = np.zeros_like(pixels)
            dipole[row, column] = rest @ moment.astype(np.float32)
            image += _correlated(dipole, slope)
        full = np.zeros(np.array(pixels.shape), np.float32)
        full[m : pixels.shape[0] - m, m : pixels.shape[1] - m] = image
        by_cell = weights[:, :, near, near].reshape(n * n, -1).astype(np.float32)
        _add_around(full, row, column, rest @ by_cell, NEAR_PX)
        return full[m : pixels.shape[0] - m, m : pixels.shape[1] - m]

    def weigh(self, fine: np.ndarray, rows: int, columns: int) -> np.ndarray:
        """(rows, columns) pixels from the cells of these pixels and of the margin all around them."""
        n = self.cells
        if self.line is not None:
            across = np.zeros((fine.shape[0], columns), np.float32)
            for k, weight in enumerate(self.line.astype(np.float32)):
                across += weight * fine[:, k : k + columns * n : n]
            image = np.zeros((rows, columns), np.float32)
            for k, weight in enumerate(self.line.astype(np.float32)):
                image += weight * across[k : k + rows * n : n]
            return image
        # Cells at the same place of every pixel are an image of their own.
        parts = [
            oaconvolve(fine[a::n, b::n], self.plane[a::n, b::n][::-1, ::-1].astype(np.float32), "valid")
            for a in range(n)
            for b in range(n)
        ]
        return np.sum(parts, axis=0)[:rows, :columns].astype(np.float32)


@compiled
def _send(image: np.ndarray, row: np.ndarray, column: np.ndarray, cells: np.ndarray, line: np.ndarray) -> None:
    """Add to the pixels of an image what `cells` (k, n, n) of pixels at `row`, `column` (k,) send to them, counted with
    the margin; `line` (2 margin + 1, n) weighs rows of cells as it does columns."""
    height, width = image.shape
    reach, n = line.shape
    across = np.empty((n, reach), np.float32)
    for k in range(len(row)):
        for a in range(n):
            for d in range(reach):
                total = np.float32(0)
                for b in range(n):
                    total += cells[k, a, b] * line[d, b]
                across[a, d] = total
        left, right = max(0, column[k] - width + 1), min(reach, column[k] + 1)
        for down in range(max(0, row[k] - height + 1), min(reach, row[k] + 1)):
            for d in range(left, right):
                total = np.float32(0)
                for a in range(n):
                    total += across[a, d] * line[down, a]
                image[row[k] - down, column[k] - d] += total


def _correlated(pixels: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return oaconvolve(pixels, weights[::-1, ::-1].astype(np.float32), "valid")


def _add_around(image: np.ndarray, row: np.ndarray, column: np.ndarray, shares: np.ndarray, reach: int) -> None:
    """Add `shares` (k, (2 reach + 1)^2) of what pixels at `row`, `column` (k,) send to those that have them near.

    A share's place is that of the sender as the receiver sees it.
    """
    height, width = image.shape
    wide = np.zeros((height + 2 * reach, width + 2 * reach), np.float32)
    flat, stride = wide.ravel(), wide.shape[1]
    at = (row + 2 * reach) * stride + column + 2 * reach
    for k, share in enumerate(shares.T):
        down, right = divmod(k, 2 * reach + 1)
        flat[at - down * stride - right] += share  # no two of the pixels send to the same one
    image += wide[reach : reach + height, reach : reach + width]


def point_spread(cells: int, sigma_px: float, airy_px: float, shots: int = 1) -> PointSpread:
    """Weights for a Gaussian of `sigma_px` and diffraction of `airy_px` = wavelength x f-number, either may be 0.

    `cells` is what is asked for; a narrow spread takes more, and `shots` that differ from each other make do with less.
    """
    cells = int(np.ceil(cells / np.sqrt(shots)))
    if airy_px > 0:
        cells = max(cells, DIFFRACTION_CELLS if shots == 1 else 1, int(np.ceil(2.5 / airy_px)))
        return PointSpread(cells, AIRY_MARGIN_PX, plane=_diffraction_weights(cells, sigma_px, airy_px))
    if sigma_px > 0:
        cells = max(cells, int(np.ceil(1 / sigma_px)))
    line, margin = pixel_weights(cells, sigma_px)
    return PointSpread(cells, margin, line)


def pixel_weights(cells: int, psf_sigma_px: float) -> tuple[np.ndarray, int]:
    """Weights of a row of cells in one pixel, and how many pixels they reach beyond it on either side.

    The pixel's box convolved with the optics' Gaussian, integrated over each cell. Averaging over a cell and
    integrating the weight over it each widen the whole by a box of variance (1 / cells)^2 / 12, which is taken off the
    Gaussian's. The cells must not be wider than the Gaussian's sigma.
    """
    if psf_sigma_px == 0:
        return np.full(cells, 1 / cells), 0
    sigma = np.sqrt(psf_sigma_px**2 - 1 / (6 * cells**2))
    margin = int(np.ceil(4.5 * psf_sigma_px))
    edges = np.arange(cells * (2 * margin + 1) + 1) / cells - margin - 0.5

    def twice_integrated(x: np.ndarray) -> np.ndarray:  # of the Gaussian
        return x * (1 + erf(x / (sigma * np.sqrt(2)))) / 2 + sigma * np.exp(-((x / sigma) ** 2) / 2) / np.sqrt(
            2 * np.pi
        )

    weights = np.diff(twice_integrated(edges + 0.5) - twice_integrated(edges - 0.5))
    return weights / weights.sum(), margin


def diffraction_mtf(frequency_per_px: np.ndarray, airy_px: float) -> np.ndarray:
    """Contrast that a circular aperture passes at a frequency (Goodman, Introduction to Fourier Optics, 6.4.3)."""
    v = np.minimum(np.abs(frequency_per_px) * airy_px, 1.0)
    return 2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v * v))


def _diffraction_weights(cells: int, sigma_px: float, airy_px: float) -> np.ndarray:
    """Diffraction passes no frequency beyond 1 / airy_px, so samples of the spread at the cells' centres are all of it.

    What averaging over a cell has taken from these frequencies is given back.
    """
    f = np.fft.fftfreq(AIRY_GRID_PX * cells, 1 / cells)
    fx, fy = np.meshgrid(f, f)
    passed = diffraction_mtf(np.hypot(fx, fy), airy_px) * np.exp(-2 * np.pi**2 * sigma_px**2 * (fx**2 + fy**2))
    passed *= np.sinc(fx) * np.sinc(fy) / (np.sinc(fx / cells) * np.sinc(fy / cells))
    # Cells' centres lie half a cell off the pixel's centre where their number is even.
    shift = (cells - 1) % 2 * 0.5 / cells
    passed = passed * np.exp(-2j * np.pi * (fx + fy) * -shift)
    spread = np.fft.fftshift(np.fft.ifft2(passed).real)
    middle, reach = AIRY_GRID_PX * cells // 2, AIRY_MARGIN_PX * cells + cells // 2
    first = middle - reach
    kept = spread[first : first + (2 * AIRY_MARGIN_PX + 1) * cells, first : first + (2 * AIRY_MARGIN_PX + 1) * cells]
    return kept / kept.sum()
