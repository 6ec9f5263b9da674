"""Which pixels around a corner see nothing else of the print."""

import numpy as np

from testfield.detect.corner_model import HALF_PX, offsets_px
from testfield.targets.field import NominalBoard

AROUND = 8
"""Places around a pixel at which the print is looked at."""
NEAREST = 8
"""Known corners that tell where another one is."""
CLEAR_PX, CLEAR_OF_BLUR = 1.8, 2.8
"""Nothing but the two edges may be printed within this distance of a pixel that is used, in px and in sigmas."""


def clear_pixels(
    board: NominalBoard, corner_mm: np.ndarray, xy_px: np.ndarray, axes_px: np.ndarray, clear_px: float
) -> np.ndarray:
    """(n, k) which pixels of each corner's window see its own two edges alone, and paper all around."""
    pattern, n = board.pattern, len(corner_mm)
    assert pattern is not None
    assert board.size_mm is not None
    angle = 2 * np.pi * np.arange(AROUND) / AROUND
    ring = np.vstack([np.zeros((1, 2)), clear_px * np.column_stack([np.cos(angle), np.sin(angle)])])
    offset = (np.rint(xy_px) - xy_px)[:, None, None] + offsets_px()[:, None] + ring
    from_corner = np.einsum("nij,nkrj->nkri", np.linalg.inv(axes_px), offset)
    at = corner_mm[:, None, None] + from_corner
    own = corner_mm[:, None, None] + 0.01 * pattern.free_mm * np.where(from_corner < 0, -1, 1)
    same = pattern.cells.at(at) == pattern.cells.at(own)
    on_paper = (np.abs(at) < np.array(board.size_mm) / 2).all(axis=-1)
    return np.asarray((same & on_paper).all(axis=2).reshape(n, -1))


def covered(others_px: np.ndarray, xy_px: np.ndarray, clear_px: float) -> np.ndarray:
    """(n, k) which pixels of each corner's window lie in or near one of the convex quadrangles (m, 4, 2)."""
    at = np.rint(xy_px)[:, None] + offsets_px()
    covered = np.zeros(at.shape[:2], bool)
    for quad in others_px:
        side = np.roll(quad, -1, axis=0) - quad
        normal = np.column_stack([side[:, 1], -side[:, 0]]) / np.linalg.norm(side, axis=1)[:, None]
        normal *= np.sign(np.einsum("ki,ki->k", normal, quad.mean(axis=0) - quad))[:, None]  # inwards
        near = np.abs(xy_px - quad.mean(axis=0)).max(axis=1) < np.abs(quad - quad.mean(axis=0)).max() + 3 * HALF_PX
        inwards = np.einsum("nkji,ji->nkj", at[near][:, :, None] - quad, normal)
        covered[near] |= (inwards > -clear_px).all(axis=2)
    return covered
