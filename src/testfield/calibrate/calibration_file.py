"""The tables of a calibration's file."""

from typing import Any

from pydantic import field_validator

from testfield.store.sheets import (
    Count,
    Finite,
    OpenSheet,
    Positive,
    Sheet,
)


class PoseTable(Sheet):
    """A pose."""

    R: list[list[Finite]]
    t_mm: list[Finite]


class _Rejected(OpenSheet):
    station: str
    board: str
    x_px: float
    y_px: float
    sigmas: float | None


class _Joint(OpenSheet):
    station: str
    board: str
    marks: Count
    rms_px: float | None
    redundancy: float | None


class _BoardQuality(OpenSheet):
    board: str
    u_position_mm: float | None
    u_turn_mrad: float | None
    images: Count
    links: Count | None


class _Test(OpenSheet):
    variance: float
    low: float
    high: float
    freedom: int
    passed: bool
    contradict: int
    contradict_at_most: int
    least_redundancy: float
    uncontrolled: int
    detectable_px: float


class RigTable(OpenSheet):
    """The relative orientation of a camera in a rig."""

    rig: str
    camera: str
    turn_rad: tuple[Finite, Finite, Finite]
    t_mm: tuple[Finite, Finite, Finite]


class CalibrationFile(OpenSheet):
    """A calibration's file, but for its arrays."""

    method: str
    more_cameras: tuple[dict[str, Any], ...] = ()
    camera_names: tuple[str, ...] = ()
    rigs: tuple[RigTable, ...] = ()
    interior: dict[str, Any]
    station_names: tuple[str, ...]
    stations: list[PoseTable]
    board_names: tuple[str, ...]
    boards: list[PoseTable]
    scale: Positive
    labels: tuple[str, ...]
    sigma0: float
    freedom: int
    reprojection_rms_px: float
    used: Count
    rejected: tuple[_Rejected, ...] = ()
    graph: tuple[tuple[str, str, int], ...] = ()
    notes: tuple[str, ...] = ()
    joints: tuple[_Joint, ...] = ()
    board_quality: tuple[_BoardQuality, ...] = ()
    test: _Test | None = None

    @field_validator("test", mode="before")
    @classmethod
    def _none_for_empty(cls, value: Any) -> Any:
        return value or None
