"""Read what surrounds a dot: nothing, a ring code, or something that makes it no target."""

import numpy as np

from testfield.detect.screen import half_axes_of, polar
from testfield.targets.marks import RingRadii
from testfield.targets.ring_code import number_of_word, smallest_rotation

PLAIN, UNREADABLE, CROWDED, CUT = 0, -1, -2, -3
"""What `decode` says instead of a number: a plain dot; a ring that cannot be read; surroundings that are no target's;
a ring of which the image shows only a part."""
SAMPLES_A_SEGMENT = 16
ACROSS = (0.3, 0.5, 0.7)
"""Where the ring is sampled, from its inner to its outer edge."""
CLEAR = 0.2
"""How far from the middle between dark and bright, in units of their difference, every segment's level must be."""
LEAST_LEVEL = 0.35
"""How bright a ring must be, in units of the dot's contrast."""
WORST_PROFILE = 0.16
"""Largest rms difference between the levels along the ring and those of the word that was read, blurred, in units of
the ring's contrast: where something hides a part of the ring, the edge it makes is seldom one of the code's."""
BLURS = (0.06, 0.15, 0.25, 0.36)
"""Blurs that are tried for the levels along the ring, in segments."""


def decode(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    background_dn: np.ndarray,
    bits: int,
    radii: RingRadii,
) -> tuple[np.ndarray, np.ndarray]:
    """Read the rings of n dots from an image (h, w) float32 of bright marks; arguments as in `Centres`.

    Returns the code (n,): a number, or `PLAIN`, `UNREADABLE`, `CROWDED`, `CUT`; and the affine map (n, 2, 2) from the
    target's plane (x right, y up, in dot radii; the code's first segment begins at +x) to px, NaN where there is no
    code or its word repeats itself and leaves the turn open.
    """
    if len(xy_px) == 0:
        return np.zeros(0, int), np.zeros((0, 2, 2))
    circle = half_axes_of(moments_px2)

    def levels(radius: float, count: int) -> np.ndarray:
        """(n, count) levels at equal angles, clockwise in the image; 0 background, 1 dot."""
        return (polar(image_dn, xy_px, circle, radius, count) - background_dn[:, None]) / contrast_dn[:, None]

    count = bits * SAMPLES_A_SEGMENT
    with np.errstate(invalid="ignore"):
        gap = levels((1 + radii.inner) / 2, 32)
        isolated = ~(gap > 0.5).any(axis=1) & (np.nan_to_num(np.abs(gap)).mean(axis=1) < 0.25)
        ring = np.mean([levels(radii.inner + a * (radii.outer - radii.inner), count) for a in ACROSS], axis=0)
        outside = levels(radii.outer + 0.4, count)
        seen = ~np.isnan(ring)
        # What is bright beyond the ring too belongs to a neighbour.
        bright = (ring > 0.5) & ~(outside > 0.5)
        quiet = (np.abs(np.nan_to_num(outside)) < 0.5).mean(axis=1) > 0.85
    # A code has two opposite segments that are bright: half of the ring is enough to see that there is none.
    plain = (bright.sum(axis=1) < 0.7 * SAMPLES_A_SEGMENT) & (seen.mean(axis=1) > 0.5 + 1 / bits)
    words, trust, phase = _read(np.nan_to_num(ring), bits)
    number = number_of_word(words, bits)

    code = np.where((number > 0) & trust & quiet, number, UNREADABLE)
    code = np.where(seen.all(axis=1), code, CUT)
    code = np.where(plain, PLAIN, code)
    code = np.where(isolated, code, CROWDED)
    turn = phase + 2 * np.pi / bits * _first_segment(words, bits)
    c, s = np.cos(turn), np.sin(turn)
    upright = np.stack([np.stack([c, s], -1), np.stack([s, -c], -1)], -2)  # rotation after turning y up into y down
    return code, np.where((code > 0)[:, None, None], circle @ upright, np.nan)


def _first_segment(words: np.ndarray, bits: int) -> np.ndarray:
    """(n,) which segment as read begins the smallest rotation; NaN where more than one does."""
    mask = np.uint32((1 << bits) - 1)
    turned = np.stack([((words << np.uint32(k)) | (words >> np.uint32(bits - k))) & mask for k in range(bits)], axis=1)
    smallest = turned == smallest_rotation(words, bits)[:, None]
    return np.where(smallest.sum(axis=1) == 1, np.argmax(smallest, axis=1), np.nan)


def _read(ring: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At the phase where the segments are clearest: words (n,), whether they explain the levels (n,), and the angle
    at which the first segment begins. `ring` (n, bits * SAMPLES_A_SEGMENT) levels, 0 dark, 1 as bright as the dot."""
    n, k = len(ring), SAMPLES_A_SEGMENT
    shifted = np.stack([np.roll(ring, -phase, axis=1) for phase in range(k)], axis=1).reshape(n, k, bits, k)
    inner = shifted[..., k // 4 : k - k // 4]
    level = inner.mean(axis=-1)
    noise = inner.var(axis=-1).sum(axis=-1)
    best = np.argmax(np.abs(level - 0.5).sum(axis=-1) - noise, axis=1)
    level, profile = level[np.arange(n), best], shifted[np.arange(n), best].reshape(n, -1)

    # The ring may be brighter or darker than the dot: it has its own middle.
    top = np.clip(np.sort(level, axis=1)[:, -2:].mean(axis=1), 0, 3)
    middle = (np.clip(level.min(axis=1), -0.3, 0.3) + top) / 2
    word_bits = level > middle[:, None]
    words = (word_bits @ (1 << np.arange(bits - 1, -1, -1))).astype(np.uint32)
    margin = np.abs(level - middle[:, None]).min(axis=1)

    expected = np.repeat(word_bits.astype(float), k, axis=1)
    spectrum, wave = np.fft.rfft(expected, axis=1), np.arange(expected.shape[1] // 2 + 1)
    error, contrast = np.full(n, np.inf), np.zeros(n)
    for blur in BLURS:
        smooth = np.fft.irfft(spectrum * np.exp(-2 * (np.pi * wave * blur / bits) ** 2), expected.shape[1], axis=1)
        s, p = smooth - smooth.mean(axis=1, keepdims=True), profile - profile.mean(axis=1, keepdims=True)
        slope = (s * p).sum(axis=1) / np.maximum((s * s).sum(axis=1), 1e-9)
        rms = np.sqrt(np.mean((p - slope[:, None] * s) ** 2, axis=1))
        better = rms < error
        error, contrast = np.where(better, rms, error), np.where(better, slope, contrast)
    trust = (contrast > LEAST_LEVEL) & (margin > CLEAR * contrast) & (error < WORST_PROFILE * contrast)
    return words, trust, 2 * np.pi * best / (bits * k)
