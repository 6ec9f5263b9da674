"""A camera that somebody else calibrated: its file, and everything that it does not say, by resection.

The file is JSON: `interior` as in calibration.json, and as far as they are known `labels` with `covariance` of its
parameters, and the exterior orientations `stations`, alone or with the poses of `boards`. Where these are missing, each
board in each image is resected with the camera as it is given, and images and boards are chained along the strongest
tree.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pydantic

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.calibration_file import PoseTable
from testfield.calibrate.edges import Edges, board_edges, left_out
from testfield.calibrate.homography import image_middle
from testfield.calibrate.rows import usable_rows
from testfield.calibrate.views import from_views
from testfield.camera.circle import disc_centre_px
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import plane_of, project_camera
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError, speaking
from testfield.store.sheets import Finite, Sheet, array, checked, covariance, read_json, unique
from testfield.targets.field import Field

PASSES = 3
"""Resections of a board: what a disc's image adds to its centre's projection follows from the pose before."""
LEAST_MARKS = 4
RESECTED = "exterior orientations and boards by resection with the camera as it was given; no covariance is stated"
GIVEN = "exterior orientations and boards as they were given"


class _Camera(Sheet):
    interior: dict[str, Any]
    labels: tuple[str, ...] = ()
    covariance: tuple[tuple[Finite, ...], ...] = ()
    stations: dict[str, PoseTable] = pydantic.Field(default_factory=dict)
    boards: dict[str, PoseTable] = pydantic.Field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_camera(path: Path, observations: Observations, field: Field, method: str) -> Calibration:
    """The calibration of a camera file, or of a whole calibration.json, for these observations.

    Raises `TestfieldError` where the file is none, or its camera is of another size than the field sheet's.
    """
    found = _whole(path) or _from(path, observations, field, method)
    if field.cameras and (found.interior.width_px, found.interior.height_px) != field.cameras[0].size_px:
        width, height = field.cameras[0].size_px
        raise TestfieldError(
            f"the camera has {found.interior.width_px} x {found.interior.height_px} px, the images {width} x {height}",
            f"{path}, interior.width_px",
            "calibrate these images",
        )
    return replace(found, method=method)


@speaking("camera")
def _whole(path: Path) -> Calibration | None:
    """The file as a calibration.json, if it is one."""
    return Calibration.load(path) if "station_names" in read_json(path) else None


def _from(path: Path, observations: Observations, field: Field, method: str) -> Calibration:
    interior, sheet = _camera_in(path)
    rows, turned_down, notes = usable_rows(observations, field)
    edges, why, said = board_edges(rows, field, image_middle(interior.width_px, interior.height_px))
    turned_down, notes = turned_down + left_out(rows, field, why), [*notes, *said, *sheet.notes]
    poses, keep = _resected(interior, edges, rows, field)
    if not keep.any():
        raise TestfieldError(
            "no board can be resected with this camera", str(path), "look at its focal length, principal point and lens"
        )
    held = np.zeros(len(interior.parameters), bool)
    found = from_views(method, interior, held, poses[keep], edges.take(keep), rows, field, turned_down, notes)
    if sheet.stations:
        found = _with_given(found, sheet, path)
    said_u = covariance(sheet.covariance, "covariance", len(sheet.labels)) if sheet.labels else np.zeros((0, 0))
    note = GIVEN if sheet.stations else RESECTED
    found = _with_residuals(found, edges.take(keep), rows, field)
    return replace(found, labels=tuple(sheet.labels), covariance=said_u, notes=(*found.notes[:-1], note))


@speaking("camera")
def _camera_in(path: Path) -> tuple[Interior, _Camera]:
    sheet = checked(_Camera, read_json(path))
    interior = Interior.from_json(sheet.interior)
    unique(sheet.labels, "label")
    for name in sheet.labels:
        if name not in interior.names:
            raise ValueError(f"labels: '{name}' is none of {', '.join(interior.names)}")
    if bool(sheet.labels) != bool(sheet.covariance):
        raise ValueError("labels and covariance belong together")
    if sheet.labels:
        covariance(sheet.covariance, "covariance", len(sheet.labels))
    if sheet.boards and not sheet.stations:
        raise ValueError("boards without stations: give the exterior orientations too, or leave out both")
    return interior, sheet


def _resected(interior: Interior, edges: Edges, rows: Observations, field: Field) -> tuple[Poses, np.ndarray]:
    """Camera-from-board poses (E) of edges, and which of them there are (E,)."""
    poses, keep = [], np.zeros(len(edges), bool)
    for e, here in enumerate(edges.rows):
        sheet = field.boards[edges.board[e]]
        marks = sheet.marks.xy_mm[rows.point[here]]
        xyz = np.column_stack([marks, np.zeros(len(marks))])
        radius = sheet.marks.diameter_mm[rows.point[here]] / 2
        discs = rows.centre_of_disc and not sheet.has_corners
        pose = _one(interior, xyz, rows.xy_px[here], radius if discs else None)
        keep[e] = pose is not None
        poses.append(pose or Poses.identity(1))
    return Poses.join(poses), keep


def _one(interior: Interior, xyz_mm: np.ndarray, xy_px: np.ndarray, radius_mm: np.ndarray | None) -> Poses | None:
    """The pose (1) from which a board's marks (n, 3) are seen at pixels (n, 2); None where there is none."""
    offset = np.zeros_like(xy_px)
    turn: Any = None
    shift: Any = None
    begun = False
    for _ in range(PASSES if radius_mm is not None else 1):
        plane = plane_of(interior, xy_px - offset)
        good = np.isfinite(plane).all(axis=1)
        if good.sum() < LEAST_MARKS:
            return None
        seen = (xyz_mm[good], plane[good], np.eye(3), None)
        try:
            if not begun:
                begun, turn, shift = cv2.solvePnP(*seen, flags=cv2.SOLVEPNP_IPPE)
            turn, shift = cv2.solvePnPRefineLM(*seen, turn, shift)
        except cv2.error:
            return None
        pose = Poses(cv2.Rodrigues(turn)[0][None], np.ravel(shift)[None].astype(float))
        if not (np.isfinite(pose.R).all() and np.isfinite(pose.t_mm).all()):
            return None
        if radius_mm is not None:
            many = pose[np.zeros(len(xyz_mm), int)]
            normal = np.tile([0.0, 0.0, 1.0], (len(xyz_mm), 1))
            centre = project_camera(interior, many.apply(xyz_mm))
            offset = np.nan_to_num(disc_centre_px(interior, many, xyz_mm, normal, radius_mm) - centre)
    return pose


def _with_given(found: Calibration, sheet: _Camera, path: Path) -> Calibration:
    """The same with the exterior orientations that were given in the place of the resected ones.

    The datum is the first board that is joined; what is given may be in any other frame. Raises `TestfieldError` where
    a station is missing, or a board where any are given.
    """
    _all_given("station", found.station_names, sheet.stations, path)
    if sheet.boards:
        _all_given("board", found.board_names, sheet.boards, path)
    given = _poses([sheet.stations[name] for name in found.station_names])
    if not sheet.boards:  # told from the first board's frame
        return replace(found, stations=given)
    boards = _poses([sheet.boards[name] for name in found.board_names])
    datum = Poses(*(np.repeat(values[:1], len(given), axis=0) for values in (boards.R, boards.t_mm)))
    back = Poses(*(np.repeat(values, len(boards), axis=0) for values in vars(boards[:1].inverse()).values()))
    return replace(found, stations=given.after(datum), boards=back.after(boards))


def _all_given(kind: str, wanted: Iterable[str], given: Mapping[str, PoseTable], path: Path) -> None:
    for name in wanted:
        if name not in given:
            raise TestfieldError(
                f"there is no pose of {kind} '{name}'", f"{path}, {kind}s", f"give all {kind}s, or none"
            )


def _with_residuals(found: Calibration, edges: Edges, rows: Observations, field: Field) -> Calibration:
    """The same with the residuals that its exterior orientations and boards leave, whichever way they were found."""
    at, residual = [], []
    for e, here in enumerate(edges.rows):
        station, sheet = rows.stations[edges.station[e]], field.boards[edges.board[e]]
        if station not in found.station_names or sheet.name not in found.board_names:
            continue
        s, b = found.station_names.index(station), found.board_names.index(sheet.name)
        pose = found.stations[s : s + 1].after(found.boards[b : b + 1])[np.zeros(len(here), int)]
        xyz = np.column_stack([sheet.marks.xy_mm[rows.point[here]], np.zeros(len(here))])
        if rows.centre_of_disc and not sheet.has_corners:
            normal, radius = np.tile([0.0, 0.0, 1.0], (len(here), 1)), sheet.marks.diameter_mm[rows.point[here]] / 2
            predicted = disc_centre_px(found.interior, pose, xyz, normal, radius)
        else:
            predicted = project_camera(found.interior, pose.apply(xyz))
        at.append(rows.xy_px[here])
        residual.append(rows.xy_px[here] - predicted)
    left = np.concatenate(residual)
    good = np.isfinite(left).all(axis=1)
    rms = float(np.sqrt((left[good] ** 2).sum(axis=1).mean())) if good.any() else float("nan")
    return replace(
        found,
        residual_at_px=np.concatenate(at)[good],
        residual_px=left[good],
        reprojection_rms_px=rms,
        used=int(good.sum()),
    )


def _poses(tables: list[PoseTable]) -> Poses:
    R = array([table.R for table in tables], "R", len(tables), 3, 3)
    if np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0) > 1e-6:
        raise TestfieldError("R is no rotation", "stations", "give rotation matrices")
    return Poses(R, array([table.t_mm for table in tables], "t_mm", len(tables), 3))
