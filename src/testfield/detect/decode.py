"""Read what surrounds a dot: nothing, a ring code, or something that makes it no target."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from testfield.detect.screen import half_axes_of, polar
from testfield.targets.marks import RingRadii
from testfield.targets.ring_code import number_of_word, smallest_rotation

PLAIN, UNREADABLE, CROWDED, CUT = 0, -1, -2, -3
"""What `decode` says instead of a number: a plain dot; a ring that cannot be read; surroundings that are no target's;
a ring of which the image shows only a part."""
HOLE = 0.6
"""A plain dot has ground where a ring would be: bright in more than this part of all directions it is no dot."""
SAMPLES_A_SEGMENT, TO_SEE = 16, 4
"""How densely a ring is sampled to read it, and to see whether there is one."""
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
BATCH = 256
"""Dots at a time: what is sampled about them then stays in the processor's cache."""
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
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read the rings of n dots from an image (h, w) float32 of bright marks; arguments as in `Centres`.

    Returns the code (n,): a number, or `PLAIN`, `UNREADABLE`, `CROWDED`, `CUT`; and the affine map (n, 2, 2) from the
    target's plane (x right, y up, in dot radii; the code's first segment begins at +x) to px, NaN where there is no
    code. A word that repeats itself leaves the turn open; the map is then one of several. Last the doubt (n,): how far
    the worst end of a bright part lies from where the word has it, in units of what is allowed.
    """
    n = len(xy_px)
    code, affine, doubt = np.full(n, PLAIN), np.full((n, 2, 2), np.nan), np.zeros(n)

    def read(rows: slice) -> None:
        surroundings = _surroundings(
            image_dn, xy_px[rows], moments_px2[rows], contrast_dn[rows], background_dn[rows], radii
        )
        code[rows], affine[rows], doubt[rows] = _decode(surroundings, bits)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(read, (slice(start, start + BATCH) for start in range(0, len(xy_px), BATCH))))
    return code, affine, doubt


@dataclass(frozen=True)
class _Surroundings:
    """The image about n dots, seen in units of their contrast: `xy_px` (n, 2), `circle` (n, 2, 2) half-axes, `ground`
    and `contrast` (n, 3) planes as `_light` gives them."""

    image_dn: np.ndarray
    xy_px: np.ndarray
    circle: np.ndarray
    ground: np.ndarray
    contrast: np.ndarray
    radii: RingRadii

    def only(self, mask: np.ndarray) -> "_Surroundings":
        return replace(
            self,
            xy_px=self.xy_px[mask],
            circle=self.circle[mask],
            ground=self.ground[mask],
            contrast=self.contrast[mask],
        )

    def levels(self, radius: float, count: int) -> np.ndarray:
        """(n, count) levels at equal angles, clockwise in the image; 0 ground, 1 as bright as the dot would be here."""
        values = polar(self.image_dn, self.xy_px, self.circle, radius, count)
        contrast = np.maximum(_at(self.contrast, radius, count), np.float32(0.25) * self.contrast[:, :1])
        return (values - _at(self.ground, radius, count)) / contrast

    def rings(self, count: int) -> np.ndarray:
        """(r, n, count) levels on several circles between the ring's edges."""
        inner, outer = self.radii.inner, self.radii.outer
        return np.stack([self.levels(inner + a * (outer - inner), count) for a in ACROSS])

    def bright(self, ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the ring (n, count) is bright, and whether it is quiet beyond it (n,). What is bright beyond the ring
        too belongs to a neighbour."""
        outside = self.levels(self.radii.outer + 0.4, ring.shape[1])
        quiet = (np.abs(np.nan_to_num(outside)) < 0.5).mean(axis=1) > 0.85
        return (ring > 0.5) & ~(outside > 0.5), quiet


def _surroundings(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    background_dn: np.ndarray,
    radii: RingRadii,
) -> _Surroundings:
    circle = half_axes_of(moments_px2)
    light = _light(image_dn, xy_px, circle, contrast_dn, background_dn, (1 + radii.inner) / 2)
    ground, contrast = (plane.astype(np.float32) for plane in light)
    return _Surroundings(image_dn, xy_px, circle, ground, contrast, radii)


def _decode(seen_from: _Surroundings, bits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n = len(seen_from.xy_px)
    code, affine, doubt = np.full(n, CROWDED), np.full((n, 2, 2), np.nan), np.zeros(n)
    with np.errstate(invalid="ignore"):
        gap = seen_from.levels((1 + seen_from.radii.inner) / 2, 32)
        isolated = np.flatnonzero(~(gap > 0.5).any(axis=1) & (np.nan_to_num(np.abs(gap)).mean(axis=1) < 0.25))
        # A code has two opposite segments that are bright: half of the ring is enough to see that there is none.
        near = seen_from.only(isolated)
        ring = near.rings(bits * TO_SEE).mean(axis=0)
        bright, _ = near.bright(ring)
        plain = (bright.sum(axis=1) < 0.7 * TO_SEE) & ((~np.isnan(ring)).mean(axis=1) > 0.5 + 1 / bits)
        # A disc in the middle of a bright surface is a ring's hole.
        hole = (ring > 0.5).sum(axis=1) > HOLE * np.maximum((~np.isnan(ring)).sum(axis=1), 1)
    code[isolated[plain & ~hole]] = PLAIN
    ringed = isolated[~plain]
    if len(ringed):
        code[ringed], affine[ringed], doubt[ringed] = _decode_rings(near.only(~plain), bits)
    return code, affine, doubt


def _decode_rings(seen_from: _Surroundings, bits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    with np.errstate(invalid="ignore"):
        rings = seen_from.rings(bits * SAMPLES_A_SEGMENT)
        ring = rings.mean(axis=0)
        _, quiet = seen_from.bright(ring)
    circle, radii = seen_from.circle, seen_from.radii
    shortest_px = np.linalg.norm(circle, ord=-2, axis=(1, 2)) * np.pi * (radii.inner + radii.outer) / bits
    words, trust, phase = _read(np.nan_to_num(ring), bits)
    doubt = _misplaced(np.nan_to_num(rings), words, phase, bits) / (MISPLACED + MISPLACED_PX / shortest_px)
    trust &= doubt < 1
    number = number_of_word(words, bits)
    code = np.where((number > 0) & trust & quiet, number, UNREADABLE)
    code = np.where(np.isnan(ring).any(axis=1), CUT, code)
    turn = phase + 2 * np.pi / bits * _first_segment(words, bits)
    c, s = np.cos(turn), np.sin(turn)
    upright = np.stack([np.stack([c, s], -1), np.stack([s, -c], -1)], -2)  # rotation after turning y up into y down
    return code, np.where((code > 0)[:, None, None], circle @ upright, np.nan), doubt


def _misplaced(rings: np.ndarray, words: np.ndarray, phase: np.ndarray, bits: int) -> np.ndarray:
    """(n,) how far, in segments, the worst change between dark and bright lies from where the word has it, near the
    ring's inner edge or near its outer one. `rings` (r, n, bits * SAMPLES_A_SEGMENT) levels on several circles.

    Something dark in front of a dark target shows nowhere else than in the ends of the segments it hides.
    """
    k, n = SAMPLES_A_SEGMENT, len(words)
    start = np.rint(phase / (2 * np.pi) * bits * k).astype(int) - k // 2
    turned = np.take_along_axis(
        rings, ((start[:, None] + np.arange(bits * k)) % (bits * k))[None].repeat(len(rings), axis=0), axis=2
    )
    bit = (words[:, None] >> np.arange(bits - 1, -1, -1).astype(np.uint32)) & 1
    before = np.roll(bit, 1, axis=1)
    worst = np.zeros(n)
    for levels in turned:
        # From the middle of one segment to the middle of the next: half of it is bright where they differ. How bright
        # is asked of the segments' middles here, since light is seldom even.
        level = np.roll(levels, k // 2, axis=1).reshape(n, bits, k)[..., k // 2 - 2 : k // 2 + 2].mean(axis=2)
        level = np.roll(level, -1, axis=1)
        bright = np.maximum(np.where(bit, level, 0), np.where(before, np.roll(level, 1, axis=1), 0))
        bright = np.where(bright > 0, bright, bright.max(axis=1, keepdims=True))
        share = np.clip(levels.reshape(n, bits, k) / np.maximum(bright, 0.2)[..., None], 0, 1).mean(axis=2)
        off = share - (before + bit) / 2
        worst = np.maximum(worst, np.abs(off).max(axis=1))
    return worst


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
    x, y = (radius * _directions(count)).astype(plane.dtype).T
    return plane[:, :1] + plane[:, 1:2] * x + plane[:, 2:] * y


def _directions(count: int) -> np.ndarray:
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _first_segment(words: np.ndarray, bits: int) -> np.ndarray:
    """(n,) which segment as read begins the smallest rotation, the first where more than one does."""
    mask = np.uint32((1 << bits) - 1)
    turned = np.stack([((words << np.uint32(k)) | (words >> np.uint32(bits - k))) & mask for k in range(bits)], axis=1)
    return np.argmax(turned == smallest_rotation(words, bits)[:, None], axis=1)


def _read(ring: np.ndarray, bits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At the phase where the segments are clearest: words (n,), whether they explain the levels (n,), and the angle
    at which the first segment begins. `ring` (n, bits * SAMPLES_A_SEGMENT) levels, 0 dark, 1 as bright as the dot."""
    n, k = len(ring), SAMPLES_A_SEGMENT
    # Sums over the samples that begin at each place along the ring: of all phases at once.
    level = _boxes(np.roll(ring, -(k // 4), axis=1), k // 2).reshape(n, bits, k) / (k // 2)
    mean, square = (_boxes(values, k).reshape(n, bits, k) / k for values in (ring, ring * ring))
    noise = 2 * (square - mean**2).sum(axis=1)  # of whole segments: least where they begin and end as the ring's do
    best = np.argmax(np.abs(level - 0.5).sum(axis=1) - noise, axis=1)
    level = level[np.arange(n), :, best]
    profile = np.take_along_axis(ring, (best[:, None] + np.arange(bits * k)) % (bits * k), axis=1)

    # The ring may be brighter or darker than the dot: it has its own middle.
    top = np.clip(np.sort(level, axis=1)[:, -2:].mean(axis=1), 0, 3)
    middle = (np.clip(level.min(axis=1), -0.3, 0.3) + top) / 2
    word_bits = level > middle[:, None]
    words = (word_bits @ (1 << np.arange(bits - 1, -1, -1))).astype(np.uint32)
    margin = np.abs(level - middle[:, None]).min(axis=1)

    # Near a segment's ends a slightly wrong ellipse or perspective is felt; what hides a ring ends anywhere.
    within = np.tile((np.arange(k) >= k // 5) & (np.arange(k) < k - k // 5), bits)
    p = profile[:, within]
    p = p - p.mean(axis=1, keepdims=True)
    error, contrast = np.full(n, np.inf), np.zeros(n)
    for blur in BLURS:
        s = word_bits @ _blurred_segments(bits, blur)[:, within]
        s = s - s.mean(axis=1, keepdims=True)
        slope = (s * p).sum(axis=1) / np.maximum((s * s).sum(axis=1), 1e-9)
        rms = np.sqrt(np.mean((p - slope[:, None] * s) ** 2, axis=1))
        better = rms < error
        error, contrast = np.where(better, rms, error), np.where(better, slope, contrast)
    trust = (contrast > LEAST_LEVEL) & (margin > CLEAR * contrast) & (error < WORST_PROFILE * contrast)
    return words, trust, 2 * np.pi * best / (bits * k)


def _boxes(ring: np.ndarray, width: int) -> np.ndarray:
    """(n, m) sums of `width` samples from each on, around a ring (n, m)."""
    sums = np.cumsum(np.concatenate([np.zeros_like(ring[:, :1]), ring, ring[:, :width]], axis=1), axis=1)
    return sums[:, width:-1] - sums[:, : -width - 1]


def _blurred_segments(bits: int, blur: float) -> np.ndarray:
    """(bits, bits * SAMPLES_A_SEGMENT) levels along a ring of which only one segment is bright, for each segment."""
    k, wave = SAMPLES_A_SEGMENT, np.arange(bits * SAMPLES_A_SEGMENT // 2 + 1)
    spectrum = np.fft.rfft(np.repeat(np.eye(bits), k, axis=1), axis=1)
    return np.fft.irfft(spectrum * np.exp(-2 * (np.pi * wave * blur / bits) ** 2), bits * k, axis=1)
