"""From the levels along rings to the words that they spell."""

from functools import lru_cache

import numpy as np

from testfield.store.compiled import compiled

SAMPLES_A_SEGMENT = 16
"""How densely a ring is sampled to read it."""
BLURS = (0.06, 0.15, 0.25, 0.36)
"""Blurs that are tried for the levels along the ring, in segments."""


def read_rings(levels: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Words (n,), at which sample (n,) their first segments begin, and marks (n, 4), at the phase where the segments
    are clearest; `levels` (n, c, bits * `SAMPLES_A_SEGMENT`) on several circles, 0 dark, 1 as bright as the dot.

    The marks are: how far the least clear segment is from the middle between dark and bright; the rms difference
    between the levels' mean over the circles and that of the word, blurred; the ring's contrast; and how far, in
    segments, the worst change between dark and bright lies from where the word has it, on any of the circles: something
    dark in front of a dark target shows nowhere else than in the ends of the segments that it hides.
    """
    known = np.ascontiguousarray(np.nan_to_num(levels), np.float32)
    # Where one circle leaves the image the mean is not known either.
    mean = np.nan_to_num(levels.mean(axis=1)).astype(float)
    return _read(known, np.ascontiguousarray(mean), _blurred(bits), bits)


@lru_cache(8)
def _blurred(bits: int) -> np.ndarray:
    """(b, bits, bits * SAMPLES_A_SEGMENT) levels along a ring of which only one segment is bright, for each blur and
    segment."""
    k, wave = SAMPLES_A_SEGMENT, np.arange(bits * SAMPLES_A_SEGMENT // 2 + 1)
    spectrum = np.fft.rfft(np.repeat(np.eye(bits), k, axis=1), axis=1)
    return np.stack(
        [np.fft.irfft(spectrum * np.exp(-2 * (np.pi * wave * b / bits) ** 2), bits * k, axis=1) for b in BLURS]
    )


@compiled
def _read(
    rings: np.ndarray, means: np.ndarray, blurred: np.ndarray, bits: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n, k, m = len(means), SAMPLES_A_SEGMENT, bits * SAMPLES_A_SEGMENT
    words, begins, marks = np.zeros(n, np.uint32), np.zeros(n, np.int64), np.empty((n, 4))
    sums, squares, level, spelt, bit = (
        np.zeros(2 * m + 1),
        np.zeros(2 * m + 1),
        np.empty(bits),
        np.empty(m),
        np.empty(bits),
    )
    for i in range(n):
        ring = means[i]
        for j in range(2 * m):
            value = ring[j % m]
            sums[j + 1], squares[j + 1] = sums[j] + value, squares[j] + value * value
        begin = _clearest(sums, squares, bits)
        for b in range(bits):
            first = begin + b * k + k // 4
            level[b] = (sums[first + k // 2] - sums[first]) / (k // 2)
        # The ring may be brighter or darker than the dot: it has its own middle.
        darkest, brightest, second = np.inf, -np.inf, -np.inf
        for b in range(bits):
            darkest = min(darkest, level[b])
            second = max(second, min(level[b], brightest))
            brightest = max(brightest, level[b])
        middle = 0.5 * (min(max(darkest, -0.3), 0.3) + min(max(0.5 * (brightest + second), 0.0), 3.0))
        word, margin = 0, np.inf
        for b in range(bits):
            bit[b] = level[b] > middle
            word = 2 * word + (level[b] > middle)
            margin = min(margin, abs(level[b] - middle))
        words[i], begins[i], marks[i, 0] = word, begin, margin
        marks[i, 1], marks[i, 2] = np.inf, 0.0
        for blur in range(len(blurred)):
            for j in range(m):
                spelt[j] = 0
            for b in range(bits):
                if bit[b]:
                    for j in range(m):
                        spelt[j] += blurred[blur, b, j]
            error, contrast = _departure(ring, begin, spelt)
            if error < marks[i, 1]:
                marks[i, 1], marks[i, 2] = error, contrast
        marks[i, 3] = 0
        for circle in range(rings.shape[1]):
            marks[i, 3] = max(marks[i, 3], _misplaced(rings[i, circle], begin, bit, level))
    return words, begins, marks


@compiled
def _clearest(sums: np.ndarray, squares: np.ndarray, bits: int) -> int:
    """Where segments begin: where their levels are farthest from one half and scatter least within each."""
    k = SAMPLES_A_SEGMENT
    best, clearest = 0, -np.inf
    for phase in range(k):
        clear = 0.0
        for b in range(bits):
            first = phase + b * k
            inner = (sums[first + k // 4 + k // 2] - sums[first + k // 4]) / (k // 2)
            mean, square = (sums[first + k] - sums[first]) / k, (squares[first + k] - squares[first]) / k
            clear += abs(inner - 0.5) - 2 * (square - mean * mean)
        if clear > clearest:
            best, clearest = phase, clear
    return best


@compiled
def _departure(ring: np.ndarray, begin: int, spelt: np.ndarray) -> tuple[float, float]:
    """Rms difference between a ring's levels and those of a word in the contrast that fits best, and that contrast.

    Near a segment's ends a slightly wrong ellipse or perspective is felt; what hides a ring ends anywhere.
    """
    k, m = SAMPLES_A_SEGMENT, len(ring)
    count, r, s, rr, rs, ss = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(m):
        if k // 5 <= j % k < k - k // 5:
            a, b = ring[(begin + j) % m], spelt[j]
            count, r, s, rr, rs, ss = count + 1, r + a, s + b, rr + a * a, rs + a * b, ss + b * b
    rr, rs, ss = rr - r * r / count, rs - r * s / count, ss - s * s / count
    contrast = rs / max(ss, 1e-9)
    return np.sqrt(max(rr - 2 * contrast * rs + contrast * contrast * ss, 0.0) / count), contrast


@compiled
def _misplaced(ring: np.ndarray, begin: int, bit: np.ndarray, level: np.ndarray) -> float:
    """How far, in segments, the worst change along one circle lies from where the word has it.

    From the middle of one segment to the middle of the next half of it is bright where they differ. How bright is asked
    of the segments' middles here, since light is seldom even.
    """
    k, m, bits = SAMPLES_A_SEGMENT, len(ring), len(bit)
    most = 0.0
    for b in range(bits):
        middle = 0.0
        for j in range(-2, 2):
            middle += ring[(begin + b * k + k // 2 + j) % m]
        level[b] = 0.25 * middle if bit[b] else 0.0
        most = max(most, level[b])
    worst = 0.0
    for b in range(bits):
        bright = max(level[b], level[b - 1])
        bright = max(bright if bright > 0 else most, 0.2)
        share = 0.0
        for j in range(k):
            share += min(max(ring[(begin + b * k - k // 2 + j + m) % m] / bright, 0.0), 1.0)
        worst = max(worst, abs(share / k - 0.5 * (bit[b] + bit[b - 1])))
    return worst
