"""Sheets that are not flat: each mark on a flat piece of its own that leans as the places of its neighbours say.

A mark is small against the waves of a sheet, so the sheet under it is its tangent plane: that of least squares through
the mark and its nearest neighbours.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from testfield.errors import TestfieldError
from testfield.scene.board_parts import BoardPart

UNDER_PIECES_MM = 0.05
"""How far behind its lowest corner the ground of a wavy sheet lies."""
NEIGHBOURS = 5
"""Marks, the own one among them, through which a tangent plane goes."""
SEAM_MM = 0.02
"""Width of the seams between pieces: less than images show, and no piece's edge lies under another."""


@dataclass(frozen=True)
class Piece:
    """A piece of `size_mm`, its middle at `xyz_mm` (3,), with its own frame `R` (3, 3) on the board, and the place
    `mark_mm` (2,) of its mark."""

    xyz_mm: np.ndarray
    R: np.ndarray
    size_mm: tuple[float, float]
    mark_mm: np.ndarray

    @property
    def lowest_mm(self) -> float:
        """Height of its lowest corner."""
        return float(self.xyz_mm[2] - np.abs(self.R[2, :2]) @ np.array(self.size_mm) / 2)

    def placed(self, R: np.ndarray, t_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and place (3,) in the world of its board at `R`, `t_mm`."""
        return R @ self.R, R @ self.xyz_mm + t_mm


def marks_off(board: BoardPart, count: int, index: int) -> np.ndarray:
    """(count, 3) by how much the marks of board `index` of a scene lie off their nominal places, mm.

    Raises `TestfieldError` where the scene lists another number of them.
    """
    if board.marks_off_mm is None:
        return np.zeros((count, 3))
    if len(board.marks_off_mm) != count:
        raise TestfieldError(
            f"{len(board.marks_off_mm)} places for {count} marks", f"boards[{index}].marks_off_mm", f"give {count}"
        )
    return np.array(board.marks_off_mm, float)


def pieces(xy_mm: np.ndarray, height_mm: np.ndarray, size_mm: tuple[float, float]) -> list[Piece]:
    """The pieces of a board of `size_mm` on which marks at `xy_mm` (n, 2) and heights (n,) lie: each reaches half way
    to the nearest mark on either side, above and below, and to the edge of the board where there is none."""
    xyz, half = np.column_stack([xy_mm, height_mm]), np.array(size_mm) / 2
    near = cKDTree(xy_mm).query(xy_mm, k=min(NEIGHBOURS, len(xyz)))[1].reshape(len(xyz), -1)
    answer = []
    for k, place in enumerate(xyz):
        normal = _tangent(xyz[near[k]])
        x = np.array([1.0, 0, 0]) - normal[0] * normal
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(normal, x), normal])
        to = xy_mm - place[:2]
        reach = []
        for axis in (0, 1):
            beside = np.abs(to[:, axis]) > np.abs(to[:, 1 - axis])
            for sign in (-1, 1):
                there = sign * to[beside & (sign * to[:, axis] > 0), axis]
                reach.append(there.min() / 2 if len(there) else half[axis] - sign * place[axis])
        left, right, down, up = np.maximum(np.array(reach) - SEAM_MM / 2, SEAM_MM)
        middle = np.array([right - left, up - down]) / 2
        answer.append(Piece(place + R[:, :2] @ middle, R, (float(left + right), float(down + up)), -middle))
    return answer


def _tangent(xyz_mm: np.ndarray) -> np.ndarray:
    """(3,) the normal of the plane through points (n, 3); upright where they lie on one line."""
    A = np.column_stack([xyz_mm[:, :2] - xyz_mm[:, :2].mean(axis=0), np.ones(len(xyz_mm))])
    if np.linalg.matrix_rank(A) < 3:
        return np.array([0.0, 0, 1])
    slope = np.linalg.lstsq(A, xyz_mm[:, 2], rcond=None)[0]
    normal = np.array([-slope[0], -slope[1], 1.0])
    return np.asarray(normal / np.linalg.norm(normal))
