"""What a measuring person is told of cameras and of rigs that hold them."""

from dataclasses import dataclass
from typing import Annotated, Any

import pydantic

from testfield.store.sheets import LARGEST_MM, Sheet, unique

DEFAULT_CAMERA = "camera"
"""The name of a camera that is alone and was given none."""


@dataclass(frozen=True)
class CameraSheet:
    """A camera: its image size in px, and the `lens` model that it is calibrated with where a recipe names none."""

    name: str
    width_px: int
    height_px: int
    lens: str = "brown"

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.width_px, self.height_px


@dataclass(frozen=True)
class RelativePose:
    """A camera in its rig's frame: `x_camera = R @ x_rig + t_mm`, R of the rotation vector `turn_rad`, with standard
    uncertainties of each small turn and each shift; infinite ones tell nothing."""

    turn_rad: tuple[float, float, float]
    t_mm: tuple[float, float, float]
    u_turn_rad: float = float("inf")
    u_mm: float = float("inf")


@dataclass(frozen=True)
class RigSheet:
    """Cameras that are held at fixed poses relative to each other. The rig's frame is that of its first camera;
    `poses`, as many as `cameras`, are what was stated of the others before the job, None where nothing was."""

    name: str
    cameras: tuple[str, ...]
    poses: tuple[RelativePose | None, ...]


Unbounded = Annotated[float, pydantic.Field(gt=0, allow_inf_nan=False)] | None
Millimetres = Annotated[float, pydantic.Field(ge=-LARGEST_MM, le=LARGEST_MM)]
Triple = tuple[Millimetres, Millimetres, Millimetres]
Pixels = Annotated[int, pydantic.Field(ge=1, le=100_000)]


class CameraTable(Sheet):
    """A camera in a field sheet's file."""

    name: str
    width_px: Pixels
    height_px: Pixels
    lens: str = "brown"


class PoseTable(Sheet):
    """A relative pose in a field sheet's file; absent uncertainties tell nothing."""

    turn_rad: Triple
    t_mm: Triple
    u_turn_rad: Unbounded = None
    u_mm: Unbounded = None


class RigTable(Sheet):
    """A rig in a field sheet's file."""

    name: str
    cameras: tuple[str, ...]
    poses: tuple[PoseTable | None, ...]


def cameras_of(
    cameras: tuple[CameraTable, ...], rigs: tuple[RigTable, ...]
) -> tuple[tuple[CameraSheet, ...], tuple[RigSheet, ...]]:
    """Sheets of cameras and rigs. Raises `ValueError` for names that occur twice or belong to no camera."""
    unique([one.name for one in cameras], "camera")
    unique([one.name for one in rigs], "rig")
    known = {one.name for one in cameras}
    for rig in rigs:
        unique(rig.cameras, f"rig '{rig.name}': camera")
        if missing := [name for name in rig.cameras if name not in known]:
            raise ValueError(f"rig '{rig.name}' holds '{missing[0]}', and no camera is called so")
        if len(rig.poses) != len(rig.cameras):
            raise ValueError(f"rig '{rig.name}' has {len(rig.cameras)} cameras and {len(rig.poses)} poses")
    return (
        tuple(CameraSheet(**one.model_dump()) for one in cameras),
        tuple(RigSheet(rig.name, rig.cameras, tuple(_pose(pose) for pose in rig.poses)) for rig in rigs),
    )


def tables_of(cameras: tuple[CameraSheet, ...], rigs: tuple[RigSheet, ...]) -> dict[str, Any]:
    """Cameras and rigs as they are written into a field sheet's file."""
    said: dict[str, Any] = {"cameras": [vars(one) for one in cameras]} if cameras else {}
    if rigs:
        said["rigs"] = [
            {"name": rig.name, "cameras": list(rig.cameras), "poses": [_written(pose) for pose in rig.poses]}
            for rig in rigs
        ]
    return said


def _pose(table: PoseTable | None) -> RelativePose | None:
    if table is None:
        return None
    told = {key: value for key, value in table.model_dump().items() if value is not None}
    return RelativePose(**told)


def _written(pose: RelativePose | None) -> dict[str, Any] | None:
    return None if pose is None else {k: v for k, v in vars(pose).items() if v != float("inf")}
