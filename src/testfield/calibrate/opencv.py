"""OpenCV's calibration as an opponent: every board in every image is a view of its own."""

from collections.abc import Sequence

import cv2
import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.edges import Edges, board_edges, left_out
from testfield.calibrate.homography import focal_length, image_middle
from testfield.calibrate.lens_start import lens_start
from testfield.calibrate.rows import best_board, on_one_board, usable_rows
from testfield.calibrate.views import Cameras, from_views
from testfield.camera.interior import Interior, check_held, parameter_names
from testfield.camera.lens import NamesElsewhere, lens_model, lens_names
from testfield.camera.pose import Poses
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
LEAST_VIEWS = 2
FISHEYE, RATIONAL = "fisheye", "rational"
"""Names of OpenCV's models beside its plain one (`NamesElsewhere.name`)."""
OTHER_MODELS = cv2.CALIB_FIX_K4 | cv2.CALIB_FIX_K5 | cv2.CALIB_FIX_K6 | cv2.CALIB_FIX_S1_S2_S3_S4
"""Held by name: OpenCV 5's calibration with a released object estimates the sensor's tilt, asked for or not."""


@register("calibrators", "opencv")
def opencv(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    board: str | None = None,
) -> Calibration:
    """`cv2.calibrateCamera` (`cv2.fisheye.calibrate` for a fisheye) on all boards, or on the one called `board`.

    OpenCV takes each board in each image as a view with a pose of its own, all marks as exact and all pixels as equally
    good, and centres of discs as projections of centres. Stations and boards are its poses chained along the strongest
    tree. Raises `TestfieldError` for fewer than two views, and for a lens that OpenCV does not have.
    """
    rows, turned_down, notes = usable_rows(observations, field)
    if board is not None:
        rows, field = on_one_board(rows, field, best_board(rows, field, board))
    edges, why, said = board_edges(rows, field, image_middle(width_px, height_px))
    turned_down, notes = turned_down + left_out(rows, field, why), notes + said
    if len(edges) < LEAST_VIEWS:
        raise TestfieldError("OpenCV needs two views of boards, and there is one", do="add stations")
    objects, images = views_of(edges, rows, field)
    start, free = first_guess(edges, width_px, height_px, lens, hold)
    if names_of(lens).name == FISHEYE:
        interior, poses = _fisheye(objects, images, start, free)
    else:
        found = cv2.calibrateCamera(
            objects,
            images,
            (width_px, height_px),
            start.matrix,
            coefficients_of(start),
            flags=flags_of(lens, hold) | cv2.CALIB_USE_INTRINSIC_GUESS,
            criteria=CRITERIA,
        )
        interior, poses = camera_of(start, found[1], found[2]), poses_of(found[3], found[4])
    return from_views(
        "opencv", Cameras.one(interior, len(rows.stations)), free, poses, edges, rows, field, turned_down, notes
    )


def names_of(lens: str) -> NamesElsewhere:
    """What OpenCV calls a lens model. Raises `TestfieldError` where it has no such lens."""
    names = lens_model(lens).in_opencv
    if names is None:
        others = [name for name in lens_names() if lens_model(name).in_opencv]
        raise TestfieldError(f"OpenCV has no lens '{lens}'", "measure.lens", f"choose one of {', '.join(others)}")
    return names


def views_of(edges: Edges, rows: Observations, field: Field) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Object points (k, 3) and pixels (k, 2) of every edge, in single precision: OpenCV takes no other."""
    objects, images = [], []
    for e, here in enumerate(edges.rows):
        xy = field.boards[edges.board[e]].marks.xy_mm[rows.point[here]]
        objects.append(np.column_stack([xy, np.zeros(len(xy))]).astype(np.float32))
        images.append(rows.xy_px[here].astype(np.float32))
    return objects, images


def first_guess(
    edges: Edges, width_px: int, height_px: int, lens: str, hold: tuple[str, ...]
) -> tuple[Interior, np.ndarray]:
    """A camera with the homographies' focal length, and which parameters are to be estimated."""
    names_of(lens)
    names = parameter_names(lens)
    check_held(hold, lens)
    middle = image_middle(width_px, height_px)
    focal = focal_length(edges.homography, middle)
    free = np.array([name not in hold for name in names])
    plain = Interior(width_px, height_px, np.array([focal, focal, *middle, *[0.0] * (len(names) - 4)]), lens)
    return lens_start(plain, free, edges.lens), free


def flags_of(lens: str, hold: tuple[str, ...]) -> int:
    """OpenCV's flags that estimate a lens with the coefficients in `hold` at zero."""
    flags = cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL if names_of(lens).name == RATIONAL else OTHER_MODELS
    flags |= cv2.CALIB_FIX_TAUX_TAUY
    for name in hold:
        if name.startswith("k"):
            flags |= getattr(cv2, f"CALIB_FIX_{name.upper()}")
    for group, flag in (
        (("p1", "p2"), cv2.CALIB_ZERO_TANGENT_DIST),
        (("s1", "s2", "s3", "s4"), cv2.CALIB_FIX_S1_S2_S3_S4),
    ):
        held = set(group) & set(hold)
        if held and held != set(group):
            raise TestfieldError(f"OpenCV holds {', '.join(group)} only together", "measure.hold", "name all or none")
        flags |= flag if held else 0
    return flags


def coefficients_of(interior: Interior) -> np.ndarray:
    """The coefficients in OpenCV's order."""
    given = dict(zip(interior.names, interior.parameters, strict=True))
    return np.array([given[name] for name in names_of(interior.model).coefficients])


def camera_of(start: Interior, matrix: np.ndarray, coefficients: np.ndarray) -> Interior:
    """The camera of OpenCV's matrix and coefficients."""
    given = dict(zip(names_of(start.model).coefficients, np.ravel(coefficients), strict=False))
    pinhole = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    return start.with_parameters(np.array(pinhole + [given[name] for name in start.names[4:]], float))


def poses_of(turns: Sequence, shifts: Sequence) -> Poses:
    """Poses of OpenCV's rotation vectors and translations."""
    return Poses(np.array([cv2.Rodrigues(v)[0] for v in turns]), np.array([np.ravel(t) for t in shifts], float))


def _fisheye(
    objects: list[np.ndarray], images: list[np.ndarray], start: Interior, free: np.ndarray
) -> tuple[Interior, Poses]:
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    for k, name in enumerate(start.names[4:], 4):
        flags |= 0 if free[k] else getattr(cv2, f"CALIB_FIX_{name.upper()}")
    try:
        found = cv2.fisheye.calibrate(
            [o[None].astype(float) for o in objects],
            [i[None].astype(float) for i in images],
            (start.width_px, start.height_px),
            start.matrix,
            start.parameters[4:, None].copy(),
            flags=flags,
            criteria=CRITERIA,
        )
    except cv2.error as error:
        raise TestfieldError(f"OpenCV's fisheye calibration failed ({' '.join(str(error).split())[:120]})") from error
    _, matrix, coefficients, turns, shifts = found
    pinhole = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    return start.with_parameters(np.array([*pinhole, *np.ravel(coefficients)], float)), poses_of(turns, shifts)
