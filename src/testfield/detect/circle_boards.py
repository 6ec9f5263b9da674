"""Names for the dots of boards that have nothing but circles: symmetric, asymmetric and hexagonal grids, RUNE-Tags."""

from collections.abc import Callable

import cv2
import numpy as np

from testfield.detect.circle_grid import order_grid
from testfield.detect.hexagonal_grid import order_hexagonal
from testfield.detect.rune_dots import name_rune
from testfield.registry import known_of
from testfield.targets.board_pattern import BoardKind, BoardPattern
from testfield.targets.field import Field


def name_circles(
    xy_px: np.ndarray, diameter_px: np.ndarray, free: np.ndarray, field: Field, crowded: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Board (n,) and point (n,) index, -1 for none, of the dots (n, 2) px that are `free` (n,); on a RUNE-Tag also of
    those that are `crowded` (n,) by others.

    A grid is named only where all of it is seen but for a few dots, a RUNE-Tag where half of it is. A symmetric grid is
    taken to stand upright.
    """
    board, point = np.full(len(xy_px), -1), np.full(len(xy_px), -1)
    # The largest first: a small one would be found within it.
    size = [0 if sheet.pattern is None else sheet.pattern.columns * sheet.pattern.rows for sheet in field.boards]
    for b in sorted(range(len(size)), key=lambda b: -size[b]):
        sheet = field.boards[b]
        if sheet.pattern is None or sheet.has_corners:
            continue
        usable = free | crowded if sheet.pattern.of_kind.on_circles else free
        left = np.flatnonzero(usable & (board == -1))
        own = known_of("boards", sheet.pattern.kind, "name")
        name = own or _finder(sheet.pattern.of_kind)
        number = name(xy_px[left], diameter_px[left], sheet.pattern)
        board[left[number >= 0]] = b
        point[left[number >= 0]] = number[number >= 0]
    return board, point


def _finder(kind: BoardKind) -> Callable:
    if kind.on_circles:
        return name_rune
    if kind.hexagonal:
        return _hexagonal
    return _asymmetric if kind.staggered else _symmetric


def _symmetric(xy_px: np.ndarray, diameter_px: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    return _row_by_row(order_grid(xy_px, diameter_px, pattern.columns, pattern.rows), pattern)


def _hexagonal(xy_px: np.ndarray, diameter_px: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    return _row_by_row(order_hexagonal(xy_px, diameter_px, pattern.columns, pattern.rows), pattern)


def _row_by_row(place: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    return np.where(place[:, 0] >= 0, place[:, 1] * pattern.columns + place[:, 0], -1)


def _asymmetric(xy_px: np.ndarray, diameter_px: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    """By OpenCV's grid finder on the centres that were measured."""
    number = np.full(len(xy_px), -1)
    count = pattern.columns * pattern.rows
    if len(xy_px) < count:
        return number
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID
    candidates = xy_px.astype(np.float32)[:, None]
    for how in (flags, flags | cv2.CALIB_CB_CLUSTERING):
        try:
            # Points instead of an image, and no blob detector: the grid alone is looked for.
            found, centres = cv2.findCirclesGrid(  # type: ignore[call-overload]
                candidates, (pattern.columns, pattern.rows), how, None, cv2.CirclesGridFinderParameters()
            )
        except cv2.error:
            continue
        if not found:
            continue
        gap = np.linalg.norm(np.asarray(centres, float).reshape(-1, 1, 2) - xy_px[None], axis=2)
        rows = gap.argmin(axis=1)
        order = _front(xy_px[rows], pattern)
        if len(set(rows.tolist())) == count and order is not None:
            number[rows] = order
            return number
    return number


def _front(xy_px: np.ndarray, pattern: BoardPattern) -> np.ndarray | None:
    """(n,) numbers of the points in the found order, or in the reverse: whichever fits and is not mirrored."""
    numbers = np.arange(len(xy_px))
    best, least = None, np.inf
    for order in (numbers, numbers[::-1]):
        points = pattern.points_mm[order]
        H, _ = cv2.findHomography(points, xy_px)
        if H is None or np.linalg.det(H[:2, :2] - np.outer(H[:2, 2], H[2, :2])) >= 0:
            continue
        miss = float(np.abs(cv2.perspectiveTransform(points[None], H)[0] - xy_px).max())
        if miss < least:
            best, least = order, miss
    return best
