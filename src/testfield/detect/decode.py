"""Read what surrounds a dot: nothing, a ring code, or something that makes it no target."""

import numpy as np

from testfield.detect.screen import half_axes_of, polar
from testfield.targets.marks import RingRadii
from testfield.targets.ring_code import number_of_word, smallest_rotation

PLAIN, UNREADABLE, CROWDED, CUT = 0, -1, -2, -3
"""What `decode` says instead of a number: a plain dot; a ring that cannot be read; surroundings that are no target's;
a ring of which the image shows only a part."""
HOLE = 0.6
"""A plain dot has ground where a ring would be: bright in more than this part of all directions it is no dot."""
SAMPLES_A_SEGMENT = 16
ACROSS = (0.3, 0.5, 0.7)
"""Where the ring is sampled, from its inner to its outer edge."""
DOT, RAYS, STEEPEST = (0.3, 0.6), 32, 0.3
"""Where the light's slope across the dot is measured, and the steepest that is believed, of the contrast a radius."""
CLEAR = 0.2
"""How far from the middle between dark and bright, in units of their difference, every segment's level must be."""
LEAST_LEVEL = 0.35
"""How bright a ring must be, in units of the dot's contrast."""
WORST_PROFILE = 0.16
"""Largest rms difference between the levels along the ring and those of the word that was read, blurred, in units of
the ring's contrast: where something hides a part of the ring, the edge it makes is seldom one of the code's."""
MISPLACED, MISPLACED_PX = 0.15, 0.35
"""How far the end of a bright part may lie from the end of a segment, in segments and pixels together."""
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
    middle_of_gap = (1 + radii.inner) / 2
    ground, contrast = _light(image_dn, xy_px, circle, contrast_dn, background_dn, middle_of_gap)

    def levels(radius: float, count: int) -> np.ndarray:
        """(n, count) levels at equal angles, clockwise in the image; 0 ground, 1 as bright as the dot would be here."""
        values = polar(image_dn, xy_px, circle, radius, count)
        return (values - _at(ground, radius, count)) / np.maximum(_at(contrast, radius, count), 0.25 * contrast[:, :1])

    count = bits * SAMPLES_A_SEGMENT
    with np.errstate(invalid="ignore"):
        gap = levels(middle_of_gap, 32)
        isolated = ~(gap > 0.5).any(axis=1) & (np.nan_to_num(np.abs(gap)).mean(axis=1) < 0.25)
        rings = np.stack([levels(radii.inner + a * (radii.outer - radii.inner), count) for a in ACROSS])
        ring = rings.mean(axis=0)
        outside = levels(radii.outer + 0.4, count)
        seen = ~np.isnan(ring)
        # What is bright beyond the ring too belongs to a neighbour.
        bright = (ring > 0.5) & ~(outside > 0.5)
        quiet = (np.abs(np.nan_to_num(outside)) < 0.5).mean(axis=1) > 0.85
    # A code has two opposite segments that are bright: half of the ring is enough to see that there is none.
    plain = (bright.sum(axis=1) < 0.7 * SAMPLES_A_SEGMENT) & (seen.mean(axis=1) > 0.5 + 1 / bits)
    # A disc in the middle of a bright surface is a ring's hole.
    hole = (ring > 0.5).sum(axis=1) > HOLE * np.maximum(seen.sum(axis=1), 1)
    shortest_px = np.sqrt(4 * np.linalg.eigvalsh(moments_px2)[:, 0]) * np.pi * (radii.inner + radii.outer) / bits
    words, trust, phase = _read(np.nan_to_num(ring), bits)
    trust &= _ends_agree(np.nan_to_num(rings), words, phase, bits, MISPLACED + MISPLACED_PX / shortest_px)
    number = number_of_word(words, bits)

    code = np.where((number > 0) & trust & quiet, number, UNREADABLE)
    code = np.where(seen.all(axis=1), code, CUT)
    code = np.where(plain, PLAIN, code)
    code = np.where(isolated & ~((code == PLAIN) & hole), code, CROWDED)
    turn = phase + 2 * np.pi / bits * _first_segment(words, bits)
    c, s = np.cos(turn), np.sin(turn)
    upright = np.stack([np.stack([c, s], -1), np.stack([s, -c], -1)], -2)  # rotation after turning y up into y down
    return code, np.where((code > 0)[:, None, None], circle @ upright, np.nan)


def _ends_agree(
    rings: np.ndarray, words: np.ndarray, phase: np.ndarray, bits: int, tolerance: np.ndarray
) -> np.ndarray:
    """(n,) whether every change from dark to bright lies where the word has it, near the ring's inner edge as near its
    outer one, within `tolerance` (n,) segments. `rings` (r, n, bits * SAMPLES_A_SEGMENT) levels on several circles.

    Something dark in front of a dark target shows nowhere else than in the ends of the segments it hides.
    """
    k, n = SAMPLES_A_SEGMENT, len(words)
    start = np.rint(phase / (2 * np.pi) * bits * k).astype(int) - k // 2
    turned = np.take_along_axis(
        rings, ((start[:, None] + np.arange(bits * k)) % (bits * k))[None].repeat(len(rings), axis=0), axis=2
    )
    bit = (words[:, None] >> np.arange(bits - 1, -1, -1).astype(np.uint32)) & 1
    before = np.roll(bit, 1, axis=1)
    agree = np.ones(n, bool)
    for levels in turned:
        # From the middle of one segment to the middle of the next: half of it is bright where they differ. How bright
        # is asked of the segments' middles here, since light is seldom even.
        level = np.roll(levels, k // 2, axis=1).reshape(n, bits, k)[..., k // 2 - 2 : k // 2 + 2].mean(axis=2)
        level = np.roll(level, -1, axis=1)
        bright = np.maximum(np.where(bit, level, 0), np.where(before, np.roll(level, 1, axis=1), 0))
        bright = np.where(bright > 0, bright, bright.max(axis=1, keepdims=True))
        share = np.clip(levels.reshape(n, bits, k) / np.maximum(bright, 0.2)[..., None], 0, 1).mean(axis=2)
        off = share - (before + bit) / 2
        agree &= (np.abs(off) < tolerance[:, None]).all(axis=1)
    return agree


def _light(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    circle: np.ndarray,
    contrast_dn: np.ndarray,
    background_dn: np.ndarray,
    gap: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The ground's level and the dot's contrast as planes (n, 3): at the centre, and their slopes a dot radius.

    Light that slopes across a target slopes across its dot and its gap in proportion to their levels.
    """
    slopes = []
    for radii in ((gap,), DOT):
        total, weight = np.zeros((len(xy_px), 2)), 0.0
        for radius in radii:
            values = polar(image_dn, xy_px, circle, radius, RAYS)
            values = np.where(np.isnan(values).any(axis=1, keepdims=True), 0, values)  # cut: taken as level
            total += 2 / RAYS * radius * values @ _directions(RAYS)
            weight += radius**2
        slopes.append(total / weight)
    step = slopes[1] - slopes[0]
    steepest = np.linalg.norm(step, axis=1, keepdims=True) / np.maximum(contrast_dn[:, None], 1e-9)
    step = step * np.minimum(1, STEEPEST / np.maximum(steepest, 1e-9))
    return np.column_stack([background_dn, slopes[0]]), np.column_stack([contrast_dn, step])


def _at(plane: np.ndarray, radius: float, count: int) -> np.ndarray:
    """(n, count) values of planes on the circle of relative `radius`."""
    return plane[:, :1] + radius * plane[:, 1:] @ _directions(count).T


def _directions(count: int) -> np.ndarray:
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


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
    noise = 2 * shifted.var(axis=-1).sum(axis=-1)  # of whole segments: least where they begin and end as the ring's do
    best = np.argmax(np.abs(level - 0.5).sum(axis=-1) - noise, axis=1)
    level, profile = level[np.arange(n), best], shifted[np.arange(n), best].reshape(n, -1)

    # The ring may be brighter or darker than the dot: it has its own middle.
    top = np.clip(np.sort(level, axis=1)[:, -2:].mean(axis=1), 0, 3)
    middle = (np.clip(level.min(axis=1), -0.3, 0.3) + top) / 2
    word_bits = level > middle[:, None]
    words = (word_bits @ (1 << np.arange(bits - 1, -1, -1))).astype(np.uint32)
    margin = np.abs(level - middle[:, None]).min(axis=1)

    expected = np.repeat(word_bits.astype(float), k, axis=1)
    # Near a segment's ends a slightly wrong ellipse or perspective is felt; what hides a ring ends anywhere.
    within = np.tile((np.arange(k) >= k // 5) & (np.arange(k) < k - k // 5), bits)
    spectrum, wave = np.fft.rfft(expected, axis=1), np.arange(expected.shape[1] // 2 + 1)
    error, contrast = np.full(n, np.inf), np.zeros(n)
    for blur in BLURS:
        smooth = np.fft.irfft(spectrum * np.exp(-2 * (np.pi * wave * blur / bits) ** 2), expected.shape[1], axis=1)
        s, p = smooth[:, within], profile[:, within]
        s, p = s - s.mean(axis=1, keepdims=True), p - p.mean(axis=1, keepdims=True)
        slope = (s * p).sum(axis=1) / np.maximum((s * s).sum(axis=1), 1e-9)
        rms = np.sqrt(np.mean((p - slope[:, None] * s) ** 2, axis=1))
        better = rms < error
        error, contrast = np.where(better, rms, error), np.where(better, slope, contrast)
    trust = (contrast > LEAST_LEVEL) & (margin > CLEAR * contrast) & (error < WORST_PROFILE * contrast)
    return words, trust, 2 * np.pi * best / (bits * k)
