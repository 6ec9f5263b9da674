"""Read what surrounds a dot: nothing, a ring code, or something that makes it no target."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.detect.polar import in_contrasts, values_at
from testfield.detect.ring_reading import SAMPLES_A_SEGMENT, read_rings
from testfield.detect.screen import circles, half_axes_of
from testfield.targets.code_table import CodeTable, numbers_of
from testfield.targets.marks import RingRadii
from testfield.targets.ring_code import smallest_rotation

PLAIN, UNREADABLE, CROWDED, CUT = 0, -1, -2, -3
"""What `decode` says instead of a number: a plain dot; a ring that cannot be read; surroundings that are no target's;
a ring of which the image shows only a part."""
HOLE = 0.6
"""A plain dot has ground where a ring would be: bright in more than this part of all directions it is no dot."""
TO_SEE = 4
"""How densely a ring is sampled to see whether there is one, samples a segment."""
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
BATCH = 4096
"""Dots at a time: the levels about them fill no more memory than an image."""


def decode(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    background_dn: np.ndarray,
    bits: int,
    radii: RingRadii,
    codes: CodeTable | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read the rings of n dots from an image (h, w) float32 of bright marks; arguments as in `Centres`;
    `codes` a table of a maker's own, whose words have so many `bits`.

    Returns the code (n,): a number, or `PLAIN`, `UNREADABLE`, `CROWDED`, `CUT`; and the affine map (n, 2, 2) from the
    target's plane (x right, y up, in dot radii; the code's first segment begins at +x) to px, NaN where there is no
    code. A word that repeats itself leaves the turn open; the map is then one of several. Last the doubt (n,): how far
    the worst end of a bright part lies from where the word has it, in units of what is allowed.
    """
    n = len(xy_px)
    code, affine, doubt = np.full(n, PLAIN), np.full((n, 2, 2), np.nan), np.zeros(n)
    for start in range(0, n, BATCH):
        rows = slice(start, start + BATCH)
        places = xy_px[rows], half_axes_of(moments_px2[rows])
        seen = _surroundings(image_dn, *places, contrast_dn[rows], background_dn[rows], radii)
        code[rows], affine[rows], doubt[rows] = _decode(seen, bits, codes)
    return code, affine, doubt


@dataclass(frozen=True)
class _Surroundings:
    """The image about n dots, seen in units of their contrast: `xy_px` (n, 2), `circle` (n, 2, 2) half-axes, `ground`
    and `contrast` (n, 3) planes at the centre and their slopes a dot radius, `gap` (n, RAYS) levels half way from the
    dot to its ring. A level is 0 on the ground, and 1 as bright as the dot would be here."""

    image_dn: np.ndarray
    xy_px: np.ndarray
    circle: np.ndarray
    ground: np.ndarray
    contrast: np.ndarray
    gap: np.ndarray
    radii: RingRadii

    def only(self, mask: np.ndarray) -> "_Surroundings":
        return replace(
            self,
            xy_px=self.xy_px[mask],
            circle=self.circle[mask],
            ground=self.ground[mask],
            contrast=self.contrast[mask],
            gap=self.gap[mask],
        )

    def rings(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """(n, r, count) levels on several circles between the ring's edges, and (n, count) beyond the ring; at equal
        angles, clockwise in the image."""
        inner, outer = self.radii.inner, self.radii.outer
        radii = (*(inner + a * (outer - inner) for a in ACROSS), outer + 0.4)
        places = circles(radii, count)
        levels = values_at(self.image_dn, self.xy_px, self.circle, places)
        in_contrasts(levels, places, self.ground, self.contrast)
        levels = levels.reshape(-1, len(radii), count)
        return levels[:, :-1], levels[:, -1]


def _decode(seen_from: _Surroundings, bits: int, codes: CodeTable | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n = len(seen_from.xy_px)
    code, affine, doubt = np.full(n, CROWDED), np.full((n, 2, 2), np.nan), np.zeros(n)
    with np.errstate(invalid="ignore"):
        gap = seen_from.gap
        isolated = np.flatnonzero(~(gap > 0.5).any(axis=1) & (np.nan_to_num(np.abs(gap)).mean(axis=1) < 0.25))
        # A code has two opposite segments that are bright: half of the ring is enough to see that there is none.
        near = seen_from.only(isolated)
        rings, outside = near.rings(bits * TO_SEE)
        ring = rings.mean(axis=1)
        # What is bright beyond the ring too belongs to a neighbour.
        bright = (ring > 0.5) & ~(outside > 0.5)
        needed = 0.5 + 1 / bits if codes is None or codes.half_tells else 1 - 0.5 / TO_SEE / bits
        plain = (bright.sum(axis=1) < 0.7 * TO_SEE) & ((~np.isnan(ring)).mean(axis=1) > needed)
        # A disc in the middle of a bright surface is a ring's hole.
        hole = (ring > 0.5).sum(axis=1) > HOLE * np.maximum((~np.isnan(ring)).sum(axis=1), 1)
    code[isolated[plain & ~hole]] = PLAIN
    ringed = isolated[~plain]
    if len(ringed):
        code[ringed], affine[ringed], doubt[ringed] = _decode_rings(near.only(~plain), bits, codes)
    return code, affine, doubt


def _decode_rings(
    seen_from: _Surroundings, bits: int, codes: CodeTable | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rings, outside = seen_from.rings(bits * SAMPLES_A_SEGMENT)
    quiet = (np.abs(np.nan_to_num(outside)) < 0.5).mean(axis=1) > 0.85
    circle, radii = seen_from.circle, seen_from.radii
    shortest_px = np.linalg.norm(circle, ord=-2, axis=(1, 2)) * np.pi * (radii.inner + radii.outer) / bits
    words, begins, marks = read_rings(rings, bits)
    margin, error, contrast, misplaced = marks.T
    doubt = misplaced / (MISPLACED + MISPLACED_PX / shortest_px)
    trust = (contrast > LEAST_LEVEL) & (margin > CLEAR * contrast) & (error < WORST_PROFILE * contrast) & (doubt < 1)
    number = numbers_of(words, bits, codes)
    code = np.where((number > 0) & trust & quiet, number, UNREADABLE)
    code = np.where(np.isnan(rings).any(axis=(1, 2)), CUT, code)
    turn = 2 * np.pi / bits * (begins / SAMPLES_A_SEGMENT + _first_segment(words, number, bits, codes))
    c, s = np.cos(turn), np.sin(turn)
    upright = np.stack([np.stack([c, s], -1), np.stack([s, -c], -1)], -2)  # rotation after turning y up into y down
    return code, np.where((code > 0)[:, None, None], circle @ upright, np.nan), doubt


def _surroundings(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    circle: np.ndarray,
    contrast_dn: np.ndarray,
    background_dn: np.ndarray,
    radii: RingRadii,
) -> _Surroundings:
    """Light that slopes across a target slopes across its dot and its gap in proportion to their levels."""
    middle = (1 + radii.inner) / 2
    places = circles((middle, *DOT), RAYS)
    values = values_at(image_dn, xy_px, circle, places).reshape(-1, RAYS)
    # Of each circle the first harmonic; where the image cuts it, it is taken as level.
    moved = np.nan_to_num(2 / RAYS * values @ circles([1.0], RAYS).astype(np.float32)).reshape(len(xy_px), -1, 2)
    values = values.reshape(len(xy_px), -1)
    ground = np.column_stack([background_dn, moved[:, 0] / middle])
    step = (DOT[0] * moved[:, 1] + DOT[1] * moved[:, 2]) / (DOT[0] ** 2 + DOT[1] ** 2) - ground[:, 1:]
    steepest = np.linalg.norm(step, axis=1, keepdims=True) / np.maximum(contrast_dn[:, None], 1e-9)
    contrast = np.column_stack([contrast_dn, step * np.minimum(1, STEEPEST / np.maximum(steepest, 1e-9))])
    gap = np.ascontiguousarray(values[:, :RAYS])
    in_contrasts(gap, places[:RAYS], ground, contrast)
    return _Surroundings(image_dn, xy_px, circle, ground, contrast, gap, radii)


def _first_segment(words: np.ndarray, number: np.ndarray, bits: int, codes: CodeTable | None) -> np.ndarray:
    """(n,) which segment as read begins the word as printed, the first where more than one does; of words that are no
    code's that which begins the smallest rotation."""
    mask = np.uint32((1 << bits) - 1)
    turned = np.stack([((words << np.uint32(k)) | (words >> np.uint32(bits - k))) & mask for k in range(bits)], axis=1)
    printed = smallest_rotation(words, bits)
    if codes is not None and (number > 0).any():
        printed[number > 0] = codes.word_of_number(number[number > 0])
    return np.argmax(turned == printed[:, None], axis=1)
