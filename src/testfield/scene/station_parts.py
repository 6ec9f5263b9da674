"""Where cameras stand, one by one or by generators."""

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from testfield.scene.fields import Box, Count, Direction, Name, Pair, Part, PositiveFloat, Vector3


class Aimed(Part):
    """A station that looks at a point."""

    look_at_mm: Vector3 = Field((0, 0, 1500), description="Point the optical axis goes through.")
    roll_deg: tuple[float, ...] = Field(
        (0,), min_length=1, description="Rotation about the optical axis, taken in turn by the stations."
    )
    camera: Name | None = Field(None, description="Which of several cameras stands here; absent where there is one.")
    rig: Name | None = Field(None, description="Which rig stands here, its origin in the place of a camera's.")


class StationSingle(Aimed):
    """One station."""

    generator: Literal["single"] = "single"
    name: Name | None = Field(None, description="Name of the station; numbered where absent.")
    position_mm: Vector3 = Field(description="Projection centre.")


class StationPose(Part):
    """One station whose exterior orientation is known by numbers."""

    generator: Literal["pose"]
    name: Name = Field(description="Name of the station.")
    position_mm: Vector3 = Field(description="Projection centre.")
    rotation_deg: Vector3 = Field(
        description="Rotation vector of the exterior orientation as OpenCV gives it: x_camera = R x_world + t."
    )
    camera: Name | None = Field(None, description="Which of several cameras stands here; absent where there is one.")
    rig: Name | None = Field(None, description="Which rig stands here.")


class StationArc(Aimed):
    """Stations on a horizontal arc around `look_at_mm`; azimuth 0 looks along +y, positive to the right of it."""

    generator: Literal["arc"]
    count: Count = Field(description="How many.")
    radius_mm: PositiveFloat = Field(description="Horizontal distance from look_at_mm.")
    height_mm: float = Field(description="z of all of them.")
    azimuth_deg: Pair = Field((-45, 45), description="First and last azimuth.")


class StationRing(Aimed):
    """Stations on a full circle around `look_at_mm` in a plane square to `axis`."""

    generator: Literal["ring"]
    count: Count = Field(description="How many.")
    radius_mm: PositiveFloat = Field(description="Radius of the circle.")
    centre_mm: Vector3 = Field(description="Middle of the circle.")
    axis: Direction = Field((0, 1, 0), description="Direction square to the circle.")


class StationGrid(Aimed, Box):
    """Stations on a regular lattice."""

    generator: Literal["grid"]
    counts: tuple[Count, Count, Count] = Field(description="How many along x, y and z.")


class StationRandom(Aimed, Box):
    """Stations at random places of a box."""

    generator: Literal["random"]
    count: Count = Field(description="How many.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


StationPart = Annotated[
    StationSingle | StationPose | StationArc | StationRing | StationGrid | StationRandom,
    Field(discriminator="generator"),
]
