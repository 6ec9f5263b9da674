"""Pictures of small boards of every kind, drawn as a camera without distortion sees them: their truth is exact."""

from dataclasses import dataclass

import cv2
import numpy as np

from testfield.detect.target_spec import TargetSpec
from testfield.seeds import generator
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.marks import USUAL, ring_radii
from testfield.targets.ring_code import word_of_number

FINER, FOCAL_PX, ROLL_DEG = 4, 900.0, 10.0
PAPER_DN, INK_DN = 200.0, 40.0
RING_BITS, RINGS = 14, (4, 2)
"""Ring codes: so many in a row, and rows."""
RING_PITCH = 4.0
"""From ring code to ring code, in diameters of the dot."""
MARGIN = 0.6
"""White around a board, in spacings."""


@dataclass(frozen=True)
class View:
    """How a board is seen: `size_px` of what its kind counts by (a dot, a square, a cell of a tag), `tilt_deg` of the
    board, `snr` contrast over a pixel's noise, `blur_px` of the optics."""

    size_px: float
    tilt_deg: float = 20.0
    snr: float = 30.0
    blur_px: float = 0.8


@dataclass(frozen=True)
class Drawn:
    """A picture (h, w) uint8 and what it shows: `number` (n,) of points, of tags or of codes, at `xy_px` (n, 2), each
    `across_px` (n,) wide."""

    image: np.ndarray
    number: np.ndarray
    xy_px: np.ndarray
    across_px: np.ndarray


def rings_board(first: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (n,) and middles (n, 2) of a board of ring codes, in diameters of their dots."""
    columns, rows = RINGS
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, (rows - 1) / 2 - np.arange(rows))
    return first + np.arange(columns * rows), RING_PITCH * np.column_stack([x.ravel(), y.ravel()])


def draw(spec: TargetSpec, pattern: BoardPattern | None, unit_mm: float, view: View, seed: int) -> Drawn:
    """A board as `view` has it. `unit_mm` is how large on the board what its kind counts by is; ring codes have no
    `pattern`, and dots of 1 mm."""
    random = generator(seed, f"bench/recall/{spec.kind}")
    first = int(random.integers(1, 300))
    if pattern is None:
        number, points = rings_board(first)
        half, across, pitch = np.abs(points).max(axis=0) + 1.5, np.full(len(points), 3.0), RING_PITCH
    else:
        tags = spec.kind in ("aprilgrid", "tags", "cctag")
        points = pattern.tag_middles_mm if tags else pattern.points_mm
        number = pattern.tags if tags else np.arange(len(points))
        width = pattern.mark_mm if tags or not pattern.has_corners else pattern.pitch_mm / 2
        half, across, pitch = pattern.half_mm, np.full(len(points), width), pattern.pitch_mm
    H, (wide, high) = _homography(half + MARGIN * pitch, view.size_px / unit_mm, view.tilt_deg, random)
    x, y = ((np.arange(n * FINER) + 0.5) / FINER - 0.5 for n in (wide, high))
    at = cv2.perspectiveTransform(np.stack(np.meshgrid(x, y), axis=-1), np.linalg.inv(H))
    ink = _rings(at, number, points) if pattern is None else _ink(at, pattern)
    share = ink.reshape(high, FINER, wide, FINER).mean(axis=(1, 3))
    board = (np.abs(at) < half + MARGIN * pitch).all(axis=-1).reshape(high, FINER, wide, FINER).mean(axis=(1, 3))
    level = board * (PAPER_DN - (PAPER_DN - INK_DN) * share) + (1 - board) * 0.5 * (PAPER_DN + INK_DN)
    image = exposed(level, view, random)
    xy = cv2.perspectiveTransform(points[None].astype(float), H)[0]
    depth = np.abs(np.column_stack([points, np.ones(len(points))]) @ H[2])
    scale = np.sqrt(abs(np.linalg.det(H)) / depth**3)
    return Drawn(image, number, xy, across * scale)


def exposed(level_dn: np.ndarray, view: View, random: np.random.Generator) -> np.ndarray:
    """(h, w) uint8: blurred, with noise."""
    noise = (PAPER_DN - INK_DN) / view.snr
    blurred = cv2.GaussianBlur(level_dn, (0, 0), view.blur_px)
    return (blurred + random.normal(0, noise, level_dn.shape)).round().clip(0, 255).astype(np.uint8)


def clutter(view: View, seed: int, size: tuple[int, int] = (480, 400)) -> np.ndarray:
    """(h, w) uint8 of boxes, discs, rings, stripes, letters and words of random bits in frames, on an uneven wall."""
    random = generator(seed, "bench/recall/clutter")
    wide, high = size
    level = np.full((high, wide), 0.5 * (PAPER_DN + INK_DN)) + np.linspace(-40, 40, wide)
    level = level.round().astype(np.uint8)
    for _ in range(40):
        x, y, a, b = (int(random.integers(0, n)) for n in (wide, high, 50, 50))
        ink = float(random.choice([INK_DN, PAPER_DN, random.uniform(INK_DN, PAPER_DN)]))
        match int(random.integers(0, 6)):
            case 0:
                cv2.rectangle(level, (x, y), (x + a, y + b), ink, -1)
            case 1:
                corners = np.array([x, y]) + random.integers(-25, 25, (4, 2))
                cv2.fillPoly(level, [corners.astype(np.int32)], ink)
            case 2:
                cv2.rectangle(level, (x, y), (x + a + 6, y + a + 6), PAPER_DN, max(a // 6, 1))
            case 3:
                cv2.putText(level, "aBR8&%"[int(random.integers(0, 6))], (x, y), 0, 0.4 + a / 25, ink, 1 + a // 12)
            case 4:
                for k in range(6):
                    cv2.line(level, (x + 6 * k, y), (x + 6 * k + b // 4, y + a), ink, 3)
            case _:
                word = np.pad(np.pad(random.integers(0, 2, (6, 6)), 1), 1, constant_values=1)
                tile = np.kron(INK_DN + (PAPER_DN - INK_DN) * word, np.ones((3 + a // 12,) * 2))
                part = level[y : y + len(tile), x : x + len(tile)]
                part[:] = tile[: part.shape[0], : part.shape[1]]
    return exposed(level.astype(float), view, random)


def _homography(
    half_mm: np.ndarray, px_a_mm: float, tilt_deg: float, random: np.random.Generator
) -> tuple[np.ndarray, tuple[int, int]]:
    """(3, 3) from the board's mm to px, and the size of the picture that holds the board."""
    tilt, roll = np.radians([tilt_deg, ROLL_DEG])
    turned = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    leant = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    R = turned @ leant @ np.diag([1, -1, -1])
    far = FOCAL_PX / px_a_mm
    H = np.diag([FOCAL_PX, FOCAL_PX, 1.0]) @ np.column_stack([R[:, 0], R[:, 1], [0, 0, far]])
    corners = cv2.perspectiveTransform(half_mm * np.array([[[1, 1], [1, -1], [-1, 1], [-1, -1.0]]]), H)[0]
    low, high = corners.min(axis=0), corners.max(axis=0)
    shift = 6 - low + random.uniform(0, 1, 2)
    size = np.ceil(high - low + 13).astype(int)
    return np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]]) @ H, (int(size[0]), int(size[1]))


def _ink(at: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    """(h, w) which places (h, w, 2) of a board are ink."""
    if pattern.discs is None and pattern.has_corners:
        return pattern.cells.at(at).astype(float)
    middles, radii, sign = pattern.points_mm, np.full(len(pattern.points_mm), pattern.mark_mm / 2), None
    if pattern.discs is not None:
        middles, radii, sign = pattern.discs.xy_mm, pattern.discs.radius_mm, pattern.discs.sign
    ink = np.zeros(at.shape[:2])
    for k, (middle, radius) in enumerate(zip(middles, radii, strict=True)):
        inside = ((at - middle) ** 2).sum(axis=-1) < radius**2
        ink += inside * (1 if sign is None else int(sign[k]))
    return ink


def _rings(at: np.ndarray, number: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """(h, w) ring codes around dots of diameter 1, their segments clockwise as the camera sees them."""
    shape = ring_radii(USUAL)
    inner, outer = shape.inner / 2, shape.outer / 2
    ink = np.zeros(at.shape[:2])
    for word, middle in zip(word_of_number(number, RING_BITS), middles, strict=True):
        dx, dy = np.moveaxis(at - middle, -1, 0)
        radius = np.hypot(dx, dy)
        segment = (np.mod(-np.arctan2(dy, dx) / (2 * np.pi), 1) * RING_BITS).astype(int).clip(0, RING_BITS - 1)
        bit = (int(word) >> (RING_BITS - 1 - segment)) & 1
        ink += (radius < 0.5) | ((radius > inner) & (radius < outer) & (bit == 1))
    return ink
