"""Tags whose corners touch other black: Kalibr's AprilGrid, with a black square at every corner of a tag.

OpenCV's finder follows the outline of what is black, and such a board is one outline; which tags it still finds is
chance, and their corners are some pixels off. Here what is black is thinned by a pixel first, which parts squares that
touch at a point, and a tag is the convex hull of what then hangs together by sides. Its corners are where straight
lines along its sides meet (`tag_sides.py`), and of cells that are large enough where edges cross in the image itself.

Cells of few pixels, on small tags or steep ones, are thinned away in whole pixels. So small tags are looked for once
more in the image doubled, between whose pixels a level still has a course.
"""

import cv2
import numpy as np

from testfield.detect.tag_bits import read_bits, words_of
from testfield.detect.tag_sides import straightened
from testfield.targets.board_pattern import CORNERS_A_TAG

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
DOUBLED_CELL_PX = 4.0
"""Up to this size of cells tags are looked for in the image doubled."""
DOUBLED_WINDOWS_PX, DOUBLED_THINNED_PX = (15, 31), (1,)
"""Neighbourhoods and thinnings there: four times the pixels cost as much, and others find next to nothing more."""
REFINED_CELLS, REFINED_PX, REFINED_CELL_PX = 0.8, (2, 6), 3.0
"""Half-width of the window in which a corner is refined, in cells, and its limits; and from which size of cells: the
window sees the edges of a smaller one's neighbours."""
SAME = 0.3
"""Two quadrangles are one where their middles are nearer than this part of a side."""


def read_touching_tags(image: np.ndarray, names: str, border_cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (n,) and corners (n, 4, 2) px, in OpenCV's order, of the tags of a dictionary in an image (h, w) uint8.

    Raises `ValueError` where there is no such dictionary.
    """
    side = int(np.sqrt(words_of(names).shape[2])) + 2 * border_cells
    numbers, corners, wrong = _read(image, names, border_cells, np.inf)
    if min(image.shape) >= side:
        doubled = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
        fine = _read(doubled, names, border_cells, 2 * DOUBLED_CELL_PX * side)
        numbers, wrong = np.concatenate([numbers, fine[0]]), np.concatenate([wrong, fine[2]])
        corners = np.concatenate([corners, (fine[1] + 0.5) / 2 - 0.5])
    kept = _once(corners, wrong)
    return numbers[kept], _refined(image, corners[kept], side)


def _read(image: np.ndarray, names: str, border: int, most_px: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers (n,), corners (n, 4, 2) and wrong bits (n,) of tags of up to `most_px` a side, some of them twice."""
    side = int(np.sqrt(words_of(names).shape[2])) + 2 * border
    ways = (WINDOWS_PX, THINNED_PX) if np.isinf(most_px) else (DOUBLED_WINDOWS_PX, DOUBLED_THINNED_PX)
    quads = straightened(image, quadrangles(image, LEAST_CELL_PX * side, most_px, *ways), side)
    height, width = image.shape
    quads = quads[((quads >= 1) & (quads <= [width - 2, height - 2])).all(axis=(1, 2))]
    cells = np.array([_cells(image, quad, side) for quad in quads]).reshape(-1, side, side)
    rim = np.ones((side, side), bool)
    rim[border:-border, border:-border] = False
    mixed = cells[:, ~rim].max(axis=1, initial=0) > cells[:, rim].mean(axis=1)
    quads, cells = quads[mixed], cells[mixed]
    number, turns, wrong = read_bits(cells, names, border)
    good = np.flatnonzero(number >= 0)
    turned = [np.roll(quads[k], turns[k], axis=0) for k in good]
    return number[good], np.array(turned).reshape(-1, CORNERS_A_TAG, 2), wrong[good]


def quadrangles(
    image: np.ndarray,
    least_px: float,
    most_px: float = np.inf,
    windows_px: tuple[int, ...] = WINDOWS_PX,
    thinned_px: tuple[int, ...] = THINNED_PX,
) -> np.ndarray:
    """(n, 4, 2) corners of all dark quadrangles of `least_px` to `most_px` a side in an image (h, w) uint8, clockwise
    in the image; the same one is there once for every window that shows it."""
    found: list[np.ndarray] = []
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    for window in windows_px:
        if window >= min(image.shape):
            break
        dark = cv2.adaptiveThreshold(
            image, 1, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, window | 1, float(DARKER)
        )
        for thinned in thinned_px:
            thin = cv2.erode(dark, cross, iterations=thinned)
            found += _parts(thin, thinned, least_px, most_px)
    return np.array(found).reshape(-1, CORNERS_A_TAG, 2)


def _parts(dark: np.ndarray, thinned: int, least_px: float, most_px: float) -> list[np.ndarray]:
    """Quadrangles of what hangs together by sides."""
    found = []
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    short, long = boxes[:, 2:4].min(axis=1), boxes[:, 2:4].max(axis=1)
    of_size = (short >= least_px) & (boxes[:, 4] >= 2 * least_px) & (long <= np.sqrt(2) * most_px)
    for k in 1 + np.flatnonzero(of_size[1:]):
        left, top, width, height, _ = boxes[k]
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


def _once(corners: np.ndarray, wrong: np.ndarray) -> np.ndarray:
    """Rows without those that another window found too, of which the one with fewer `wrong` bits stays."""
    middle = corners.mean(axis=1)
    kept: list[int] = []
    for k in np.argsort(wrong, kind="stable"):
        side = np.linalg.norm(corners[k] - np.roll(corners[k], 1, axis=0), axis=1).min()
        if not any(np.linalg.norm(middle[j] - middle[k]) < max(SAME * side, 3.0) for j in kept):
            kept.append(int(k))
    return np.array(sorted(kept), int)


def _refined(image: np.ndarray, corners: np.ndarray, cells: int) -> np.ndarray:
    """(n, 4, 2) the corners where edges cross, of large enough cells."""
    refined = corners.copy()
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    for k, quad in enumerate(corners):
        cell = np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).min() / cells
        if cell < REFINED_CELL_PX:
            continue
        half = int(np.clip(round(REFINED_CELLS * cell), *REFINED_PX))
        better = cv2.cornerSubPix(
            image, np.ascontiguousarray(quad, np.float32)[:, None].copy(), (half, half), (-1, -1), until
        ).reshape(-1, 2)
        near = np.linalg.norm(better - quad, axis=1) < half
        refined[k, near] = better[near]
    return refined
