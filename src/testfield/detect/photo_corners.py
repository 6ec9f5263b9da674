"""Corners that OpenCV found in a photograph, measured by the corner model where its pixels allow it.

Nobody described the sensor, so the noise is estimated from the image, and what the model leaves unexplained widens the
covariance. Where the model does not fit, OpenCV's place stays, without a covariance.
"""

from dataclasses import replace

import numpy as np

from testfield.camera.images import Frame
from testfield.camera.photograph import Photograph
from testfield.detect.noise import estimate_sheet
from testfield.detect.observations import Observations
from testfield.detect.square_boards import detect_squares
from testfield.detect.target_spec import TargetSpec
from testfield.targets.board_pattern import BoardPattern, dictionaries, dictionary
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

SAME_PX = 1.5
"""The model's corner is OpenCV's where it is this near."""
TAG_MM = 1.0


def with_covariance(photograph: Photograph, target: TargetSpec, found: Observations) -> Observations:
    """The corners `found` by OpenCV with the model's places, covariances and chi-squared where it fits."""
    boards = _boards(target, np.unique(found.code))
    if not boards or not len(found):
        return found
    sheet = estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn)
    corners, _ = detect_squares(Frame(photograph.name, photograph.pixels, sheet), Field(14, boards))
    corners = corners.measured
    if not len(corners):
        return found
    gap = np.linalg.norm(found.xy_px[:, None] - corners.xy_px[None], axis=2)
    same = gap.argmin(axis=1)
    near = gap.min(axis=1) < SAME_PX
    columns = {name: getattr(found, name).copy() for name in ("xy_px", "cov_px2", "moments_px2", "chi2")}
    for name, values in columns.items():
        values[near] = getattr(corners, name)[same[near]]
    return replace(found, **columns)


def _boards(target: TargetSpec, numbers: np.ndarray) -> tuple[NominalBoard, ...]:
    """What stands for the photograph's board; of tags, whose layout nobody told, a board each."""
    names = {name.upper(): name for name in dictionaries()}
    tags = target.dictionary.removeprefix("tag") if target.kind == "apriltag" else target.dictionary
    known = names.get((f"DICT_APRILTAG_{tags}" if target.kind == "apriltag" else tags).upper(), "")
    if target.kind == "checkerboard":
        pattern = BoardPattern("checkerboard", target.columns + 1, target.rows + 1, target.square_mm)
        return (_board(pattern, 2 * pattern.half_mm),)
    if target.kind == "charuco" and known:
        pattern = BoardPattern(
            "charuco", target.columns, target.rows, target.square_mm, target.marker_mm, known
        )  # fmt: skip
        return (_board(pattern, 2 * pattern.half_mm),)
    if target.kind not in ("aruco", "apriltag") or not known:
        return ()
    # A tag has at least a cell of white around it.
    quiet = TAG_MM * (1 + 2 / (int(dictionary(known).markerSize) + 2))
    return tuple(
        _board(BoardPattern("tags", 1, 1, 2 * TAG_MM, TAG_MM, known, int(k)), np.full(2, quiet)) for k in numbers
    )


def _board(pattern: BoardPattern, size_mm: np.ndarray) -> NominalBoard:
    n = len(pattern.points_mm)
    marks = Marks(pattern.points_mm, np.full(n, pattern.free_mm), np.zeros(n, int))
    return NominalBoard(pattern.kind, marks, 0.0, 0.0, pattern, (float(size_mm[0]), float(size_mm[1])))
