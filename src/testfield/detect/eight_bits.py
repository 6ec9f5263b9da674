"""The bytes that OpenCV's detectors take, so that nothing bright or dark elsewhere in the image hides a board."""

from collections.abc import Iterator

import cv2
import numpy as np

from testfield.detect.noise import noise_of_pixels

PARTS = 8
"""Windows along the image's shorter side whose range of light is looked at."""
ENOUGH_LEVELS = 48
"""Black and white that far apart are enough: the detectors' thresholds are 7 levels wide."""
VISIBLE_SIGMAS = 20.0
"""What spans less than so much noise is no print, and is not stretched."""


def pictures(pixels: np.ndarray) -> Iterator[np.ndarray]:
    """Bytes (h, w) of an image (h, w) float32: all of its range as it is; then, where that leaves a part too few
    levels, one in which every part has its own."""
    whole = eight_bits(pixels)
    yield whole
    noise_dn = noise_of_pixels(pixels)
    low, _, _, _, high = _range(pixels)
    left = (high - low) * _levels_a_dn(pixels)
    if ((left < ENOUGH_LEVELS) & (high - low > VISIBLE_SIGMAS * noise_dn)).any():
        yield _by_parts(pixels, noise_dn)


def eight_bits(pixels: np.ndarray) -> np.ndarray:
    """Black to the brightest pixels but one in a thousand."""
    return np.clip((pixels - float(pixels.min())) * _levels_a_dn(pixels), 0, 255).astype(np.uint8)


def _levels_a_dn(pixels: np.ndarray) -> float:
    return 255 / max(float(np.percentile(pixels, 99.9)) - float(pixels.min()), 1e-6)


def _by_parts(pixels: np.ndarray, noise_dn: float) -> np.ndarray:
    """Every part stretched over its own range, by a curve that is straight where half of the part's pixels lie and
    logarithmic beyond: a lamp or a black mask within the part leaves the print enough, and noise stays small."""
    low, below, middle, above, high = _range(pixels)
    bend = (above - below) / 2 + VISIBLE_SIGMAS * noise_dn
    high = np.maximum(high, low + VISIBLE_SIGMAS * noise_dn)
    curves = middle, bend, np.arcsinh((low - middle) / bend), np.arcsinh((high - middle) / bend)
    size = pixels.shape[::-1]
    middle, bend, least, most = (cv2.resize(v.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) for v in curves)
    light = (np.arcsinh((pixels - middle) / bend) - least) / (most - least)
    return np.asarray(np.clip(255 * light, 0, 255).astype(np.uint8))


def _range(pixels: np.ndarray) -> np.ndarray:
    """Values (5, r, c) of overlapping windows: the darkest but a fiftieth, quarters, the brightest but a fiftieth."""
    height, width = pixels.shape
    step = max(min(height, width) // PARTS, 8)
    rows, columns = max(round(height / step), 1), max(round(width / step), 1)
    found = np.zeros((5, rows, columns))
    for r in range(rows):
        for c in range(columns):
            y, x = ((k + 0.5) * size / count for k, size, count in ((r, height, rows), (c, width, columns)))
            part = pixels[max(int(y) - step, 0) : int(y) + step + 1, max(int(x) - step, 0) : int(x) + step + 1]
            found[:, r, c] = np.percentile(part[:: 1 + step // 64, :: 1 + step // 64], [2, 25, 50, 75, 98])
    return found
