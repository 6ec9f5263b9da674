"""From plane-to-image homographies to a first focal length and first poses (METHODS section 4.2)."""

import cv2
import numpy as np

from testfield.camera.pose import nearest_rotation
from testfield.errors import TestfieldError

LONGEST = 50.0
"""Focal length over the image's width beyond which no camera is."""


def plane_homography(plane_mm: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """(3, 3) that maps plane points (n, 2) to pixels (n, 2), n >= 4, by least squares."""
    homography, _ = cv2.findHomography(plane_mm, xy_px)
    if homography is None:
        raise TestfieldError("the points of a board lie on a line", do="leave this board out")
    return homography


def image_middle(width_px: int, height_px: int) -> np.ndarray:
    """(2,) px where a principal point is looked for first."""
    return np.array([(width_px - 1) / 2, (height_px - 1) / 2])


def focal_length(homographies: np.ndarray, middle_px: np.ndarray) -> float:
    """Focal length in px from homographies (n, 3, 3), the principal point taken in the image's middle.

    Zhang's two constraints for each homography are linear in 1 / f^2.
    """
    h = homographies.copy()
    h[:, :2] -= middle_px[:, None] * h[:, 2:]
    h /= np.linalg.norm(h[:, :2, :2], axis=(1, 2), keepdims=True)
    h1, h2 = h[:, :, 0], h[:, :, 1]
    image = np.concatenate([(h1[:, :2] * h2[:, :2]).sum(1), (h1[:, :2] ** 2 - h2[:, :2] ** 2).sum(1)])
    depth = np.concatenate([h1[:, 2] * h2[:, 2], h1[:, 2] ** 2 - h2[:, 2] ** 2])
    # Robust against single bad homographies: the median of the equations that say anything, weighted by how much.
    strong = np.abs(depth) > 0.05 * np.abs(depth).max()
    ratio, weight = -image[strong] / depth[strong], np.abs(depth[strong])
    positive = ratio > 0
    order = np.argsort(ratio[positive])
    ratio, weight = ratio[positive][order], weight[positive][order]
    focal = float(np.sqrt(ratio[np.searchsorted(np.cumsum(weight), weight.sum() / 2)])) if positive.any() else np.inf
    if focal > LONGEST * 2 * middle_px.max():  # what noise makes of views that say nothing
        raise TestfieldError(
            "the focal length cannot be found: every view sees the boards face on",
            do="add stations that look obliquely",
        )
    return focal


def plane_pose(homography: np.ndarray, focal_px: float, middle_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camera-from-plane rotation and translation of one homography."""
    h = homography.copy()
    h[:2] -= middle_px[:, None] * h[2:]
    h[:2] /= focal_px
    h *= 2 / (np.linalg.norm(h[:, 0]) + np.linalg.norm(h[:, 1]))
    if h[2, 2] < 0:
        h = -h
    R = nearest_rotation(np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])]))
    return R, h[:, 2]
