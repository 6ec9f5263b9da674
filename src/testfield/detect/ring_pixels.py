"""What pixels see of a ring code: its bright segments' outline, led through a homography, blurred and gathered.

The same integral as for a disc (`disc.py`), along arcs and spokes. At their corners an outline is not smooth, so each
piece has its own Gauss-Legendre nodes, which are as exact there.
"""

from dataclasses import dataclass

import numpy as np

from testfield.detect.disc import SPACING, DiscPixels, disc_in_pixels
from testfield.targets.marks import RingRadii

LEAST_BLUR_PX = 0.35
"""Nodes are set for no sharper an image than this; below it the corners of a ring are right to a percent."""

DENSER = 1.15
"""Nodes a step of `SPACING`: they lie wider in a piece's middle than at its ends. Values are right to 3e-5."""


@dataclass(frozen=True)
class RingNodes:
    """Points (k, 2) on the outlines of all segments in dot radii (x from the centre to where the first begins, then
    clockwise in the image), tangents (k, 2) times the nodes' weights, and how much (bits, k) each counts when a segment
    is bright."""

    at: np.ndarray
    tangent: np.ndarray
    of_segment: np.ndarray


def ring_nodes(bits: int, radii: RingRadii, dot_radius_px: float, blur_px: float) -> RingNodes:
    """Nodes close enough for dots of up to `dot_radius_px` and a blur of at least `blur_px`."""
    step = SPACING * max(blur_px, LEAST_BLUR_PX)
    segment = 2 * np.pi / bits
    at, tangent, counts = [], [], []
    for radius, sense in ((radii.outer, 1.0), (radii.inner, -1.0)):
        t, w = _nodes(radius * segment * dot_radius_px / step)
        angle = segment * (np.arange(bits)[:, None] + t).ravel()
        round_ = np.column_stack([np.cos(angle), np.sin(angle)])
        at.append(radius * round_)
        along = np.column_stack([-round_[:, 1], round_[:, 0]])
        tangent.append(sense * radius * segment * np.tile(w, bits)[:, None] * along)
        counts.append(np.repeat(np.eye(bits), len(t), axis=1))
    t, w = _nodes((radii.outer - radii.inner) * dot_radius_px / step)
    angle = segment * np.repeat(np.arange(bits), len(t))
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    at.append(np.tile(radii.inner + (radii.outer - radii.inner) * t, bits)[:, None] * out)
    tangent.append((radii.outer - radii.inner) * np.tile(w, bits)[:, None] * out)
    # A spoke leads outwards along the segment that begins there, and back along the one that ends.
    counts.append(np.repeat(np.eye(bits) - np.roll(np.eye(bits), -1, axis=0), len(t), axis=1))
    return RingNodes(np.concatenate(at), np.concatenate(tangent), np.concatenate(counts, axis=1))


def _nodes(steps: float) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on 0 to 1."""
    t, w = np.polynomial.legendre.leggauss(int(np.ceil(DENSER * steps)) + 2)
    return (t + 1) / 2, w / 2


def bright_segments(words: np.ndarray, bits: int) -> np.ndarray:
    """(n, bits) 1.0 where a segment of a word is bright, the first one first."""
    return ((words[:, None] >> np.arange(bits - 1, -1, -1).astype(np.uint32)) & 1).astype(float)


def ring_in_pixels(
    nodes: RingNodes, bright: np.ndarray, homography: np.ndarray, blur_px: np.ndarray, half: int
) -> DiscPixels:
    """Pixel values (n, m, m) of the bright segments (n, bits), m = 2 `half` + 1; their derivatives by the blur, and
    (n, 2, m, m) by a shift along x and y. `homography` (n, 3, 3) leads the nodes to px about the window's middle."""
    n = len(bright)
    outline, tangent = ring_outline(nodes, bright, homography)
    points = outline.shape[1]
    moves = np.broadcast_to(np.eye(2)[None, :, None, :], (n, 2, points, 2))
    grid = np.broadcast_to(np.arange(-half, half + 1.0), (n, 2 * half + 1))
    return disc_in_pixels(outline, tangent * (points / (2 * np.pi)), moves, blur_px, grid, grid)


def ring_outline(nodes: RingNodes, bright: np.ndarray, homography: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, k, 2) on the outlines of the bright segments (n, bits) in px about the window's middle, whither
    `homography` (n, 3, 3) leads the nodes; and their tangents times the nodes' weights."""
    counts = bright @ nodes.of_segment
    # Where neighbouring segments are alike there is no outline; what is left is brought to one length.
    order = np.argsort(counts == 0, axis=1, kind="stable")[:, : int((counts != 0).sum(axis=1).max(initial=1))]
    at = np.concatenate([nodes.at, np.ones((len(nodes.at), 1))], axis=1)[order]
    drawn = np.einsum("nij,nkj->nki", homography, at)
    outline = drawn[..., :2] / drawn[..., 2:]
    along = np.einsum("nij,nkj->nki", homography[:, :, :2], nodes.tangent[order])
    tangent = (along[..., :2] - outline * along[..., 2:]) / drawn[..., 2:]
    return outline, tangent * np.take_along_axis(counts, order, axis=1)[..., None]
