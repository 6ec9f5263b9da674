"""The result of a calibration: the camera, its stations, the boards, and how well all of them are known."""

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from testfield.calibrate.calibration_check import what_cannot_be
from testfield.calibrate.calibration_file import CalibrationFile, PoseTable
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError, speaking
from testfield.store.sheets import (
    FORMAT,
    array,
    checked,
    covariance,
    read_json,
    unique,
)
from testfield.store.text import write_text

AXES = ("rx", "ry", "rz", "tx", "ty", "tz")
TUPLES = (
    "station_names",
    "board_names",
    "labels",
    "rejected",
    "notes",
    "joints",
    "board_quality",
    "rejections",
    "certificates",
    "failures",
    "camera_names",
    "rigs",
)
ARRAYS = ("covariance", "residual_at_px", "residual_px", "point_code", "point_mm", "image_camera", "residual_camera")
SEVERAL = ("more_cameras", "camera_names", "image_camera", "residual_camera", "rigs")
"""What only the file of several cameras has."""


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera, or several, in the frame of the first board.

    `stations` camera-from-datum, `boards` datum-from-board poses with their names; `scale` of the boards against
    their sheets; `covariance` (P, P) of the unknowns named in `labels` (interior in the model's units, rotations in
    rad as small turns after the pose's rotation, translations in mm, scale, loose points): what is not named there
    has no stated uncertainty, and nothing need be named. `point_code` (k,) at
    `point_mm` (k, 3) in the datum are the loose targets that were adjusted with the cameras (a control bar's ends):
    their pixels have had their say, and reconstruction takes them over. `sigma0` of the adjustment with
    `freedom`; `reprojection_rms_px` over `used` observations; `rejected` observations (station, board, x_px, y_px,
    size of the residual in standard deviations, why); `residual_px` (m, 2) observed minus adjusted at `residual_at_px`
    (m, 2); `graph` edges (station, board, marks); `joints`, `board_quality` and `test` as in `quality`; `misfit` what
    the lens model does not follow (`lens_misfit`), empty where nothing is seen of it; `rejections` counted by group as
    in `rejections`; `certificates` tested, as in `certificates`; `failures`, sentences on what no reader may overlook:
    with one of them the test is not passed; `notes` for the reader.

    Several cameras: `interior` is the first one's, `more_cameras` the others', `camera_names` those of all and
    `image_camera` (stations) the camera of each image, `residual_camera` (m,) of each residual; unknowns of a camera
    are then named `camera:NAME.fx`. `rigs` are relative orientations: name, camera, `turn_rad`, `t_mm` in the frame of
    the rig's first camera, whose unknowns are `member:RIG/CAMERA.rx` and so on.
    """

    method: str
    interior: Interior
    station_names: tuple[str, ...]
    stations: Poses
    board_names: tuple[str, ...]
    boards: Poses
    scale: float
    covariance: np.ndarray
    labels: tuple[str, ...]
    sigma0: float
    freedom: int
    reprojection_rms_px: float
    used: int
    rejected: tuple[dict, ...] = ()
    residual_at_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    residual_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    graph: tuple[tuple[str, str, int], ...] = ()
    notes: tuple[str, ...] = ()
    joints: tuple[dict, ...] = ()
    board_quality: tuple[dict, ...] = ()
    test: dict = field(default_factory=dict)
    misfit: dict = field(default_factory=dict)
    point_code: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    point_mm: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    rejections: tuple[dict, ...] = ()
    certificates: tuple[dict, ...] = ()
    failures: tuple[str, ...] = ()
    more_cameras: tuple[Interior, ...] = ()
    camera_names: tuple[str, ...] = ()
    image_camera: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    residual_camera: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    rigs: tuple[dict, ...] = ()

    @property
    def interiors(self) -> tuple[Interior, ...]:
        """The interior orientations of all cameras."""
        return (self.interior, *self.more_cameras)

    @property
    def camera_of_image(self) -> np.ndarray:
        """(stations,) the camera of each image."""
        return self.image_camera if len(self.image_camera) else np.zeros(len(self.station_names), int)

    def states(self, names: list[str]) -> bool:
        """Whether a covariance of all the named unknowns is stated."""
        return set(names) <= set(self.labels)

    @property
    def states_u(self) -> bool:
        """Whether a covariance of everything that rays come from is stated: of all stations and cameras."""
        stations = [name for s in range(len(self.station_names)) for name in self.station_unknowns(s)]
        cameras = [{*self.interior_unknowns(k)} for k in range(len(self.interiors))]
        return self.states(stations) and all(own & set(self.labels) for own in cameras)

    @property
    def u_px(self) -> float:
        """Standard deviation of a pixel's coordinate as the residuals have it, in px."""
        return float(self.reprojection_rms_px * np.sqrt(self.used / max(self.freedom, 1)))

    def interior_unknowns(self, camera: int) -> list[str]:
        """Labels that a camera's parameters have, in their order, whether they are among the unknowns or not."""
        prefix = f"camera:{self.camera_names[camera]}." if self.more_cameras else ""
        return [prefix + name for name in self.interiors[camera].names]

    def index(self, names: list[str]) -> np.ndarray:
        """Places of the named unknowns in the covariance."""
        place = {label: k for k, label in enumerate(self.labels)}
        return np.array([place[name] for name in names], int)

    def station_unknowns(self, station: int) -> list[str]:
        """Names of a station's six unknowns."""
        return [f"station:{self.station_names[station]}.{axis}" for axis in AXES]

    def point_unknowns(self, codes: np.ndarray) -> np.ndarray:
        """(3k,) places in the covariance of points that were adjusted with the cameras, by their codes."""
        return self.index([f"{point_label(code)}.{axis}" for code in codes for axis in "xyz"])

    def save(self, path: Path) -> None:
        """Write as JSON."""
        data = asdict(self) | {
            "interior": self.interior.to_json(),
            "stations": _poses_json(self.stations),
            "boards": _poses_json(self.boards),
            **{key: getattr(self, key).tolist() for key in ARRAYS},
            "more_cameras": [camera.to_json() for camera in self.more_cameras],
        }
        if not self.more_cameras:  # one camera's file is what it was before there could be several
            for key in SEVERAL:
                data.pop(key)
        write_text(path, json.dumps({"format": FORMAT} | data))

    @staticmethod
    @speaking("calibration")
    def load(path: Path) -> "Calibration":
        """Read what `save` wrote. Raises `TestfieldError` where types, names, shapes or numbers are not such."""
        data = read_json(path)
        if "labels" not in data and "covariance" not in data:  # whoever states no covariance names no unknowns
            data |= {"labels": [], "covariance": []}
        arrays = {key: data.pop(key, []) if key in SEVERAL else data.pop(key) for key in ARRAYS}
        file = checked(CalibrationFile, data)
        if unknown := set(data) - {f.name for f in fields(Calibration)}:
            raise ValueError(f"{min(unknown)}: no such part")
        P, points = len(file.labels), len(arrays["point_code"])
        residuals = len(arrays["residual_px"])
        plain = file.model_dump(exclude={"interior", "stations", "boards", "more_cameras"})
        cameras = 1 + len(file.more_cameras)
        images = len(file.station_names) if file.more_cameras else 0
        found = Calibration(
            **(plain | {"test": plain["test"] or {}} | {key: tuple(plain.get(key, ())) for key in TUPLES}),
            interior=Interior.from_json(file.interior),
            more_cameras=tuple(Interior.from_json(one) for one in file.more_cameras),
            image_camera=_numbers(arrays["image_camera"], "image_camera", images, cameras),
            residual_camera=_numbers(arrays["residual_camera"], "residual_camera", residuals if images else 0, cameras),
            stations=_poses(file.stations, "stations", len(file.station_names)),
            boards=_poses(file.boards, "boards", len(file.board_names)),
            covariance=covariance(arrays["covariance"], "covariance", P),
            residual_px=array(arrays["residual_px"], "residual_px", residuals, 2),
            residual_at_px=array(arrays["residual_at_px"], "residual_at_px", residuals, 2),
            point_code=array(arrays["point_code"], "point_code", points, kind=int),
            point_mm=array(arrays["point_mm"], "point_mm", points, 3),
        )
        _names_fit(found)
        if wrong := what_cannot_be(found):
            raise TestfieldError(wrong, str(path), "make it again, or mend what was edited")
        return found


def _numbers(value: Any, name: str, count: int, cameras: int) -> np.ndarray:
    """(count,) numbers of cameras."""
    found = array(value, name, count, kind=int)
    if len(found) and (found.min() < 0 or found.max() >= cameras):
        raise ValueError(f"{name} counts cameras that there are not")
    return found


def _names_fit(found: Calibration) -> None:
    """Refuse names of unknowns, joints and edges that the calibration does not have."""
    unique(found.station_names, "station")
    unique(found.board_names, "board")
    unique(found.labels, "unknown")
    unique(found.camera_names, "camera")
    if found.more_cameras and len(found.camera_names) != len(found.interiors):
        raise ValueError(f"{len(found.interiors)} cameras have {len(found.camera_names)} names")
    owners = {
        "station": set(found.station_names),
        "board": set(found.board_names),
        "point": set(map(str, found.point_code)),
        "camera": set(found.camera_names),
    }
    for label in found.labels:
        kind, colon, rest = label.partition(":")
        if colon and kind in owners and rest.rpartition(".")[0] not in owners[kind]:
            raise ValueError(f"the unknown '{label}' belongs to no {kind} of this calibration")
    for name in found.station_names:
        has = [f"station:{name}.{axis}" in found.labels for axis in AXES]
        if any(has) and not all(has):
            raise ValueError(f"unknowns of station '{name}' are missing")


def point_label(code: int) -> str:
    """How a loose target's unknowns are named."""
    return f"point:{int(code)}"


def _poses_json(poses: Poses) -> list[dict]:
    return [{"R": R.tolist(), "t_mm": t.tolist()} for R, t in zip(poses.R, poses.t_mm, strict=True)]


def _poses(data: list[PoseTable], name: str, count: int) -> Poses:
    R = array([p.R for p in data], f"{name}, R", count, 3, 3)
    if np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0) > 1e-6:
        raise ValueError(f"{name}, R is no rotation")
    return Poses(R, array([p.t_mm for p in data], f"{name}, t_mm", count, 3))
