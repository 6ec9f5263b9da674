"""The result of a calibration: the camera, its stations, the boards, and how well all of them are known."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.errors import speaking
from testfield.store.text import read_text, write_text

ARRAYS = ("covariance", "residual_at_px", "residual_px", "point_code", "point_mm")


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera in the frame of the first board.

    `stations` camera-from-datum, `boards` datum-from-board poses with their names; `scale` of the boards against
    their sheets; `covariance` (P, P) of the unknowns named in `labels` (interior in the model's units, rotations in
    rad as small turns after the pose's rotation, translations in mm, scale, loose points). `point_code` (k,) at
    `point_mm` (k, 3) in the datum are the loose targets that were adjusted with the cameras (a control bar's ends):
    their pixels have had their say, and reconstruction takes them over. `sigma0` of the adjustment with
    `freedom`; `reprojection_rms_px` over `used` observations; `rejected` observations (station, board, x_px, y_px,
    size of the residual in standard deviations, why); `residual_px` (m, 2) observed minus adjusted at `residual_at_px`
    (m, 2); `graph` edges (station, board, marks); `joints`, `board_quality` and `test` as in `quality`; `notes` for the
    reader.
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
    point_code: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    point_mm: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def index(self, names: list[str]) -> np.ndarray:
        """Places of the named unknowns in the covariance."""
        place = {label: k for k, label in enumerate(self.labels)}
        return np.array([place[name] for name in names], int)

    def station_unknowns(self, station: int) -> list[str]:
        """Names of a station's six unknowns."""
        return [f"station:{self.station_names[station]}.{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")]

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
        }
        write_text(path, json.dumps(data))

    @staticmethod
    @speaking("calibration")
    def load(path: Path) -> "Calibration":
        """Read what `save` wrote."""
        data = json.loads(read_text(path))
        data["interior"] = Interior.from_json(data["interior"])
        data["stations"], data["boards"] = (_poses(data[key]) for key in ("stations", "boards"))
        data |= {key: np.array(data[key]) for key in ARRAYS}
        data["point_code"], data["point_mm"] = data["point_code"].astype(int), data["point_mm"].reshape(-1, 3)
        for key in ("station_names", "board_names", "labels", "rejected", "notes", "joints", "board_quality"):
            data[key] = tuple(data.get(key, ()))
        data["graph"] = tuple(tuple(edge) for edge in data["graph"])
        return Calibration(**data)


def point_label(code: int) -> str:
    """How a loose target's unknowns are named."""
    return f"point:{int(code)}"


def _poses_json(poses: Poses) -> list[dict]:
    return [{"R": R.tolist(), "t_mm": t.tolist()} for R, t in zip(poses.R, poses.t_mm, strict=True)]


def _poses(data: list[dict]) -> Poses:
    return Poses(np.array([p["R"] for p in data]).reshape(-1, 3, 3), np.array([p["t_mm"] for p in data]).reshape(-1, 3))
