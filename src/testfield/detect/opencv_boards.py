"""Boards people own: ChArUco, ArUco, AprilTag, checkerboard and circle grids, by OpenCV's own detectors.

They state no covariance (`photo_corners.py` adds one). All coordinates have the centre of the top-left pixel at (0, 0).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from testfield.detect.target_spec import TargetSpec
from testfield.errors import TestfieldError

CORNERS_A_TAG = 4


@dataclass(frozen=True)
class Corners:
    """Points of a board, n rows: `xy_px` (n, 2); `code` (n,) the number of the tag a point belongs to, -1 for none;
    `point` (n,) its index on the board or, of a tag, which corner; `place` (n, 2) column and row, -1 where there is
    none; `disc` whether the points are discs' centres; `notes` what was done."""

    xy_px: np.ndarray
    code: np.ndarray
    point: np.ndarray
    place: np.ndarray
    disc: bool = False
    notes: tuple[str, ...] = ()


def detect_board(pixels: np.ndarray, spec: TargetSpec) -> Corners:
    """Find a board in a grey image (h, w) float32. Nothing found is an empty result.

    Raises `TestfieldError` where the dictionary is unknown.
    """
    image = eight_bits(pixels)
    if min(image.shape) < 8:
        return _empty()
    find = {
        "charuco": _charuco, "aruco": _aruco, "apriltag": _apriltag,
        "checkerboard": _checkerboard, "acircles": _asymmetric_circles,
    }[spec.kind]  # fmt: skip
    try:
        return find(image, spec)
    except cv2.error as error:
        return _empty((f"OpenCV gave up: {' '.join(str(error).split())[:120]}",))


def _charuco(image: np.ndarray, spec: TargetSpec) -> Corners:
    size = (spec.columns, spec.rows)
    board = cv2.aruco.CharucoBoard(size, spec.square_mm, spec.marker_mm, _dictionary(spec.dictionary))
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    if numbers is None or len(numbers) == 0:
        return _empty()
    point = np.asarray(numbers).ravel().astype(int)
    place = np.column_stack([point % (spec.columns - 1), point // (spec.columns - 1)])
    return Corners(_points(corners), np.full(len(point), -1), point, place)


def _aruco(image: np.ndarray, spec: TargetSpec) -> Corners:
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, numbers, _ = cv2.aruco.ArucoDetector(_dictionary(spec.dictionary), settings).detectMarkers(image)
    if numbers is None or len(numbers) == 0:
        return _empty()
    return _tags(np.asarray(corners).reshape(-1, CORNERS_A_TAG, 2), np.asarray(numbers).ravel())


def _apriltag(image: np.ndarray, spec: TargetSpec) -> Corners:
    family = spec.dictionary.removeprefix("tag")
    try:
        from pupil_apriltags import Detector
    except ImportError:
        found = _aruco(image, TargetSpec("aruco", dictionary=f"DICT_APRILTAG_{family}"))
        return Corners(**(vars(found) | {"notes": (*found.notes, "by OpenCV; pupil-apriltags is not installed")}))
    try:
        detector = Detector(families=f"tag{family}")
    except Exception as error:  # the library raises bare exceptions
        raise TestfieldError(f"no AprilTag family is called '{family}'", "--target", "try apriltag:36h11") from error
    tags = detector.detect(image)
    if not tags:
        return _empty()
    # The library counts from the corner of the first pixel.
    corners = np.array([tag.corners for tag in tags]) - 0.5
    return _tags(corners, np.array([tag.tag_id for tag in tags]), ("by pupil-apriltags",))


def _checkerboard(image: np.ndarray, spec: TargetSpec) -> Corners:
    found, corners = cv2.findChessboardCornersSB(image, (spec.columns, spec.rows), flags=cv2.CALIB_CB_ACCURACY)
    return _grid(corners, spec) if found else _empty()


def _asymmetric_circles(image: np.ndarray, spec: TargetSpec) -> Corners:
    settings = cv2.SimpleBlobDetector.Params()
    settings.maxArea = 0.02 * image.size
    settings.minArea = 12
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
    for picture in (image, 255 - image):
        found, centres = cv2.findCirclesGrid(
            picture, (spec.columns, spec.rows), flags=flags, blobDetector=cv2.SimpleBlobDetector.create(settings)
        )
        if found:
            return Corners(**(vars(_grid(centres, spec)) | {"disc": True}))
    return _empty()


def _grid(corners: np.ndarray, spec: TargetSpec) -> Corners:
    point = np.arange(spec.columns * spec.rows)
    place = np.column_stack([point % spec.columns, point // spec.columns])
    return Corners(_points(corners), np.full(len(point), -1), point, place)


def _tags(corners: np.ndarray, numbers: np.ndarray, notes: tuple[str, ...] = ()) -> Corners:
    n = len(numbers)
    point = np.tile(np.arange(CORNERS_A_TAG), n)
    code = np.repeat(numbers.astype(int), CORNERS_A_TAG)
    return Corners(corners.reshape(-1, 2).astype(float), code, point, np.full((len(point), 2), -1), notes=notes)


def _points(corners: np.ndarray) -> np.ndarray:
    return np.asarray(corners, float).reshape(-1, 2)


def _empty(notes: tuple[str, ...] = ()) -> Corners:
    none = np.zeros(0, int)
    return Corners(np.zeros((0, 2)), none, none, np.zeros((0, 2), int), notes=notes)


def eight_bits(pixels: np.ndarray) -> np.ndarray:
    """OpenCV's detectors take bytes: black to the brightest pixels but one in a thousand."""
    low, high = float(pixels.min()), float(np.percentile(pixels, 99.9))
    return np.clip((pixels - low) * (255 / max(high - low, 1e-6)), 0, 255).astype(np.uint8)


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    known = [word for word in dir(cv2.aruco) if word.startswith("DICT_")]
    match = {word.upper(): word for word in known}.get(name.upper())
    if match is None:
        raise TestfieldError(f"no dictionary is called '{name}'", "--target", f"choose one of {', '.join(known)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, match))
