"""The scene file: every field a person can write, with its unit, its default and what it means."""

from pathlib import Path
from typing import Any, Literal

from pydantic import (
    Field,
    PrivateAttr,
    model_validator,
)

from testfield.choices import LensName
from testfield.scene.board_parts import BoardPart
from testfield.scene.camera_parts import (
    CameraPart,
    ExposurePart,
    NamedCameraPart,
    RigPart,
    SensorPart,
    TargetMotionPart,
)
from testfield.scene.fields import Name, Part, PositiveFloat
from testfield.scene.room_parts import MeshPart, PaintPart, RoomPart
from testfield.scene.station_parts import StationPart
from testfield.scene.target_parts import AcceptancePart, CheckPart, MeasuringLinePart, ScaleBarPart
from testfield.sensor.presets import with_preset
from testfield.targets.marks import USUAL, RingShape


class VolumePart(Part):
    """The measuring volume."""

    size_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        (4000, 3000, 2000), description="Edges of the volume; its diagonal scales relative accuracy."
    )


class RenderPart(Part):
    """How images are computed."""

    mode: Literal["fast", "path"] = Field(
        "fast", description="fast: exact edges under known light; path: plain path tracing, the reference."
    )
    cells: int = Field(3, ge=1, le=16, description="fast: cells along each side of a pixel.")
    light_spacing_mm: PositiveFloat = Field(30, description="fast: distance of the points at which light is computed.")
    light_paths: int = Field(4096, ge=16, le=10_000_000, description="fast: paths for each of these points.")
    blur_shots: int = Field(
        64, ge=2, le=4096, description="fast: the most sharp pictures whose mean makes a defocused or moved one."
    )
    samples: int = Field(64, ge=1, le=10_000_000, description="path: samples a pixel.")
    noise_target: float = Field(
        0.005,
        gt=0,
        le=1,
        description="What must be sampled (gloss) is, until each pixel's standard error is this part of white.",
    )
    most_samples: int = Field(
        4096, ge=64, le=10_000_000, description="Where a pixel's sampling ends even if noise_target is not reached."
    )


class MeasurePart(Part):
    """Which algorithms measure the images; `testfield list` shows their names."""

    centroid: str = Field("forward_model", description="Centroid estimator.")
    calibrator: str = Field("stitched", description="Calibration method.")
    lens: LensName | None = Field(None, description="Lens model to calibrate; absent, that of the camera.")
    hold: tuple[str, ...] = Field((), description="Parameters of the calibrated lens that are held at zero, as k5.")
    board: str | None = Field(
        None, description="The board that is calibrated with, for zhang, opencv and opencv_ro; absent, the best seen."
    )
    reconstructor: str = Field("gls", description="Reconstruction method.")
    smallest_diameter_px: float = Field(5.0, ge=3, le=1000, description="Smaller dots are not looked for.")
    centroid_options: dict[str, Any] = Field({}, description="Options of the centroid estimator, by name.")
    calibrator_options: dict[str, Any] = Field({}, description="Options of the calibrator, by name.")
    reconstructor_options: dict[str, Any] = Field({}, description="Options of the reconstructor, by name.")


class CertifiedPosesPart(Part):
    """What the field sheet says of where boards are, in the frame of the first: the truth and an error drawn from the
    uncertainties given."""

    u_position_mm: float = Field(0, ge=0, le=1000, description="Standard uncertainty of each coordinate; 0 is exact.")
    u_rotation_deg: float = Field(0, ge=0, le=10, description="Standard uncertainty of the turn about each axis.")


class SceneFile(Part):
    """A scene: the field as it truly is, the camera that sees it, and how it is measured."""

    @model_validator(mode="before")
    @classmethod
    def _with_preset(cls, data: Any) -> Any:
        return with_preset(data) if isinstance(data, dict) else data

    name: Name = Field(description="Name of the scene, also of its run's folder.")
    description: str = Field("", description="One sentence for the report.")
    seed: int = Field(1, ge=0, description="Seed of everything random.")
    noise_seed: int | None = Field(
        None, ge=0, description="Seed of the sensor's noise, for other images of the same world; absent, `seed`."
    )
    code_bits: Literal[8, 10, 12, 14, 16, 20] = Field(14, description="Segments of every ring code.")
    code_table: str | None = Field(
        None, description="File of another table of ring codes than those of `code_bits`, or the name of a shipped one."
    )
    code_radii: RingShape = Field(
        USUAL, description="Radii of every ring code: dot, ring's inner edge, ring's outer edge, as 1:2:3."
    )
    volume: VolumePart = VolumePart()
    camera: CameraPart = CameraPart()
    sensor: SensorPart = SensorPart()
    exposure: ExposurePart = ExposurePart()
    cameras: tuple[NamedCameraPart, ...] = Field(
        (), max_length=100, description="Several cameras by name, in the place of `camera`."
    )
    rigs: tuple[RigPart, ...] = Field((), max_length=100, description="What holds cameras together.")
    paint: PaintPart = PaintPart()
    room: RoomPart = RoomPart()
    boards: tuple[BoardPart, ...] = Field(
        min_length=1, max_length=1000, description="Sub-boards; the first defines the measuring frame."
    )
    u_print_scale_ppm: float = Field(
        20,
        ge=0,
        le=10000,
        description="Standard uncertainty of the scale all boards share (printing, temperature); "
        "the true scale differs by a draw from it.",
    )
    certified_poses: CertifiedPosesPart | None = Field(
        None, description="Whether somebody measured where the boards are, for the calibrators stitched_given and dlt."
    )
    scale_bars: tuple[ScaleBarPart, ...] = Field((), max_length=1000, description="Scale bars.")
    meshes: tuple[MeshPart, ...] = Field(
        (), max_length=100, description="Bodies from mesh files, in the way or to carry targets."
    )
    check_targets: tuple[CheckPart, ...] = Field((), description="Targets whose true positions only scoring knows.")
    measuring_lines: tuple[MeasuringLinePart, ...] = Field(
        (),
        max_length=1000,
        description="Lines of check targets whose distances are calibrated, for `testfield accept`.",
    )
    acceptance: AcceptancePart | None = Field(None, description="The limit that `testfield accept` judges by.")
    target_motion: TargetMotionPart | None = Field(
        None, description="How all that carries marks moves during the exposure, in the world."
    )
    stations: tuple[StationPart, ...] = Field(
        min_length=1, description="Where the camera is, one by one or by generators."
    )
    render: RenderPart = RenderPart()
    measure: MeasurePart = MeasurePart()

    _folder: Path = PrivateAttr(default=Path())
    """Where the scene file lies: files it names are relative to it. Not a field, so the scene is the same anywhere."""

    @property
    def folder(self) -> Path:
        """The folder that files named in the scene are relative to."""
        return self._folder

    def in_folder(self, folder: Path) -> "SceneFile":
        """The same scene with its files in another folder."""
        moved = self.model_copy()
        moved._folder = folder
        return moved
