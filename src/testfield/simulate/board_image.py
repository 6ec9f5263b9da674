"""Boards of squares and tags drawn into an image by their pattern alone, without a scene or a renderer."""

import cv2
import numpy as np

from testfield.targets.board_pattern import BoardPattern


def draw_board(
    pattern: BoardPattern,
    size_px: tuple[int, int],
    to_px: np.ndarray,
    blur_px: float = 0.7,
    fine: int = 4,
    black_and_white: tuple[float, float] = (30.0, 200.0),
) -> np.ndarray:
    """(h, w) float64 of a print of squares and tags: `size_px` width and height, `to_px` (3, 3) the homography from mm
    on the board to px; each pixel is the mean of `fine` x `fine` points, blurred by `blur_px`."""
    width, height = size_px
    x, y = np.meshgrid((np.arange(width * fine) + 0.5) / fine - 0.5, (np.arange(height * fine) + 0.5) / fine - 0.5)
    at = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(to_px).T
    black = pattern.cells.at(at[..., :2] / at[..., 2:])
    level = np.where(black, *(float(v) for v in black_and_white))
    image = cv2.resize(level, (width, height), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px else image


def facing(px_a_mm: float, middle_px: tuple[float, float], turn_deg: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    """(3, 3) homography that shows a board (y up) from its front, its middle at a place (y down), turned clockwise,
    with a perspective that grows by `tilt` a mm."""
    a = np.radians(turn_deg)
    turn = np.array([[np.cos(a), np.sin(a)], [np.sin(a), -np.cos(a)]])
    H = np.eye(3)
    H[:2, :2], H[2, 0] = px_a_mm * turn, tilt
    shift = np.eye(3)
    shift[:2, 2] = middle_px
    return np.asarray(shift @ H)
