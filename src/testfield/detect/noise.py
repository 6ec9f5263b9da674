"""The noise of an image whose sensor nobody described, from the image itself."""

import cv2
import numpy as np

from testfield.camera.images import SensorSheet

TILE_PX = 12
QUIETEST = 0.2
"""Of the tiles of like brightness this part, the quietest, is taken to show noise and no texture."""
LEVELS = 12
MOST_PIXELS = 4_000_000
"""Of larger images the tiles are thinned out."""
LEAST_DN = 0.35
"""Least standard deviation that is believed, in DN: rounding alone makes 0.29."""

FEW_PIXELS = 4
"""So many at the end of the numbers may be hot pixels."""
DARKER, VISIBLE_DN = 0.9, 0.5
"""Surfaces darker than this part of the largest value tell whether there is noise, which rounding hides below the
second."""
SURFACE_PX, EVEN = 6, 2.0
"""Side of a tile that must show nothing but noise: its variance is at most so many times its second difference's."""
LEAST_SURFACES = 8
SAME_DN, SPIKE = 0.01, 0.5
"""Values this near are one; a cut plateau has more pixels on its end than this part of those just below."""


def estimate_sheet(image: np.ndarray, bits: int, end_dn: float = float("inf")) -> SensorSheet:
    """A sheet whose variance a + b * DN follows the quiet parts of an image (h, w) float32 in 0 to 2**bits - 1, some
    pixels of which end at `end_dn` already.

    The noise is seen through a second difference in both directions, which neither a slope nor an edge along the rows
    or columns passes, at full and at half size: noise that a converter's interpolation or a JPEG has smeared over
    neighbours counts with what is left of it in a mean of pixels.
    """
    largest = float((1 << bits) - 1)
    fine = _levels_and_variances(image)
    h, w = (size // 2 * 2 for size in image.shape)
    if min(h, w) >= 4 * TILE_PX:
        half = cv2.resize(image[:h, :w], (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        coarse = _levels_and_variances(half)
    else:
        coarse = (np.zeros(0), np.zeros(0))
    floor = LEAST_DN**2 - 1 / 12
    a, b = max(_line(*fine)[0], floor), _line(*fine)[1]
    if len(coarse[0]) >= 3:
        c, d = _line(coarse[0], 4 * coarse[1])
        middle = float(np.median(fine[0]))
        # A half-size image has more texture a pixel: it is believed up to four times the variance.
        grow = np.clip((c + d * middle) / max(a + b * middle, 1e-12), 1, 4)
        a, b = a * grow, b * grow
    b = max(b, 1e-6)
    gain = 1 / b
    full_dn = _full_dn(image, min(largest, end_dn))
    # Where nothing is full, how far the numbers go on is not known: one bit more leaves room above the largest.
    bits += np.isinf(full_dn)
    return SensorSheet(gain, float(np.sqrt(a)) * gain, 0.0, int(bits), full_dn * gain)


def _levels_and_variances(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean levels and noise variances of groups of quiet tiles of like level."""
    rows, columns = (size // TILE_PX for size in image.shape)
    if rows * columns < 4:
        return np.zeros(0), np.zeros(0)
    rest = _second_difference(image)

    def tiles(values: np.ndarray) -> np.ndarray:
        return cv2.resize(
            values[: rows * TILE_PX, : columns * TILE_PX], (columns, rows), interpolation=cv2.INTER_AREA
        ).ravel()

    mean, variance = tiles(image), tiles(rest * rest)
    order = np.argsort(mean, kind="stable")
    groups = [g for g in np.array_split(order, min(LEVELS, max(1, len(order) // 8))) if len(g)]
    level = np.array([np.median(mean[g]) for g in groups])
    # The quietest fifth of tiles of pure noise shows about nine tenths of it.
    quiet = np.array([np.quantile(variance[g], QUIETEST) for g in groups]) / 0.86
    return level.astype(float), quiet.astype(float)


def _line(level: np.ndarray, variance: np.ndarray) -> tuple[float, float]:
    """Offset and slope, neither negative, of variance over level; each group counts by its relative error."""
    from scipy.optimize import nnls

    if len(level) == 0:
        return 0.0, 0.0
    weight = 1 / np.maximum(variance, 0.05)
    (a, b), _ = nnls(np.column_stack([np.ones_like(level), np.maximum(level, 0)]) * weight[:, None], variance * weight)
    return float(a), float(b)


def _full_dn(image: np.ndarray, largest: float) -> float:
    """The level at which pixels saturate; infinity where none does.

    Pixels saturate at the end of the format's numbers, where some lie on it. A plateau below may as well be quiet
    paper, or a drawing's. It was cut where its pixels are all alike and darker surfaces show noise: with noise on it,
    its largest value would be its rarest.
    """
    if int((image >= largest).sum()) > FEW_PIXELS:
        return largest
    top = float(image.max())
    noise = _noise_of_surfaces(image, DARKER * top)
    if noise < VISIBLE_DN:
        return float("inf")
    at_top = int((image > top - SAME_DN).sum())
    below = int((image > top - max(2 * noise, 1) - SAME_DN).sum()) - at_top
    return top if at_top > max(20, 1e-5 * image.size) and at_top > SPIKE * below else float("inf")


def _noise_of_surfaces(image: np.ndarray, below_dn: float) -> float:
    """Standard deviation in DN of the quietest tiles among those evenly lit and darker than a level; 0 where
    there are too few to tell."""
    side = SURFACE_PX
    rows, columns = (size // side for size in image.shape)
    skip = 1 + image.size // MOST_PIXELS

    def tiles(values: np.ndarray) -> np.ndarray:
        """(m, side * side) values tile by tile; of large images not every row of tiles."""
        cut = values[: rows * side, : columns * side].reshape(rows, side, columns, side)[::skip]
        return np.asarray(cut.swapaxes(1, 2).reshape(-1, side * side), float)

    level = tiles(image)
    noise = np.square(tiles(_second_difference(image))).mean(axis=1)
    even = (level.mean(axis=1) < below_dn) & (level.var(axis=1) < EVEN * noise + VISIBLE_DN**2)
    return float(np.sqrt(np.quantile(noise[even], QUIETEST))) if even.sum() >= LEAST_SURFACES else 0.0


def noise_of_pixels(image: np.ndarray) -> float:
    """Standard deviation in DN of most pixels' noise, at least what rounding leaves: half of all second differences
    are smaller than noise alone makes them, and texture makes them larger."""
    some = image[:: 1 + image.size // MOST_PIXELS]
    return max(float(np.median(np.abs(_second_difference(some)))) / 0.6745, LEAST_DN)


def _second_difference(image: np.ndarray) -> np.ndarray:
    """Second difference in both directions, scaled to keep the variance of white noise."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
    return cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT)
