"""Tags as OpenCV or pupil-apriltags reads them, and beside these the small, the steep and the blurred ones.

Both readers take each cell's level for itself, so they read no cells of less than some 2.5 px: of small tags, or of
large ones along the slant. Tags that do not touch anything are read as those that do (`touching_tags.py`) where neither
of them reads one.
"""

import cv2
import numpy as np

from testfield.detect.touching_tags import read_touching_tags
from testfield.targets.board_pattern import CORNERS_A_TAG, dictionary

REFINED_WITHIN_PX = 2
"""Half-width of the window in which OpenCV refines a tag's corner: a wider one sees the neighbour's corner where tags
are near each other, and ends between the two."""
SAME = 0.5
"""Two tags are one where their middles are nearer than this part of a side."""


def tag_detector(dictionary: cv2.aruco.Dictionary) -> cv2.aruco.ArucoDetector:
    """OpenCV's detector of a dictionary's tags."""
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.cornerRefinementWinSize = REFINED_WITHIN_PX
    return cv2.aruco.ArucoDetector(dictionary, settings)


def read_tags(image: np.ndarray, names: str) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (n,) and corners (n, 4, 2) px, in OpenCV's order, of a dictionary's tags in an image (h, w) uint8.

    Raises `ValueError` where there is no such dictionary."""
    quads, read, _ = tag_detector(dictionary(names)).detectMarkers(image)
    found = np.zeros(0, int) if read is None else np.asarray(read).ravel().astype(int)
    return with_small_tags(image, names, found, np.asarray(quads, float).reshape(-1, CORNERS_A_TAG, 2))


def with_small_tags(
    image: np.ndarray, names: str, numbers: np.ndarray, quads: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The `numbers` (n,) and corners `quads` (n, 4, 2) that somebody read in an image, and those of tags that stand
    where nothing was read."""
    more, corners = read_touching_tags(image, names, 1)
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0)
    gap = np.linalg.norm(corners.mean(axis=1)[:, None] - quads.mean(axis=1)[None], axis=2)
    new = gap.min(axis=1, initial=np.inf) > SAME * side
    return np.concatenate([numbers, more[new]]), np.concatenate([quads, corners[new]])
