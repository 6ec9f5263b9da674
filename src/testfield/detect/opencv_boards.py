"""Boards people own: ChArUco, ArUco, AprilTag, checkerboard and circle grids, by OpenCV's own detectors.

They state no covariance (`photo_corners.py` adds one). All coordinates have the centre of the top-left pixel at (0, 0).
"""

import atexit
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import cv2
import numpy as np

from testfield.camera.plane_image import as_others_say
from testfield.detect.eight_bits import pictures
from testfield.detect.lone_squares import read_lone_squares
from testfield.detect.small_tags import read_tags, with_small_tags
from testfield.detect.target_spec import TargetSpec
from testfield.detect.touching_tags import read_touching_tags
from testfield.errors import TestfieldError
from testfield.targets.board_pattern import CORNERS_A_TAG, dictionary

CHECKERBOARD_TRIALS = 4
"""OpenCV's checkerboard finder draws at random, and now and then it returns points that are no grid."""
OLDER_WITHIN_PX = 4
"""Half-width of the window in which the older finder's corners are refined: it leaves them 3 px off."""
UNTIL = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
PUPIL_CORNERS = [1, 0, 3, 2]
"""pupil-apriltags' corners in the order of the print that OpenCV makes: clockwise from its top left."""
PUPIL_CORNERS_OF_MAKERS = [3, 2, 1, 0]
"""The same where OpenCV has no such tags and the makers' print counts."""


@dataclass(frozen=True)
class Corners:
    """Points of a board, n rows: `xy_px` (n, 2); `code` (n,) the number of the tag a point belongs to, -1 for none;
    `point` (n,) its index on the board or, of single tags, which corner; `place` (n, 2) column and row, -1 for none;
    `disc` whether the points are discs' centres; `inverted` whether the print is white on black; `legacy` whether
    it is a ChArUco of OpenCV before 4.6; `size` columns and rows as they were read; `border` cells of a tag's border;
    `notes` what was done."""

    xy_px: np.ndarray
    code: np.ndarray
    point: np.ndarray
    place: np.ndarray
    disc: bool = False
    inverted: bool = False
    legacy: bool = False
    size: tuple[int, int] | None = None
    border: int = 1
    notes: tuple[str, ...] = ()


def detect_board(pixels: np.ndarray, spec: TargetSpec) -> Corners:
    """Find a board in a grey image (h, w) float32. Nothing found is an empty result.

    Raises `TestfieldError` where the dictionary is unknown.
    """
    if min(pixels.shape) < 8:
        return _empty()
    best = _empty()
    for picture in pictures(pixels):
        for image, inverted in ((picture, False), (255 - picture, True)):
            found = _find(image, spec)
            if inverted and len(found.code):
                found = replace(found, inverted=True, notes=(*found.notes, "printed white on black, read inverted"))
            if len(found.code) > len(best.code) or (found.notes and not best.notes and not len(best.code)):
                best = found
            if len(best.code):
                break
        if 0 < len(best.code) == _all_points(spec):
            break
    return best


def _find(image: np.ndarray, spec: TargetSpec) -> Corners:
    find = {
        "charuco": _charuco,
        "aruco": _aruco,
        "apriltag": _apriltag,
        "aprilgrid": _april_grid,
        "tags": _tag_board,
        "checkerboard": _checkerboard,
        "squares": _lone_squares,
        "acircles": _asymmetric_circles,
    }[spec.kind]
    try:
        return find(image, spec)
    except cv2.error as error:
        return _empty((f"OpenCV gave up: {' '.join(str(error).split())[:120]}",))


def _all_points(spec: TargetSpec) -> int:
    """How many points a board has, 0 where nobody said: of single tags."""
    if spec.kind == "charuco":
        return (spec.columns - 1) * (spec.rows - 1)
    if spec.kind in ("aprilgrid", "tags", "squares"):
        return CORNERS_A_TAG * spec.columns * spec.rows
    return spec.columns * spec.rows


def _charuco(image: np.ndarray, spec: TargetSpec) -> Corners:
    """As it was asked for; where that reads less than all, as OpenCV printed boards before 4.6, or columns and rows
    exchanged, whichever reads most."""
    best = _empty()
    tags = read_tags(image, _name(spec.dictionary))
    for columns, rows in dict.fromkeys([(spec.columns, spec.rows), (spec.rows, spec.columns)]):
        for legacy in (False, True) if rows % 2 == 0 else (False,):
            found = _charuco_of((columns, rows), legacy, image, spec, tags)
            if len(found.code) > len(best.code):
                best = found
            if 0 < len(best.code) == _all_points(spec):
                return best
    return best


def _charuco_of(
    size: tuple[int, int], legacy: bool, image: np.ndarray, spec: TargetSpec, tags: tuple[np.ndarray, np.ndarray]
) -> Corners:
    board = cv2.aruco.CharucoBoard(size, spec.square_mm, spec.marker_mm, dictionary(_name(spec.dictionary)))
    board.setLegacyPattern(legacy)
    corners, numbers = _interpolated(image, board, *tags)
    if numbers is None or len(numbers) == 0:
        return _empty()
    notes = ["as OpenCV printed such boards before 4.6"] if legacy else []
    if size != (spec.columns, spec.rows):
        notes.append(f"read as {size[0]} x {size[1]} squares, {spec.columns} x {spec.rows} were asked for")
    point = np.asarray(numbers).ravel().astype(int)
    place = np.column_stack([point % (size[0] - 1), point // (size[0] - 1)])
    none = np.full(len(point), -1)
    return Corners(_points(corners), none, point, place, legacy=legacy, size=size, notes=tuple(notes))


def _interpolated(
    image: np.ndarray, board: cv2.aruco.CharucoBoard, numbers: np.ndarray, quads: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """What OpenCV makes of tags that were read: corners between them and their numbers. Those are left out that it
    refined to where neither the tags nor the other corners have them."""
    mine = np.isin(numbers, np.asarray(board.getIds()).ravel())
    if not mine.any():
        return np.zeros((0, 2)), None
    given = [quad[None].astype(np.float32) for quad in quads[mine]], numbers[mine].astype(np.int32)[:, None]
    corners, found, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(
        image, markerCorners=given[0], markerIds=given[1]
    )
    if found is None or not len(found):
        return np.zeros((0, 2)), None
    corners, found = _points(corners), np.asarray(found).ravel()
    printed = dict(zip(np.asarray(board.getIds()).ravel().tolist(), board.getObjPoints(), strict=True))
    of_tags = np.concatenate([np.asarray(printed[number]) for number in numbers[mine].tolist()])[:, :2]
    of_corners = np.asarray(board.getChessboardCorners())[found, :2]
    both = np.concatenate([of_corners, of_tags]).astype(float), np.concatenate([corners, quads[mine].reshape(-1, 2)])
    there = as_others_say(both, (image.shape[1], image.shape[0]))[: len(found)]
    return corners[there], found[there]


def _aruco(image: np.ndarray, spec: TargetSpec) -> Corners:
    numbers, corners = read_tags(image, _name(spec.dictionary))
    return _tags(corners, numbers) if len(numbers) else _empty()


def _tag_board(image: np.ndarray, spec: TargetSpec) -> Corners:
    """Those tags that the board has, each point by its index on the board; a number that is read twice is nobody's."""
    found = _aruco(image, spec)
    tag = found.code - spec.first
    number, count = np.unique(found.code[::CORNERS_A_TAG], return_counts=True)
    mine = (tag >= 0) & (tag < spec.columns * spec.rows) & np.isin(found.code, number[count == 1])
    return replace(
        found,
        xy_px=found.xy_px[mine],
        code=found.code[mine],
        point=(CORNERS_A_TAG * tag + found.point)[mine],
        place=found.place[mine],
    )


def _apriltag(image: np.ndarray, spec: TargetSpec) -> Corners:
    family = spec.dictionary.removeprefix("tag")
    ours = TargetSpec("aruco", dictionary=f"DICT_APRILTAG_{family}")
    known = ours.dictionary.upper() in (name.upper() for name in dir(cv2.aruco))
    detector = pupil(f"tag{family}")
    if detector is None and known:
        found = _aruco(image, ours)
        return replace(found, notes=(*found.notes, "by OpenCV; pupil-apriltags is not installed or lacks the family"))
    if detector is None:
        raise TestfieldError(f"no AprilTag family is called '{family}'", "--target", "try apriltag:36h11")
    tags = detector.detect(image)
    # The library counts pixels from the corner of the first one, and a tag's corners anticlockwise from the bottom left
    # of the makers' print; OpenCV prints its tags turned by half against theirs.
    order = PUPIL_CORNERS if known else PUPIL_CORNERS_OF_MAKERS
    corners = np.array([tag.corners for tag in tags]).reshape(-1, CORNERS_A_TAG, 2)[:, order] - 0.5
    numbers, read = np.array([tag.tag_id for tag in tags], int), len(tags)
    if known:
        numbers, corners = with_small_tags(image, _name(ours.dictionary), numbers, corners)
    notes = ("by pupil-apriltags",) if read else ()
    return _tags(corners, numbers, notes) if len(numbers) else _empty()


def _april_grid(image: np.ndarray, spec: TargetSpec) -> Corners:
    """The corners of the tags that were read, with the border, of two cells as Kalibr prints it or of one, that reads
    more."""
    best = _empty()
    for border in (2, 1):
        found = _april_grid_of(border, image, spec)
        if len(found.code) > len(best.code):
            best = found
        if len(best.code) == _all_points(spec):
            break
    return best


def _april_grid_of(border: int, image: np.ndarray, spec: TargetSpec) -> Corners:
    pattern = spec.pattern(border)
    numbers, quads = read_touching_tags(image, pattern.names, border)
    mine = np.isin(numbers, pattern.tags)
    numbers, quads = numbers[mine], quads[mine]
    once = np.isin(numbers, [k for k in np.unique(numbers) if (numbers == k).sum() == 1])
    board, corners = pattern.tag_corners_mm[numbers[once]].reshape(-1, 2), quads[once].reshape(-1, 2)
    if len(board) > CORNERS_A_TAG:
        there = as_others_say((board, corners), (image.shape[1], image.shape[0]))
        there = there.reshape(-1, CORNERS_A_TAG).all(axis=1).repeat(CORNERS_A_TAG)
        board, corners = board[there], corners[there]
    gap = np.linalg.norm(board[:, None] - pattern.points_mm[None], axis=2).reshape(len(board), len(pattern.points_mm))
    point = gap.argmin(axis=1) if len(board) else np.zeros(0, int)
    place = np.column_stack([point % (2 * spec.columns), point // (2 * spec.columns)])
    notes = () if border == 2 else ("tags with a border of one cell; Kalibr prints two",)
    return Corners(corners, np.full(len(point), -1), point, place, border=border, notes=notes if len(point) else ())


@cache
def pupil(family: str) -> Any | None:
    """The library's detector of a family, None where there is no library or no such family in it.

    It is kept, and never let go: its destructor damages the memory, and the process dies of that sooner or later.
    """
    try:
        from pupil_apriltags import Detector

        detector = Detector(families=family)
    except Exception:  # the library raises bare exceptions
        return None
    atexit.register(setattr, detector, "tag_detector_ptr", None)  # which its destructor then leaves alone
    return detector


def checkerboards(image: np.ndarray, columns: int, rows: int) -> Iterator[np.ndarray]:
    """What OpenCV takes for `columns` x `rows` inner corners in an image (h, w) uint8, (n, 2) px row by row, until one
    suits the caller: it may be no grid.

    The finder by sectors draws at random: from a numbered seed, so that the same image gives the same points. Where it
    finds only what does not suit, OpenCV's older finder is asked, which goes another way; where it finds nothing
    neither is asked again, as they may search for minutes.
    """
    for seed in range(CHECKERBOARD_TRIALS):
        cv2.setRNGSeed(1 + seed)
        found, corners = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            return
        yield _points(corners)
    found, corners = cv2.findChessboardCorners(image, (columns, rows))
    if found:
        yield _points(cv2.cornerSubPix(image, corners, (OLDER_WITHIN_PX, OLDER_WITHIN_PX), (-1, -1), UNTIL))


def _checkerboard(image: np.ndarray, spec: TargetSpec) -> Corners:
    """The first grid whose points all lie where a plane and a lens have them; where none does (a board may be bent, a
    lens extreme), the first found."""
    found = []
    for corners in checkerboards(image, spec.columns, spec.rows):
        if as_others_say((_places(spec).astype(float), corners), (image.shape[1], image.shape[0])).all():
            return _grid(corners, spec)
        found.append(corners)
    return _grid(found[0], spec) if found else _empty()


def _lone_squares(image: np.ndarray, spec: TargetSpec) -> Corners:
    """Four corners a square, clockwise from its top left, by a finder of our own."""
    columns, rows = spec.upright
    square, corners = read_lone_squares(image, columns, rows, spec.square_mm / spec.marker_mm)
    tag = square[:, 1] * columns + square[:, 0]
    point = (CORNERS_A_TAG * tag[:, None] + np.arange(CORNERS_A_TAG)).ravel()
    place = (2 * square[:, None] + [[0, 0], [1, 0], [1, 1], [0, 1]]).reshape(-1, 2)
    return Corners(corners.reshape(-1, 2), np.full(len(point), -1), point, place)


def _asymmetric_circles(image: np.ndarray, spec: TargetSpec) -> Corners:
    settings = cv2.SimpleBlobDetector.Params()
    settings.maxArea = 0.02 * image.size
    settings.minArea = 12
    settings.minDistBetweenBlobs = 3
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
    found, centres = cv2.findCirclesGrid(
        image, (spec.columns, spec.rows), flags=flags, blobDetector=cv2.SimpleBlobDetector.create(settings)
    )
    return replace(_grid(centres, spec), disc=True) if found else _empty()


def _grid(corners: np.ndarray, spec: TargetSpec) -> Corners:
    place = _places(spec)
    return Corners(_points(corners), np.full(len(place), -1), np.arange(len(place)), place)


def _places(spec: TargetSpec) -> np.ndarray:
    """(n, 2) column and row of every point of a grid, row by row."""
    point = np.arange(spec.columns * spec.rows)
    return np.column_stack([point % spec.columns, point // spec.columns])


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


def _name(name: str) -> str:
    """A dictionary's name as OpenCV writes it."""
    known = [word for word in dir(cv2.aruco) if word.startswith("DICT_")]
    match = {word.upper(): word for word in known}.get(name.upper())
    if match is None:
        raise TestfieldError(f"no dictionary is called '{name}'", "--target", f"choose one of {', '.join(known)}")
    return match
