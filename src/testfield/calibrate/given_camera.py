"""Cameras that somebody else calibrated: their file, and everything that it does not say, by resection.

Where exterior orientations or boards are missing, each board in each image is resected with the camera as it is given,
and images and boards are chained along the strongest tree.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.calibration_file import PoseTable
from testfield.calibrate.camera_file import CameraFile, check_sizes, poses_of, read_camera_file
from testfield.calibrate.edges import Edges, board_edges, left_out
from testfield.calibrate.homography import image_middle
from testfield.calibrate.imaging import imaging_of
from testfield.calibrate.rows import usable_rows
from testfield.calibrate.views import Cameras, from_views
from testfield.camera.circle import disc_centre_px
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import plane_of, project_camera
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError, speaking
from testfield.store.sheets import covariance, read_json
from testfield.targets.field import Field

PASSES = 3
"""Resections of a board: what a disc's image adds to its centre's projection follows from the pose before."""
LEAST_MARKS = 4
RESECTED = "exterior orientations and boards by resection with the camera as it was given; no covariance is stated"
GIVEN = "exterior orientations and boards as they were given"


def read_camera(path: Path, observations: Observations, field: Field, method: str) -> Calibration:
    """The calibration of a camera file, or of a whole calibration.json, for these observations.

    Raises `TestfieldError` where the file is none, or its cameras are others than the field sheet's.
    """
    found = _whole(path) or _from(path, observations, field, method)
    named = [camera.name for camera in field.cameras]
    if len(named) > 1 and list(found.camera_names) != named:
        raise TestfieldError(
            f"its cameras are {', '.join(found.camera_names) or 'one without a name'}",
            f"{path}, camera_names",
            f"give those of the field sheet in its order: {', '.join(named)}",
        )
    check_sizes(found.interiors, field.cameras, path)
    return replace(found, method=method)


@speaking("camera")
def _whole(path: Path) -> Calibration | None:
    """The file as a calibration.json, if it is one."""
    return Calibration.load(path) if "station_names" in read_json(path) else None


def _from(path: Path, observations: Observations, field: Field, method: str) -> Calibration:
    interiors, sheet = read_camera_file(path, field)
    check_sizes(interiors, field.cameras, path)
    rows, turned_down, notes = usable_rows(observations, field)
    cameras = _cameras(interiors, rows, field)
    edges, why, said = _edges(cameras, rows, field)
    turned_down, notes = turned_down + left_out(rows, field, why), [*notes, *said, *sheet.notes]
    poses, keep = _resected(cameras, edges, rows, field)
    if not keep.any():
        raise TestfieldError(
            "no board can be resected with this camera", str(path), "look at its focal length, principal point and lens"
        )
    found = from_views(method, cameras, None, poses[keep], edges.take(keep), rows, field, turned_down, notes)
    if sheet.stations:
        found = _with_given(found, sheet, path)
    said_u = covariance(sheet.covariance, "covariance", len(sheet.labels)) if sheet.labels else np.zeros((0, 0))
    note = GIVEN if sheet.stations else RESECTED
    found = _with_residuals(found, edges.take(keep), rows, field)
    rigs = tuple(one.model_dump() for one in sheet.rigs)
    return replace(found, labels=tuple(sheet.labels), covariance=said_u, notes=(*found.notes[:-1], note), rigs=rigs)


def _cameras(interiors: tuple[Interior, ...], rows: Observations, field: Field) -> Cameras:
    """The cameras of the field sheet, and which of them took each image."""
    if len(interiors) == 1:
        return Cameras.one(interiors[0], len(rows.stations))
    if not rows.cameras:
        raise TestfieldError(
            "nobody says which camera took which image", "observations.parquet", "give the metadata `cameras`"
        )
    of_image = imaging_of(rows, field.cameras, (), "free").camera
    return Cameras(tuple(camera.name for camera in field.cameras), interiors, of_image)


def _edges(cameras: Cameras, rows: Observations, field: Field) -> tuple[Edges, np.ndarray, list[str]]:
    """Boards in images, camera by camera, as `board_edges` gives them. A camera that shows none is in no image."""
    if len(cameras.interiors) == 1:
        one = cameras.interiors[0]
        return board_edges(rows, field, image_middle(one.width_px, one.height_px))
    why, notes, parts = np.full(len(rows), "", object), list[str](), list[Edges]()
    for k, one in enumerate(cameras.interiors):
        here = np.flatnonzero(cameras.of_image[rows.station] == k)
        try:
            edges, said, told = board_edges(rows.take(here), field, image_middle(one.width_px, one.height_px))
        except TestfieldError as error:
            raise TestfieldError(f"camera '{cameras.names[k]}': {error.what}", error.where, error.do) from error
        parts.append(edges.of_rows(here))
        why[here], notes = said, notes + told
    return Edges.join(parts), why, notes


def _resected(cameras: Cameras, edges: Edges, rows: Observations, field: Field) -> tuple[Poses, np.ndarray]:
    """Camera-from-board poses (E) of edges, and which of them there are (E,)."""
    poses, keep = [], np.zeros(len(edges), bool)
    for e, here in enumerate(edges.rows):
        sheet = field.boards[edges.board[e]]
        marks = sheet.marks.xy_mm[rows.point[here]]
        xyz = np.column_stack([marks, np.zeros(len(marks))])
        radius = sheet.marks.diameter_mm[rows.point[here]] / 2
        discs = rows.centre_of_disc and not sheet.has_corners
        interior = cameras.interiors[cameras.of_image[edges.station[e]]]
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


def _with_given(found: Calibration, sheet: CameraFile, path: Path) -> Calibration:
    """The same with the exterior orientations that were given in the place of the resected ones.

    The datum is the first board that is joined; what is given may be in any other frame. Raises `TestfieldError` where
    a station is missing, or a board where any are given.
    """
    _all_given("station", found.station_names, sheet.stations, path)
    if sheet.boards:
        _all_given("board", found.board_names, sheet.boards, path)
    given = poses_of([sheet.stations[name] for name in found.station_names], "stations")
    if not sheet.boards:  # told from the first board's frame
        return replace(found, stations=given)
    boards = poses_of([sheet.boards[name] for name in found.board_names], "boards")
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
    at, residual, camera = [], [], []
    for e, here in enumerate(edges.rows):
        station, sheet = rows.stations[edges.station[e]], field.boards[edges.board[e]]
        if station not in found.station_names or sheet.name not in found.board_names:
            continue
        s, b = found.station_names.index(station), found.board_names.index(sheet.name)
        interior = found.interiors[found.camera_of_image[s]]
        pose = found.stations[s : s + 1].after(found.boards[b : b + 1])[np.zeros(len(here), int)]
        xyz = np.column_stack([sheet.marks.xy_mm[rows.point[here]], np.zeros(len(here))])
        if rows.centre_of_disc and not sheet.has_corners:
            normal, radius = np.tile([0.0, 0.0, 1.0], (len(here), 1)), sheet.marks.diameter_mm[rows.point[here]] / 2
            predicted = disc_centre_px(interior, pose, xyz, normal, radius)
        else:
            predicted = project_camera(interior, pose.apply(xyz))
        at.append(rows.xy_px[here])
        residual.append(rows.xy_px[here] - predicted)
        camera.append(np.full(len(here), found.camera_of_image[s]))
    left = np.concatenate(residual)
    good = np.isfinite(left).all(axis=1)
    rms = float(np.sqrt((left[good] ** 2).sum(axis=1).mean())) if good.any() else float("nan")
    return replace(
        found,
        residual_at_px=np.concatenate(at)[good],
        residual_px=left[good],
        residual_camera=np.concatenate(camera)[good] if found.more_cameras else found.residual_camera,
        reprojection_rms_px=rms,
        used=int(good.sum()),
    )
