"""Sampling in passes until each pixel's standard error has reached a target."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

SAMPLES_A_PASS = 32
SAMPLES_A_KERNEL = 1 << 21
NEIGHBOURS_PX = 5
"""Variances are averaged over a square this wide, so that a pixel does not end because a few samples agree by luck."""

Estimate = Callable[[np.ndarray, int, int], tuple[np.ndarray, np.ndarray]]
"""(k,) numbers of pixels, samples for each, seed: (k,) sums and sums of squares of independent samples."""


@dataclass(frozen=True)
class Sampled:
    """`values` (h, w) means, `u` (h, w) their standard errors, `samples` (h, w) a pixel."""

    values: np.ndarray
    u: np.ndarray
    samples: np.ndarray


def sample_to_target(
    estimate: Estimate, shape: tuple[int, int], target: float, most: int, seed: int, progress: Callable[[float], None]
) -> Sampled:
    """Sample an image of `shape` (h, w) until no standard error exceeds `target`, or a pixel has `most`.

    `progress` is told the fraction done since the last call, as far as it can be foreseen.
    """
    n = shape[0] * shape[1]
    total, squares, count = np.zeros(n), np.zeros(n), np.zeros(n, int)
    active, told, number = np.arange(n), 0.0, 0
    while len(active):
        chunk = SAMPLES_A_KERNEL // SAMPLES_A_PASS
        for start in range(0, len(active), chunk):
            part = active[start : start + chunk]
            s, q = estimate(part, SAMPLES_A_PASS, seed + number)
            number += 1
            total[part] += s
            squares[part] += q
            count[part] += SAMPLES_A_PASS
        variance = np.maximum(squares / count - (total / count) ** 2, 0) * count / (count - 1)
        around = uniform_filter(variance.reshape(shape), NEIGHBOURS_PX, mode="nearest").ravel()
        around = np.where(squares > 0, around, 0)  # nothing is sampled there
        u = np.sqrt(around / count)
        active = np.flatnonzero((u > target) & (count < most))
        need = np.minimum(np.ceil(around / target**2 / SAMPLES_A_PASS) * SAMPLES_A_PASS, most)
        done = float(count.sum() / np.maximum(count, need).sum())
        progress(max(done - told, 0.0))
        told = max(done, told)
    progress(1 - told)
    values = (total / count).reshape(shape)
    return Sampled(values.astype(np.float32), u.reshape(shape).astype(np.float32), count.reshape(shape))
