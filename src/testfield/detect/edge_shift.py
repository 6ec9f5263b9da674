"""How far all black edges of a board lie from where its spacing says: ink spreads, cameras sharpen, white is clipped.

A corner where edges cross stays where it is; those of a square or a tag go outwards or inwards with its edges, all of
an image alike. The spacing of the squares is free of it, so the one shift of an image follows from the squares' sizes
against their spacing.
"""

import cv2
import numpy as np

FEWEST = 4
"""Squares below which nothing is told."""
AROUND = 9
"""Squares around each, itself among them, whose homography says where its corners belong."""
ROUNDS = 6
"""The homography takes up a small part of the shift; so often it is freed of it."""
SHARPEST = 0.1
"""No corner is sharper than one whose edges' normals have a cosine of this less 1."""
MADS_A_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, of a normal distribution."""


def edge_shift(board_mm: np.ndarray, xy_px: np.ndarray) -> tuple[float, float, np.ndarray]:
    """By how many px the edges of squares lie outside where their corners (n, 4, 2) in mm on the board and in the image
    have them, its standard uncertainty, and what it moves each corner by (n, 4, 2) px. Zeros where too few squares are
    there to tell."""
    n = len(board_mm)
    away = outwards(xy_px)
    if n < FEWEST:
        return 0.0, 0.0, np.zeros_like(xy_px)
    middle = board_mm.mean(axis=1)
    near = [np.argsort(np.linalg.norm(middle - at, axis=1), kind="stable")[:AROUND] for at in middle]
    shift, each = 0.0, np.zeros(n)
    for _ in range(ROUNDS):
        true = xy_px - shift * away
        for k in range(n):
            H, _ = cv2.findHomography(board_mm[near[k]].reshape(-1, 2), true[near[k]].reshape(-1, 2))
            if H is None:
                return 0.0, 0.0, np.zeros_like(xy_px)
            off = xy_px[k] - cv2.perspectiveTransform(board_mm[k][None], H)[0]
            each[k] = (off * away[k]).sum() / (away[k] ** 2).sum()
        shift = float(np.median(each))
    spread = MADS_A_SIGMA * float(np.median(np.abs(each - shift)))
    return shift, spread * float(np.sqrt(np.pi / 2 / n)), shift * away


def outwards(xy_px: np.ndarray) -> np.ndarray:
    """(n, 4, 2) where each corner of quadrangles, clockwise in the image, goes when both of its edges go 1 px out."""
    side = np.roll(xy_px, -1, axis=1) - xy_px
    side = side / np.linalg.norm(side, axis=2, keepdims=True)
    normal = np.stack([side[..., 1], -side[..., 0]], axis=-1)
    before = np.roll(normal, 1, axis=1)
    return np.asarray((normal + before) / np.maximum(1 + (normal * before).sum(axis=2, keepdims=True), SHARPEST))
