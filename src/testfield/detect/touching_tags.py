"""Tags whose corners touch other black: Kalibr's AprilGrid, with a black square at every corner of a tag.

OpenCV's finder follows the outline of what is black, and such a board is one outline; which tags it still finds is
chance, and their corners are some pixels off. Here what is black is thinned by a pixel first, which parts squares that
touch at a point, and a tag is the convex hull of what then hangs together by sides. Corners are refined where edges
cross in the image itself.
"""

from functools import cache

import cv2
import numpy as np

from testfield.targets.board_pattern import CORNERS_A_TAG, dictionary

WINDOWS_PX = (7, 15, 31, 61)
"""Widths of the neighbourhoods with whose mean a pixel is compared: a small one parts small tags, and of a large tag
it leaves the outline."""
DARKER = 7
"""By how much a dark pixel is darker than the mean, of 255."""
THINNED_PX = (1, 2)
"""By how much what is dark is thinned: twice where blur and a level have made the bridge at a corner wider."""
LEAST_CELL_PX = 1.5
STRAIGHT = 0.04
"""How far the outline of a tag may be from a quadrangle, in parts of its length."""
CELL_SAMPLES = 4
WRONG_BORDER, WRONG_BITS = 0.03, 2
"""What may be read wrongly of a tag: a part of its border's cells, and some of its bits. A random 6 x 6 word is within
two bits of one of 36h11 with a probability of 2e-5."""
ROUNDS = 4
LEAST_RANGE = 12.0
"""Difference of black and white within a tag below which nothing is read, of 255."""
REFINED_CELLS, REFINED_PX = 0.8, (2, 6)
"""Half-width of the window in which a corner is refined, in cells, and its limits."""
SAME = 0.3
"""Two quadrangles are one where their corners are nearer than this part of a side."""


def read_touching_tags(image: np.ndarray, names: str, border_cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (n,) and corners (n, 4, 2) px, in OpenCV's order, of the tags of a dictionary in an image (h, w) uint8.

    Raises `ValueError` where there is no such dictionary.
    """
    words = _words(names)
    side = int(np.sqrt(words.shape[2])) + 2 * border_cells
    quads = _quadrangles(image, side)
    numbers, corners = [], []
    for quad in quads:
        read = _number(_cells(image, quad, side), words, border_cells)
        if read is not None:
            number, turns = read
            numbers.append(number)
            corners.append(np.roll(quad, turns, axis=0))
    if not numbers:
        return np.zeros(0, int), np.zeros((0, CORNERS_A_TAG, 2))
    found, where = np.array(numbers), np.array(corners)
    kept = _once(found, where)
    return found[kept], _refined(image, where[kept], side)


@cache
def _words(names: str) -> np.ndarray:
    """(4, n, bits) what all tags of a dictionary show row by row, white 1, turned k times by a quarter clockwise."""
    tags = dictionary(names)
    side = int(tags.markerSize)
    shown = [tags.generateImageMarker(k, side + 2)[1:-1, 1:-1] > 0 for k in range(len(tags.bytesList))]
    return np.array([[np.rot90(one, -k).ravel() for one in shown] for k in range(4)])


def _quadrangles(image: np.ndarray, cells: int) -> np.ndarray:
    """(n, 4, 2) corners of all dark quadrangles, clockwise in the image."""
    found: list[np.ndarray] = []
    least = LEAST_CELL_PX * cells
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    for window in WINDOWS_PX:
        if window >= min(image.shape):
            break
        dark = cv2.adaptiveThreshold(
            image, 1, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, window | 1, float(DARKER)
        )
        for thinned in THINNED_PX:
            thin = cv2.erode(dark, cross, iterations=thinned)
            found += _parts(thin, thinned, least)
    return np.array(found).reshape(-1, CORNERS_A_TAG, 2)


def _parts(dark: np.ndarray, thinned: int, least_px: float) -> list[np.ndarray]:
    """Quadrangles of what hangs together by sides."""
    found = []
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    for k in range(1, count):
        left, top, width, height, area = boxes[k]
        if min(width, height) < least_px or area < 2 * least_px:
            continue
        part = (labels[top : top + height, left : left + width] == k).astype(np.uint8)
        outlines, _ = cv2.findContours(part, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=(left, top))
        quad = _quadrangle(max(outlines, key=len), thinned)
        if quad is not None:
            found.append(quad)
    return found


def _quadrangle(outline: np.ndarray, thinned: int) -> np.ndarray | None:
    """(4, 2) corners of an outline, clockwise in the image, moved out by the pixels that thinning took."""
    hull = cv2.convexHull(outline)
    quad = cv2.approxPolyDP(hull, STRAIGHT * cv2.arcLength(hull, True), True).reshape(-1, 2).astype(float)
    if len(quad) != CORNERS_A_TAG:
        return None
    area = cv2.contourArea(quad.astype(np.float32), oriented=True)
    if abs(area) < 1 or cv2.contourArea(hull) < 0.85 * abs(area):
        return None
    quad = quad if area > 0 else quad[::-1]
    outwards = quad - quad.mean(axis=0)
    return np.asarray(quad + 1.4 * thinned * outwards / np.linalg.norm(outwards, axis=1)[:, None])


def _cells(image: np.ndarray, quad: np.ndarray, cells: int) -> np.ndarray:
    """(cells, cells) mean level of each cell of a tag, from its middle."""
    size = cells * CELL_SAMPLES
    square = np.array([[0, 0], [size, 0], [size, size], [0, size]], np.float32) - 0.5
    turned = cv2.getPerspectiveTransform(quad.astype(np.float32), square)
    seen = cv2.warpPerspective(image, turned, (size, size)).reshape(cells, CELL_SAMPLES, cells, CELL_SAMPLES)
    return np.asarray(seen[:, 1:-1, :, 1:-1].mean(axis=(1, 3)))


def _number(cells: np.ndarray, words: np.ndarray, border: int) -> tuple[int, int] | None:
    """Which tag the cells show, and how many corners it is turned by; None where they show none."""
    low, high = cells.min(), cells.max()
    if high - low < LEAST_RANGE:
        return None
    level = (low + high) / 2
    for _ in range(ROUNDS):  # halfway between the means of the dark and of the bright (Ridler and Calvard 1978)
        level = (cells[cells <= level].mean() + cells[cells > level].mean()) / 2
    white = cells > level
    inner = white[border:-border, border:-border]
    around = white.size - inner.size
    if white.sum() - inner.sum() > WRONG_BORDER * around:
        return None
    wrong = (words != inner.ravel()).sum(axis=2)
    turns, number = np.unravel_index(wrong.argmin(), wrong.shape)
    return (int(number), -int(turns)) if wrong[turns, number] <= WRONG_BITS else None


def _once(numbers: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Rows without those that another window found too: the same number at the same place."""
    kept: list[int] = []
    for k in range(len(numbers)):
        side = np.linalg.norm(corners[k] - np.roll(corners[k], 1, axis=0), axis=1).min()
        same = [
            j
            for j in kept
            if numbers[j] == numbers[k] and np.abs(corners[j] - corners[k]).max() < max(SAME * side, 3.0)
        ]
        if not same:
            kept.append(k)
    return np.array(kept)


def _refined(image: np.ndarray, corners: np.ndarray, cells: int) -> np.ndarray:
    """(n, 4, 2) the corners where edges cross."""
    refined = corners.copy()
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    for k, quad in enumerate(corners):
        cell = np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).min() / cells
        half = int(np.clip(round(REFINED_CELLS * cell), *REFINED_PX))
        better = cv2.cornerSubPix(
            image, np.ascontiguousarray(quad, np.float32)[:, None].copy(), (half, half), (-1, -1), until
        ).reshape(-1, 2)
        near = np.linalg.norm(better - quad, axis=1) < half
        refined[k, near] = better[near]
    return refined
