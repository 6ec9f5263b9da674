"""Read what surrounds a dot: nothing, a ring code, or something that makes it no target."""

import cv2
import numpy as np

from testfield.targets.ring_code import number_of_word, smallest_rotation

SAMPLES_A_SEGMENT = 16
GAP, RING, OUTSIDE = (1.5,), (2.3, 2.5, 2.7), (3.4,)
"""Radii, in dot radii, at which the gap, the ring and the quiet zone are sampled."""
CLEAR = 0.2
"""How far from one half, in units of the contrast, every segment's level must be."""


def decode(
    image_dn: np.ndarray,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    contrast_dn: np.ndarray,
    background_dn: np.ndarray,
    bits: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Read the rings of n dots from an image (h, w) float32 of bright marks; arguments as in `Centres`.

    Returns the code (n,): a number, 0 for a plain dot, -1 for an unreadable ring, -2 for surroundings that are no
    target's; and the affine map (n, 2, 2) from the target's plane (x right, y up, in dot radii; the code's first
    segment begins at +x) to px, NaN where there is no code or its word repeats itself and leaves the turn open.
    """
    if len(xy_px) == 0:
        return np.zeros(0, int), np.zeros((0, 2, 2))
    circle = _half_axes(moments_px2)

    def levels(radii: tuple[float, ...], count: int) -> np.ndarray:
        """(n, count) mean level over the radii at equal angles, clockwise in the image; 0 background, 1 dot."""
        angle = 2 * np.pi * (np.arange(count) + 0.5) / count
        total = np.zeros((len(xy_px), count))
        for radius in radii:
            at = xy_px[:, None, :] + radius * np.einsum(
                "nij,kj->nki", circle, np.column_stack([np.cos(angle), np.sin(angle)])
            )
            total += _remap(image_dn, at)
        return (total / len(radii) - background_dn[:, None]) / contrast_dn[:, None]

    gap = levels(GAP, 32)
    isolated = (gap.max(axis=1) < 0.5) & (np.abs(gap).mean(axis=1) < 0.25)
    ring = levels(RING, bits * SAMPLES_A_SEGMENT)
    outside = levels(OUTSIDE, 64)
    words, margin, phase = _read(ring, bits)
    quiet = (np.abs(outside) < 0.5).mean(axis=1) > 0.9
    number = number_of_word(words, bits)

    # Single samples may be bright where a neighbour's mark begins; a segment of a code is bright as a whole.
    code = np.where((number > 0) & (margin > CLEAR) & quiet, number, -1)
    plain = (np.abs(ring) < 0.5).mean(axis=1) > 1 - 0.7 / bits
    code = np.where(plain, 0, code)
    code = np.where(isolated, code, -2)
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
    """At the phase where the segments are clearest: words (n,), the least distance of a segment from one half, and
    the angle at which the first segment begins."""
    n = len(ring)
    k = SAMPLES_A_SEGMENT
    shifted = np.stack([np.roll(ring, -phase, axis=1) for phase in range(k)], axis=1).reshape(n, k, bits, k)
    inner = shifted[..., k // 4 : k - k // 4]
    level = inner.mean(axis=-1)
    noise = inner.var(axis=-1).sum(axis=-1)
    best = np.argmax(np.abs(level - 0.5).sum(axis=-1) - noise, axis=1)
    level = level[np.arange(n), best]
    powers = 1 << np.arange(bits - 1, -1, -1)
    words = ((level > 0.5) @ powers).astype(np.uint32)
    return words, np.abs(level - 0.5).min(axis=1), 2 * np.pi * best / (bits * k)


def _half_axes(moments_px2: np.ndarray) -> np.ndarray:
    """Symmetric (n, 2, 2) that maps the unit circle onto the ellipse without turning it."""
    values, vectors = np.linalg.eigh(4 * moments_px2)
    return (vectors * np.sqrt(np.maximum(values, 0))[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def _remap(image: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Bilinear values at (n, k, 2) pixels, in blocks that OpenCV's size limit allows."""
    at = at.astype(np.float32)
    out = np.empty(at.shape[:2], np.float32)
    for start in range(0, len(at), 8192):
        part = slice(start, start + 8192)
        out[part] = cv2.remap(image, at[part, :, 0], at[part, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return out
