"""Public detectors of each kind of target, as functions from an image to numbers and places: OpenCV's with its
defaults, and `pupil_apriltags` and `aprilgrid` where they are installed."""

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import cv2
import numpy as np

from testfield.detect.target_spec import TargetSpec, parse_target
from testfield.targets.board_pattern import dictionary

Reading = tuple[np.ndarray, np.ndarray]
"""Numbers (n,) and places (n, 2) px."""
NOTHING: Reading = (np.zeros(0, int), np.zeros((0, 2)))
APRIL = "DICT_APRILTAG_36h11"


def of_kind(word: str) -> dict[str, Callable[[np.ndarray], Reading]]:
    """The public detectors of a kind by name; none where no package is at hand."""
    spec = parse_target(word)
    size = (spec.columns, spec.rows)
    match spec.kind:
        case "circles":
            return {"OpenCV findCirclesGrid": lambda image: _circles(image, size, cv2.CALIB_CB_SYMMETRIC_GRID)}
        case "acircles":
            return {"OpenCV findCirclesGrid": lambda image: _circles(image, size, cv2.CALIB_CB_ASYMMETRIC_GRID)}
        case "checkerboard":
            return {
                "OpenCV findChessboardCornersSB": lambda image: _grid(cv2.findChessboardCornersSB(image, size)),
                "OpenCV findChessboardCorners": lambda image: _grid(cv2.findChessboardCorners(image, size)),
            }
        case "charuco":
            return {"OpenCV CharucoDetector": lambda image: _charuco(image, spec)}
        case "apriltag":
            readers = {"OpenCV ArucoDetector": lambda image: _tags(image, 1)}
            return readers | ({"pupil_apriltags": _pupil} if find_spec("pupil_apriltags") else {})
        case "aprilgrid":
            readers = {"OpenCV ArucoDetector, 2 cells": lambda image: _tags(image, 2)}
            return readers | ({"aprilgrid": _aprilgrid} if find_spec("aprilgrid") else {})
    return {}


def _circles(image: np.ndarray, size: tuple[int, int], flags: int) -> Reading:
    return _grid(cv2.findCirclesGrid(image, size, flags=flags))


def _grid(found: Any) -> Reading:
    if not found[0]:
        return NOTHING
    xy = np.asarray(found[1], float).reshape(-1, 2)
    return np.arange(len(xy)), xy


def _charuco(image: np.ndarray, spec: TargetSpec) -> Reading:
    board = cv2.aruco.CharucoBoard(
        (spec.columns, spec.rows), spec.square_mm, spec.marker_mm, dictionary(spec.dictionary)
    )
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    if numbers is None or not len(numbers):
        return NOTHING
    return np.asarray(numbers).ravel(), np.asarray(corners, float).reshape(-1, 2)


def _tags(image: np.ndarray, border: int) -> Reading:
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = border
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    quads, numbers, _ = cv2.aruco.ArucoDetector(dictionary(APRIL), settings).detectMarkers(image)
    if numbers is None or not len(numbers):
        return NOTHING
    return np.asarray(numbers).ravel(), np.array([np.reshape(quad, (4, 2)).mean(axis=0) for quad in quads])


@cache
def _detector() -> Any:
    """Kept for good: its destructor damages the memory (`detect/opencv_boards.py`)."""
    from testfield.detect.opencv_boards import pupil

    return pupil("tag36h11")


def _pupil(image: np.ndarray) -> Reading:
    found = _detector().detect(np.ascontiguousarray(image))
    if not found:
        return NOTHING
    return np.array([tag.tag_id for tag in found]), np.array([np.mean(tag.corners, axis=0) for tag in found])


def _aprilgrid(image: np.ndarray) -> Reading:
    from aprilgrid import Detector

    found = Detector("t36h11").detect(image)
    if not found:
        return NOTHING
    corners = [np.asarray(tag.corners, float).reshape(4, 2).mean(axis=0) for tag in found]
    return np.array([tag.tag_id for tag in found]), np.array(corners)
