"""The file of cameras that somebody else calibrated.

JSON: of one camera `interior` as in calibration.json, of several `cameras`, an interior orientation by each name of the
field sheet, and as far as they are known `labels` with `covariance` of their parameters, the exterior orientations
`stations`, alone or with the poses of `boards`, and of rigs `rigs` as in calibration.json.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pydantic

from testfield.calibrate.calibration_file import PoseTable, RigTable
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError, nearest, speaking
from testfield.store.sheets import Finite, Sheet, array, checked, covariance, read_json, unique
from testfield.targets.camera_sheet import CameraSheet
from testfield.targets.field import Field


class CameraFile(Sheet):
    """What such a file holds."""

    interior: dict[str, Any] | None = None
    cameras: dict[str, dict[str, Any]] = pydantic.Field(default_factory=dict)
    labels: tuple[str, ...] = ()
    covariance: tuple[tuple[Finite, ...], ...] = ()
    stations: dict[str, PoseTable] = pydantic.Field(default_factory=dict)
    boards: dict[str, PoseTable] = pydantic.Field(default_factory=dict)
    rigs: tuple[RigTable, ...] = ()
    notes: tuple[str, ...] = ()


@speaking("camera")
def read_camera_file(path: Path, field: Field) -> tuple[tuple[Interior, ...], CameraFile]:
    """The interior orientations, in the order of the field sheet's cameras, and all else that the file says.

    Raises `TestfieldError` where the file is none, or its cameras are not those of the field sheet.
    """
    sheet = checked(CameraFile, read_json(path))
    interiors = _interiors(sheet, [camera.name for camera in field.cameras], path)
    unique(sheet.labels, "label")
    known = _unknowns(interiors, [camera.name for camera in field.cameras])
    for name in sheet.labels:
        if name not in known:
            raise ValueError(f"labels: '{name}' is none of {', '.join(known)}")
    if bool(sheet.labels) != bool(sheet.covariance):
        raise ValueError("labels and covariance belong together")
    if sheet.labels:
        covariance(sheet.covariance, "covariance", len(sheet.labels))
    if sheet.boards and not sheet.stations:
        raise ValueError("boards without stations: give the exterior orientations too, or leave out both")
    poses_of(list(sheet.stations.values()), "stations")
    poses_of(list(sheet.boards.values()), "boards")
    members = {(rig.name, camera) for rig in field.rigs for camera in rig.cameras}
    for one in sheet.rigs:
        if (one.rig, one.camera) not in members:
            raise ValueError(f"rigs: the field sheet has no rig '{one.rig}' with a camera '{one.camera}'")
    return interiors, sheet


def check_sizes(interiors: tuple[Interior, ...], cameras: tuple[CameraSheet, ...], path: Path) -> None:
    """Raise `TestfieldError` where a camera's images are of another size than the field sheet says."""
    for interior, camera in zip(interiors, cameras, strict=False):
        if (interior.width_px, interior.height_px) != camera.size_px:
            width, height = camera.size_px
            field = "interior" if len(cameras) == 1 else f"cameras.{camera.name}"
            raise TestfieldError(
                f"the camera has {interior.width_px} x {interior.height_px} px, the images {width} x {height}",
                f"{path}, {field}.width_px",
                "calibrate these images",
            )


def poses_of(tables: list[PoseTable], where: str) -> Poses:
    """Poses (n). Raises `ValueError` where a matrix is no rotation, or of another shape."""
    R = array([table.R for table in tables], f"{where}, R", len(tables), 3, 3)
    if np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0) > 1e-6:
        raise ValueError(f"{where}, R is no rotation")
    return Poses(R, array([table.t_mm for table in tables], f"{where}, t_mm", len(tables), 3))


def _interiors(sheet: CameraFile, names: list[str], path: Path) -> tuple[Interior, ...]:
    if sheet.interior is not None and sheet.cameras:
        raise ValueError("interior and cameras exclude each other: of several cameras give cameras alone")
    if not sheet.cameras:
        if sheet.interior is None:
            raise ValueError("interior: field required" if len(names) < 2 else "cameras: field required")
        if len(names) > 1:
            raise TestfieldError(
                f"it holds one `interior`, and the field sheet lists {len(names)} cameras",
                f"{path}, interior",
                f"give `cameras` with {', '.join(names)}",
            )
        return (Interior.from_json(sheet.interior),)
    for name in sheet.cameras:
        if name not in names:
            raise TestfieldError(f"no camera is called '{name}'", f"{path}, cameras.{name}", nearest(name, names))
    for name in names:
        if name not in sheet.cameras:
            raise TestfieldError(f"there is no camera '{name}'", f"{path}, cameras", "give all cameras of the sheet")
    return tuple(Interior.from_json(sheet.cameras[name]) for name in names)


def _unknowns(interiors: tuple[Interior, ...], names: list[str]) -> list[str]:
    """Names of all parameters, as a calibration has them."""
    if len(interiors) == 1:
        return list(interiors[0].names)
    return [f"camera:{name}.{one}" for name, own in zip(names, interiors, strict=True) for one in own.names]
