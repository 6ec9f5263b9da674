"""Interlaced video: every second line was exposed at another time, so what moved has jagged edges.

The even lines alone are one exposure. They are looked at as an image of half the height, and what is found there is
told in the whole image's pixels.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from testfield.detect.noise import noise_of_pixels
from testfield.detect.targets import Targets

COMBED, LEAST_SHIFT_PX = 1.15, 0.8
"""Lines are of two exposures where neighbours differ by so many times more than next but one do, which no image of one
exposure shows; and where they fit best when shifted by so much. What moved less is measured as well from all lines."""
MOST_SHIFT_PX, STEPS = 8, 4
"""How far and how finely shifts are tried, in px and steps a px."""
EDGE_SIGMAS = 8.0
MOST_PIXELS = 4_000_000
"""Of larger images not every pair of lines is asked."""


@dataclass(frozen=True)
class Combed:
    """By how many px the odd lines lie to the right of the even ones: `shift_px`."""

    shift_px: float


def combed(image: np.ndarray) -> Combed | None:
    """Whether the odd lines of an image (h, w) float32 are shifted against the even ones; None where they are not."""
    height = image.shape[0] // 2 * 2
    if height < 16 or image.shape[1] < 4 * MOST_SHIFT_PX:
        return None
    thin = 1 + image.size // MOST_PIXELS
    even, beside, after = (image[k : height - 2 + k : 2][::thin] for k in range(3))
    # Only where something is to be seen: noise is alike at any distance.
    noise, between = 2 * noise_of_pixels(image) ** 2, (even + after) / 2
    edge = np.abs(cv2.Sobel(between, cv2.CV_32F, 1, 0, ksize=3)) > EDGE_SIGMAS * np.sqrt(noise)
    if edge.sum() < 50:
        return None
    one = float(((beside - even) ** 2)[edge].mean() + ((beside - after) ** 2)[edge].mean()) / 2 - noise
    two = float(((after - even) ** 2)[edge].mean()) - noise
    if one < COMBED * max(two, noise):
        return None
    columns = np.arange(image.shape[1], dtype=np.float32)
    trust = edge.copy()
    trust[:, :MOST_SHIFT_PX] = trust[:, -MOST_SHIFT_PX:] = False
    shifts = np.arange(-MOST_SHIFT_PX * STEPS, MOST_SHIFT_PX * STEPS + 1) / STEPS
    rows = np.arange(len(between), dtype=np.float32)
    misfit = []
    for shift in shifts:
        x, y = np.meshgrid(columns - np.float32(shift), rows)
        moved = cv2.remap(between, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        misfit.append(float(((moved - beside) ** 2)[trust].mean()) if trust.any() else np.inf)
    best = float(shifts[int(np.argmin(misfit))])
    return Combed(best) if abs(best) >= LEAST_SHIFT_PX else None


def even_lines(image: np.ndarray) -> np.ndarray:
    """The first line and every second one after it (h / 2, w)."""
    return np.ascontiguousarray(image[0::2])


def in_all_lines(targets: Targets) -> Targets:
    """What was found in the even lines, in the pixels of the whole image."""
    scale = np.array([1.0, 2.0])
    square = np.outer(scale, scale)
    return replace(
        targets,
        xy_px=targets.xy_px * scale,
        cov_px2=targets.cov_px2 * square,
        moments_px2=targets.moments_px2 * square,
        affine=targets.affine * scale[:, None],
    )
