"""What is around in a scene file: surfaces, lights, surroundings, bodies; and what marks are made of."""

from typing import Annotated, Literal

from pydantic import (
    Field,
    model_validator,
)

from testfield.scene.fields import Direction, Ink, Label, Name, Part, PositiveFloat, Size, Vector3


class SurfacePart(Part):
    """A flat surface of the room: floor, wall, screen."""

    name: Label = Field(description="Unique name.")
    size_mm: Size = Field(description="Width and height.")
    position_mm: Vector3 = Field(description="Where its middle is.")
    normal: Direction = Field(description="Direction of the side that is seen.")
    albedo: float = Field(0.5, ge=0, le=0.95, description="Diffuse reflectance.")


class AreaLightPart(Part):
    """A soft rectangular light."""

    kind: Literal["area"] = Field("area", description="A soft rectangle.")
    size_mm: Size = Field(description="Width and height.")
    position_mm: Vector3 = Field(description="Where its middle is.")
    normal: Direction = Field((0, 0, -1), description="Direction it shines.")
    radiance_w_m2_sr: PositiveFloat = Field(description="Radiance of its surface.")


class PointLightPart(Part):
    """A light without size, alike in all directions; its shadows are hard."""

    kind: Literal["point"] = Field(description="A light without size.")
    position_mm: Vector3 = Field(description="Where it is.")
    intensity_w_sr: PositiveFloat = Field(description="Radiant intensity.")


LightPart = Annotated[AreaLightPart | PointLightPart, Field(discriminator="kind")]


class GradientPart(Part):
    """Light from all around that changes with height alone."""

    kind: Literal["gradient"] = Field(description="From the zenith over the horizon to straight below.")
    zenith_w_m2_sr: float = Field(ge=0, description="Radiance from straight above.")
    horizon_w_m2_sr: float = Field(ge=0, description="Radiance from the horizon.")
    ground_w_m2_sr: float = Field(ge=0, description="Radiance from straight below.")

    @model_validator(mode="after")
    def _has_power(self) -> "GradientPart":
        if self.zenith_w_m2_sr == self.horizon_w_m2_sr == self.ground_w_m2_sr == 0:
            raise ValueError("an environment without any radiance; give one of the three, or leave it out")
        return self


class MapPart(Part):
    """Light from all around, from an equirectangular picture."""

    kind: Literal["map"] = Field(description="An equirectangular picture.")
    file: str = Field(
        max_length=1000,
        description="EXR, HDR or PNG, its middle the world's +y and its top the zenith; PNG is decoded from sRGB. "
        "Relative to the scene file.",
    )
    scale_w_m2_sr: PositiveFloat = Field(1.0, description="Radiance of a pixel of value 1.")
    azimuth_deg: float = Field(0, description="Turn about the vertical, counter-clockwise seen from above.")


EnvironmentPart = Annotated[GradientPart | MapPart, Field(discriminator="kind")]


class RoomPart(Part):
    """What stands around the field, and the light."""

    surfaces: tuple[SurfacePart, ...] = Field((), max_length=1000, description="Floor, walls and other plain surfaces.")
    lights: tuple[LightPart, ...] = Field((), max_length=1000, description="Area lights and point lights.")
    ambient_w_m2_sr: float = Field(0.5, ge=0, description="Radiance that comes from every direction no surface hides.")
    environment: EnvironmentPart | None = Field(
        None, description="Light from all around that is not constant, in the place of ambient_w_m2_sr."
    )

    @model_validator(mode="after")
    def _one_environment(self) -> "RoomPart":
        if self.environment is not None and "ambient_w_m2_sr" in self.model_fields_set and self.ambient_w_m2_sr:
            raise ValueError(
                f"ambient_w_m2_sr = {self.ambient_w_m2_sr} and an environment are both given; give one of them"
            )
        return self


class RetroPart(Part):
    """Retro-reflective ink (glass beads), by its coefficient of retroreflection R_A."""

    coefficient_cd_lx_m2: PositiveFloat = Field(
        300.0, description="R_A at normal entrance and observation angle zero, in cd / (lx m^2), that is 1 / sr."
    )
    half_entrance_deg: float = Field(
        45.0,
        gt=0,
        le=80,
        description="Entrance angle at which R_A has halved; it falls as 2^-(angle / half)^4, flat at first.",
    )
    half_observation_deg: float = Field(
        0.8, ge=0.1, le=10, description="Observation angle at which R_A has halved; it falls as 2^-(angle / half)^2."
    )
    matt: float = Field(0.35, gt=0, le=0.95, description="The ink's diffuse reflectance, which ordinary light meets.")
    shift_um_at_40_deg: float = Field(
        0.0,
        ge=-1000,
        le=1000,
        description="How far what retro-reflects lies from the print when seen 40 degrees off the normal, towards the "
        "viewer; proportional to the sine. The truth stays at the print.",
    )


class GlossPart(Part):
    """A clear rough coat (GGX) over ink and ground, its light added to that of the matt paint below."""

    roughness: float = Field(0.3, ge=0.01, le=1, description="GGX alpha; below 0.1 the image is path traced.")
    reflectance: float = Field(0.04, gt=0, le=1, description="Reflectance at normal incidence; Schlick's law beyond.")


class LuminousPart(Part):
    """Ink that shines by itself."""

    radiance_w_m2_sr: PositiveFloat = Field(1.0, description="Radiance of the ink, alike in all directions.")


class MeshPart(Part):
    """A body of any shape, matt and of one colour, from a mesh file."""

    name: Name = Field(description="Unique name.")
    file: str = Field(
        min_length=1, max_length=1000, description="STL, OBJ, PLY, GLB or STEP file, relative to the scene file."
    )
    unit: Literal["um", "mm", "cm", "m", "in", "ft"] | None = Field(
        None,
        description="Unit of the file's coordinates; if not given, m for GLB, as glTF defines, and mm for others. "
        "A STEP file states its own.",
    )
    position_mm: Vector3 = Field((0, 0, 0), description="Where the origin of the file's coordinates is.")
    rotation_deg: Vector3 = Field(
        (0, 0, 0), description="Turns about the world's x axis, then its y axis, then its z axis, before it is placed."
    )
    albedo: float = Field(0.5, ge=0, le=0.95, description="Diffuse reflectance.")


class PaintPart(Part):
    """Reflectance of boards, cards and bars."""

    white: float = Field(0.85, gt=0, le=0.95, description="Diffuse reflectance of white.")
    black: float = Field(0.04, ge=0, le=0.95, description="Diffuse reflectance of black.")
    back: float = Field(0.4, ge=0, le=0.95, description="Diffuse reflectance of the backs.")
    white_on_black: bool = Field(True, description="White marks on black ground; false for the reverse.")
    ink: Ink = Field(
        "matt",
        description="Of all marks but those of boards with an `ink` of their own. gloss coats ink and ground; retro "
        "and luminous are the ink's alone.",
    )
    retro: RetroPart = RetroPart()
    gloss: GlossPart = GlossPart()
    luminous: LuminousPart = LuminousPart()
