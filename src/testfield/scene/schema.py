"""The scene file: every field a person can write, with its unit, its default and what it means."""

import math
import re
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PositiveInt,
    PrivateAttr,
    model_validator,
)

from testfield.choices import LensName
from testfield.scene.bend import curvature_of, extent_mm
from testfield.sensor.presets import presets, with_preset
from testfield.targets.board_pattern import BoardPattern, dictionary

PositiveFloat = Annotated[float, Field(ge=1e-9)]
"""Less is nothing, and would overflow where something is divided by it."""
Vector3 = tuple[float, float, float]
Pair = tuple[float, float]
Size = tuple[PositiveFloat, PositiveFloat]
Ink = Literal["matt", "gloss", "retro", "luminous"]
Count = Annotated[int, Field(ge=1, le=1000)]


def _filename(name: str) -> str:
    """Names of scenes and stations become names of files."""
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", name):
        raise ValueError("give letters, digits, '_', '-' and '.', not beginning with a dot")
    return name


Name = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_filename)]


def _printable(name: str) -> str:
    if not name.isprintable() or ":" in name:
        raise ValueError("give printable characters without ':'")
    return name


Label = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_printable)]


SHORTEST_DIRECTION = 1e-6


def _direction(vector: Vector3) -> Vector3:
    if not any(vector):
        raise ValueError("a direction must not have length zero")
    if math.hypot(*vector) < SHORTEST_DIRECTION:
        raise ValueError(f"a direction must have a length of {SHORTEST_DIRECTION:g} or more")
    return vector


Direction = Annotated[Vector3, AfterValidator(_direction)]


def _dictionary(name: str) -> str:
    dictionary(name)
    return name


Dictionary = Annotated[str, AfterValidator(_dictionary)]


def _preset(name: str) -> str:
    if name not in presets():
        raise ValueError(f"no such sensor; known are {', '.join(sorted(presets()))}")
    return name


PresetName = Annotated[str, AfterValidator(_preset)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _Box(_Part):
    """Fields of a box."""

    low_mm: Vector3 = Field(description="Corner of the box.")
    high_mm: Vector3 = Field(description="Opposite corner.")

    @model_validator(mode="after")
    def _ordered(self) -> "_Box":
        if any(a > b for a, b in zip(self.low_mm, self.high_mm, strict=True)):
            raise ValueError(f"low_mm {list(self.low_mm)} is not below high_mm {list(self.high_mm)}")
        return self


class VolumePart(_Part):
    """The measuring volume."""

    size_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        (4000, 3000, 2000), description="Edges of the volume; its diagonal scales relative accuracy."
    )


class ResidualField(_Part):
    """A smooth field of displacements on top of the lens model: the true lens is richer than what is calibrated."""

    rms_px: float = Field(0.05, ge=0, le=5, description="Root mean square displacement over the image.")
    degree: int = Field(6, ge=3, le=12, description="Highest degree of the Chebyshev polynomials in x and y, plus one.")
    seed: int = Field(0, ge=0, description="Another seed gives another field.")


class MotionPart(_Part):
    """A steady motion while the shutter is open."""

    velocity_mm_s: Vector3 = Field((0, 0, 0), description="Linear velocity; camera: x right, y down, z forward.")
    angular_velocity_deg_s: Vector3 = Field((0, 0, 0), description="Rotation about the axes, right-handed.")


class TargetMotionPart(MotionPart):
    """A steady motion, in the world, of all that carries marks: boards, bars, check targets. The room stands still."""

    about_mm: Vector3 = Field((0, 0, 0), description="The point the rotation goes about.")


class FlashPart(_Part):
    """A ring flash around the lens that travels with the camera: equal points on a circle, shining forwards."""

    on: bool = Field(True, description="Whether it fires.")
    radius_mm: PositiveFloat = Field(40.0, description="Radius of the ring.")
    points: int = Field(16, ge=1, le=256, description="Equal points on the ring.")
    radiant_intensity_w_sr: PositiveFloat = Field(description="Of the whole ring, along the optical axis.")
    falloff_exponent: float = Field(
        1.0, ge=0, le=100, description="Intensity falls as cos^n of the angle from the optical axis."
    )


class CameraPart(_Part):
    """The camera body and its lens, as they truly are. The measuring side is told only the image size."""

    width_px: int = Field(2448, ge=64, le=20000, description="Image width.")
    height_px: int = Field(2048, ge=64, le=20000, description="Image height.")
    pixel_pitch_um: float = Field(3.45, gt=0.5, lt=50, description="Distance of neighbouring pixels.")
    focal_length_mm: float = Field(12.0, gt=1, lt=2000, description="Principal distance.")
    aspect: float = Field(1.0, gt=0.5, lt=2, description="fy / fx.")
    principal_point_offset_px: Pair = Field((0, 0), description="Principal point minus the image's middle, x and y.")
    lens: LensName = Field(
        "brown",
        description="brown (k1 k2 k3 p1 p2), brown_shear (the same with the sensor's axes out of square), rational "
        "(OpenCV's 12 coefficients), fisheye (Kannala-Brandt k1-k4).",
    )
    k1: float = Field(0, description="First radial coefficient, OpenCV's normalised convention.")
    k2: float = Field(0, description="Second radial coefficient.")
    k3: float = Field(0, description="Third radial coefficient.")
    k4: float = Field(0, description="Fourth radial coefficient (rational: of the denominator).")
    k5: float = Field(0, description="Second of the denominator (rational).")
    k6: float = Field(0, description="Third of the denominator (rational).")
    p1: float = Field(0, description="First decentring coefficient (brown, brown_shear, rational).")
    p2: float = Field(0, description="Second decentring coefficient (brown, brown_shear, rational).")
    shear: float = Field(0, description="By how much x grows with y, both displaced and normalised (brown_shear).")
    s1: float = Field(0, description="Thin prism in x (rational).")
    s2: float = Field(0, description="Thin prism in x, higher order (rational).")
    s3: float = Field(0, description="Thin prism in y (rational).")
    s4: float = Field(0, description="Thin prism in y, higher order (rational).")
    residual_field: ResidualField | None = Field(None, description="Displacements that the lens model does not know.")
    f_number: PositiveFloat = Field(8.0, description="Aperture; sets how much light reaches the sensor.")
    psf_sigma_px: float = Field(
        0.6,
        ge=0,
        le=5,
        description="Optics' blur: sigma of a Gaussian point spread, before the pixel's own area.",
    )
    diffraction: bool = Field(
        False, description="Whether the aperture diffracts light of sensor.wavelength_nm, on top of the optics' blur."
    )
    focus_mm: PositiveFloat | None = Field(
        None, description="Depth of the plane in focus; absent, everything is. focal_length_mm is then the principal "
        "distance at this focus.",
    )  # fmt: skip
    vignetting: Vector3 = Field(
        (0, 0, 0), description="Coefficients of r^2, r^4, r^6 by which light is weakened, r in half-diagonals."
    )
    natural_vignetting: bool = Field(False, description="Fall-off with the fourth power of the field angle's cosine.")
    motion: MotionPart | None = Field(None, description="How the camera moves during the exposure, in its own frame.")
    flash: FlashPart | None = Field(None, description="Ring flash around the lens.")


class SensorPart(_Part):
    """The sensor, with the figures of an EMVA 1288 data sheet. The defaults are of a global-shutter CMOS of 3.45 um."""

    preset: PresetName | None = Field(
        None,
        exclude=True,  # by then its figures stand in the other fields
        description="A sensor of `testfield list`: its data sheet's figures stand wherever the scene gives none, also "
        "for the camera's width_px, height_px and pixel_pitch_um.",
    )
    bits: int = Field(12, ge=8, le=16, description="Bits of the converter; stored in 16-bit PNG.")
    quantum_efficiency: float = Field(0.63, gt=0, le=1, description="Electrons a photon at the wavelength.")
    full_well_e: PositiveFloat = Field(10400, description="Electrons at which a pixel saturates.")
    read_noise_e: float = Field(2.3, ge=0, description="Temporal dark noise, rms.")
    gain_e_per_dn: PositiveFloat = Field(2.6, description="Electrons a digital number.")
    black_level_dn: float = Field(64, ge=0, description="Offset added before quantisation.")
    wavelength_nm: float = Field(550, gt=300, lt=1100, description="Wavelength at which photons are counted.")
    dark_current_e_per_s: float = Field(0, ge=0, description="Electrons a second without light, with their shot noise.")
    prnu: float = Field(
        0, ge=0, lt=1, description="Relative standard deviation of the pixels' response; the same in every frame."
    )
    dsnu_e: float = Field(
        0, ge=0, description="Standard deviation of the pixels' dark offsets; the same in every frame."
    )
    bayer: Literal["RGGB", "BGGR", "GRBG", "GBRG"] | None = Field(
        None, description="Colour filters of the top left two pixels, then of the two below; absent for none."
    )
    bayer_response: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        (1.0, 1.0, 1.0), description="Relative response behind the red, green and blue filters at the scene's light."
    )


class ExposurePart(_Part):
    """How long light is gathered."""

    time_ms: PositiveFloat = Field(20.0, description="Exposure time.")
    shutter: Literal["global", "rolling"] = Field("global", description="All rows at once, or one after the other.")
    row_time_us: float = Field(
        0, ge=0, description="rolling: time from one row's beginning to the next's; the truth is as it stands in the "
        "middle of the middle row's exposure.",
    )  # fmt: skip


class NamedCameraPart(CameraPart):
    """One of several cameras."""

    name: Name = Field(description="Unique name; images are called after their station and it.")
    sensor: SensorPart | None = Field(None, description="Its sensor; absent, the scene's.")
    exposure: ExposurePart | None = Field(None, description="Its exposure; absent, the scene's.")


class RigMemberPart(_Part):
    """A camera in its rig. The rig's frame is such as a camera's: x right, y down, z forward."""

    camera: Name = Field(description="Name of the camera.")
    position_mm: Vector3 = Field((0, 0, 0), description="Its projection centre in the rig's frame.")
    rotation_deg: Vector3 = Field(
        (0, 0, 0), description="Rotation vector that turns the rig's axes into its own: (0, 8, 0) looks to the right."
    )
    u_position_mm: PositiveFloat | None = Field(
        None, description="Standard uncertainty with which its position beside the rig's first camera is stated; with "
        "u_rotation_deg absent, nothing is stated.",
    )  # fmt: skip
    u_rotation_deg: PositiveFloat | None = Field(
        None, description="The same of its turn about each axis, beside the rig's first camera."
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> "RigMemberPart":
        if (self.u_position_mm is None) != (self.u_rotation_deg is None):
            raise ValueError("give both u_position_mm and u_rotation_deg, or none of them")
        return self


class RigPart(_Part):
    """A bar or a frame that holds cameras at poses that stay the same from station to station."""

    name: Name = Field(description="Unique name.")
    cameras: tuple[RigMemberPart, ...] = Field(min_length=2, max_length=100, description="The cameras that it holds.")


class ExtensionZone(_Part):
    """A grid of plain circular dots."""

    columns: Count = Field(10, description="Dots in x.")
    rows: Count = Field(9, description="Dots in y.")
    pitch_mm: PositiveFloat = Field(75, description="Distance of neighbouring dots.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of each dot.")
    centre_mm: Pair = Field(
        (0, 0), description="Middle of the grid on the board, x right and y up from the board's middle."
    )


class RecognitionZone(_Part):
    """A grid of ring-coded targets with consecutive numbers, or those listed."""

    columns: Count = Field(3, description="Targets in x.")
    rows: Count = Field(4, description="Targets in y.")
    pitch_mm: PositiveFloat = Field(150, description="Distance of neighbouring targets.")
    diameter_mm: PositiveFloat = Field(
        20, description="Diameter of the central dot; the ring reaches three times as far."
    )
    centre_mm: Pair = Field((0, 0), description="Middle of the grid on the board.")
    first_code: PositiveInt | None = Field(
        None, description="Number of the first target; the rest follow row by row from the top left."
    )
    codes: tuple[PositiveInt, ...] | None = Field(None, description="Numbers one by one instead of first_code.")


class CharucoPart(_Part):
    """A ChArUco board: a checkerboard, black at its top left, with a tag in each white square."""

    kind: Literal["charuco"] = Field(description="A checkerboard with tags.")
    columns: int = Field(ge=2, le=100, description="Squares in x.")
    rows: int = Field(ge=2, le=100, description="Squares in y.")
    square_mm: PositiveFloat = Field(description="Side of a square.")
    marker_mm: PositiveFloat = Field(description="Side of a tag, its black border included.")
    dictionary: Dictionary = Field("DICT_4X4_50", description="OpenCV's dictionary of the tags.")
    first_tag: int = Field(0, ge=0, description="Number of the first tag; the rest follow row by row.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(
            self.kind, self.columns, self.rows, self.square_mm, self.marker_mm, self.dictionary, self.first_tag
        )

    @model_validator(mode="after")
    def _tags(self) -> "CharucoPart":
        if self.marker_mm >= self.square_mm:
            raise ValueError(f"marker_mm {self.marker_mm:g} is not smaller than square_mm {self.square_mm:g}")
        _enough_tags(self.pattern)
        return self


class CheckerboardPart(_Part):
    """A checkerboard, black at its top left. One of columns and rows is odd, or nobody could tell which way is up."""

    kind: Literal["checkerboard"] = Field(description="Squares alone.")
    columns: int = Field(ge=4, le=100, description="Squares in x.")
    rows: int = Field(ge=4, le=100, description="Squares in y.")
    square_mm: PositiveFloat = Field(description="Side of a square.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.square_mm)

    @model_validator(mode="after")
    def _one_way_up(self) -> "CheckerboardPart":
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"{self.columns} x {self.rows} squares look the same upside down; add a column or a row of them"
            )
        return self


class TagGridPart(_Part):
    """A grid of ArUco tags or AprilTags, whose outer corners are measured."""

    kind: Literal["aruco", "apriltag"] = Field(description="Tags in a grid.")
    columns: int = Field(ge=1, le=100, description="Tags in x.")
    rows: int = Field(ge=1, le=100, description="Tags in y.")
    marker_mm: PositiveFloat = Field(description="Side of a tag, its black border included.")
    gap_mm: PositiveFloat = Field(description="White between neighbouring tags.")
    dictionary: Dictionary | None = Field(
        None, description="OpenCV's dictionary; absent: DICT_4X4_50, for apriltag DICT_APRILTAG_36h11."
    )
    first_tag: int = Field(0, ge=0, description="Number of the first tag; the rest follow row by row.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        names = self.dictionary or ("DICT_4X4_50" if self.kind == "aruco" else "DICT_APRILTAG_36h11")
        pitch_mm = self.marker_mm + self.gap_mm
        return BoardPattern("tags", self.columns, self.rows, pitch_mm, self.marker_mm, names, self.first_tag)

    @model_validator(mode="after")
    def _tags(self) -> "TagGridPart":
        april = self.pattern.names.upper().startswith("DICT_APRILTAG")
        if april != (self.kind == "apriltag"):
            raise ValueError(f"'{self.dictionary}' is no dictionary of {self.kind} tags")
        _enough_tags(self.pattern)
        return self


class CirclesPart(_Part):
    """A symmetric grid of plain dots. It looks the same upside down, so cameras must see it more or less upright."""

    kind: Literal["circles"] = Field(description="A symmetric grid of dots.")
    columns: int = Field(ge=3, le=1000, description="Dots in x, more than rows.")
    rows: int = Field(ge=2, le=1000, description="Dots in y.")
    pitch_mm: PositiveFloat = Field(description="Distance of neighbouring dots.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each dot.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.pitch_mm, self.diameter_mm)

    @model_validator(mode="after")
    def _longer_than_high(self) -> "CirclesPart":
        if self.columns <= self.rows:
            raise ValueError(f"columns ({self.columns}) must exceed rows ({self.rows}): they tell x from y")
        return self


class AsymmetricCirclesPart(_Part):
    """An asymmetric grid of plain dots, as OpenCV counts it: every other row is shifted by `pitch_mm`."""

    kind: Literal["acircles"] = Field(description="An asymmetric grid of dots.")
    columns: int = Field(ge=2, le=1000, description="Dots in a row.")
    rows: int = Field(ge=3, le=1000, description="Rows, an odd number of them: of an even one nobody can tell the top.")
    pitch_mm: PositiveFloat = Field(description="Distance of rows, and half the distance of neighbours in a row.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each dot.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.pitch_mm, self.diameter_mm)

    @model_validator(mode="after")
    def _one_way_up(self) -> "AsymmetricCirclesPart":
        if self.rows % 2 == 0:
            raise ValueError(f"{self.rows} rows look the same upside down; give an odd number")
        return self


PatternPart = Annotated[
    CharucoPart | CheckerboardPart | TagGridPart | CirclesPart | AsymmetricCirclesPart, Field(discriminator="kind")
]


def _enough_tags(pattern: BoardPattern) -> None:
    there = len(dictionary(pattern.names).bytesList)
    if len(pattern.tags) and pattern.tags[-1] >= there:
        raise ValueError(f"tags to number {pattern.tags[-1]} are needed, and {pattern.names} ends at {there - 1}")


class DirtPart(_Part):
    """Round spots of dirt at random places of a board, over ground and marks."""

    count: Count = Field(description="How many.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each.")
    albedo: float = Field(0.25, ge=0, le=0.95, description="Diffuse reflectance.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


class BoardPart(_Part):
    """A sub-board with its two zones: flat by its certificate, and in truth where `bow_mm` is 0."""

    name: Label = Field(description="Unique name.")
    size_mm: Size = Field((1100, 800), description="Width and height.")
    thickness_mm: PositiveFloat = Field(10, description="The back lies this far behind the front.")
    position_mm: Vector3 = Field(description="Where the middle of the front is.")
    normal: Direction = Field((0, -1, 0), description="Direction the front faces; any length.")
    spin_deg: float = Field(0, description="Rotation about the normal, counter-clockwise seen from the front.")
    extension_zone: ExtensionZone = Field(ExtensionZone(), description="The plain dots.")
    recognition_zone: RecognitionZone = Field(RecognitionZone(first_code=1), description="The coded targets.")
    pattern: PatternPart | None = Field(
        None, description="In the place of both zones: a board of squares, tags or circles. Squares and tags are black "
        "on white whatever paint.white_on_black says, and their lines have no errors but the boards' common scale.",
    )  # fmt: skip
    ink: Ink | None = Field(None, description="Material of its ink; absent, that of paint.ink.")
    print_sigma_mm: float = Field(
        0.01, ge=0, le=10, description="Standard deviation of each mark's true x and y about the nominal."
    )
    scale_error_ppm: float = Field(
        0, ge=-100000, le=100000,
        description="By how much this board is printed larger than the scale all boards share; its certificate knows "
        "nothing of it.",
    )  # fmt: skip
    bow_mm: float = Field(
        0,
        description="How far the middle stands out from the edges across the bending axis, positive towards the "
        "viewer: the printed sheet is bent to a circular cylinder without stretching, and its certificate knows "
        "nothing of it.",
    )
    bow_axis_deg: float = Field(
        90, description="Direction of the bending axis on the board, counter-clockwise from its x; 90 is upright."
    )

    dirt: DirtPart | None = Field(None, description="Spots of dirt; absent for a clean board.")

    @model_validator(mode="after")
    def _bendable(self) -> "BoardPart":
        curvature_of(self.bow_mm, extent_mm(self.size_mm, math.radians(self.bow_axis_deg)))
        return self

    @model_validator(mode="after")
    def _one_print(self) -> "BoardPart":
        if self.pattern is None:
            return self
        zones = sorted(self.model_fields_set & {"extension_zone", "recognition_zone"})
        if zones:
            raise ValueError(f"a board with a pattern has no {' or '.join(zones)}")
        printed = self.pattern.pattern
        if not printed.has_corners:
            return self
        if self.bow_mm:
            raise ValueError(f"a board of squares or tags ({self.pattern.kind}) is flat; set bow_mm to 0")
        if "print_sigma_mm" in self.model_fields_set and self.print_sigma_mm:
            raise ValueError(
                f"the lines of a {self.pattern.kind} board are printed in one piece; leave out print_sigma_mm"
            )
        return self


class MovePart(_Part):
    """Where a scale bar lies at a later time."""

    position_mm: Vector3 = Field(description="Where its middle is.")
    direction: Direction = Field((1, 0, 0), description="From the first target to the second; any length.")
    normal: Direction = Field((0, -1, 0), description="Direction the targets face.")


class ScaleBarPart(_Part):
    """A bar with a ring-coded target at either end."""

    name: Label = Field(description="Unique name.")
    role: Literal["control", "check"] = Field(
        description="control: its length enters the calibration; check: it only tests it."
    )
    length_mm: float = Field(gt=10, description="Certified distance between the two targets' centres.")
    u_length_mm: float = Field(
        0.005,
        ge=0,
        description="Standard uncertainty of the certified length; the true length differs by a draw from it.",
    )
    codes: tuple[PositiveInt, PositiveInt] = Field(description="Numbers of the two targets.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the targets' central dots.")
    position_mm: Vector3 = Field(description="Where the middle of the bar is.")
    direction: Direction = Field((1, 0, 0), description="From the first target to the second; any length.")
    normal: Direction = Field((0, -1, 0), description="Direction the targets face; made square to `direction`.")
    moves: tuple[MovePart, ...] = Field(
        (), max_length=1000, description="Where it lies at later times, at each of which every camera takes an image."
    )


class CheckSingle(_Part):
    """One check target on a card of its own."""

    generator: Literal["single"] = "single"
    code: PositiveInt = Field(description="Its number.")
    position_mm: Vector3 = Field(description="Where its centre is.")
    normal: Direction = Field((0, -1, 0), description="Direction it faces.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dot.")


class CheckOnBoard(_Part):
    """One check target stuck on a board; the board's sheet does not list it."""

    generator: Literal["on_board"]
    board: str = Field(description="The board's name.")
    code: PositiveInt = Field(description="Its number.")
    xy_mm: Pair = Field(description="Where it is on the board, from the board's middle.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dot.")


class CheckGrid(_Box):
    """Check targets on a regular lattice in the volume."""

    generator: Literal["grid"]
    first_code: PositiveInt = Field(description="Number of the first; the rest follow, x fastest, then y, then z.")
    counts: tuple[Count, Count, Count] = Field(description="How many along x, y and z.")
    normal: Direction = Field((0, -1, 0), description="Direction all face.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")


class CheckRandom(_Box):
    """Check targets at random places of a box, apart from each other and clear of the boards."""

    generator: Literal["random"]
    first_code: PositiveInt = Field(description="Number of the first.")
    count: Count = Field(description="How many.")
    normal: Direction = Field((0, -1, 0), description="Mean direction they face.")
    spread_deg: float = Field(25, ge=0, lt=90, description="Each faces within this angle of the mean direction.")
    spacing_mm: float = Field(200, ge=0, description="Least distance between any two.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


class CheckOnMesh(_Part):
    """Check targets stuck on a mesh: flat stickers that touch its surface."""

    generator: Literal["on_mesh"]
    mesh: str = Field(description="The mesh's name.")
    first_code: PositiveInt = Field(description="Number of the first.")
    points_mm: tuple[Vector3, ...] | None = Field(
        None, min_length=1, description="Points in the world; each target sits where the surface is nearest to one."
    )
    count: Count | None = Field(None, description="How many at random places of the surface, instead of points_mm.")
    spacing_mm: float = Field(0, ge=0, description="Least distance between any two random places.")
    facing: Direction | None = Field(None, description="Random places only where the surface faces this direction.")
    within_deg: float = Field(60, gt=0, le=180, description="Angle between the surface's normal and `facing`, at most.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")

    @model_validator(mode="after")
    def _one_of_two(self) -> "CheckOnMesh":
        if (self.points_mm is None) == (self.count is None):
            raise ValueError("give either points_mm or count")
        return self


CheckPart = Annotated[
    CheckSingle | CheckOnBoard | CheckGrid | CheckRandom | CheckOnMesh, Field(discriminator="generator")
]


class MeasuringLinePart(_Part):
    """Check targets along a line, with calibrated distances from the first: for `testfield accept`."""

    name: Label = Field(description="Unique name.")
    first_code: PositiveInt = Field(description="Number of the target at the start; the rest follow along the line.")
    start_mm: Vector3 = Field(description="Where the first target is.")
    direction: Direction = Field(description="From the first target to the others; any length.")
    lengths_mm: tuple[PositiveFloat, ...] = Field(
        min_length=1, max_length=100,
        description="Calibrated distances of the other targets from the first; five or more in VDI/VDE 2634 part 1.",
    )  # fmt: skip
    u_length_mm: float = Field(
        0.002, ge=0, description="Standard uncertainty of these distances; the true ones differ by draws from it."
    )
    normal: Direction = Field((0, -1, 0), description="Direction the targets face.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")

    @model_validator(mode="after")
    def _ascending(self) -> "MeasuringLinePart":
        if any(a >= b for a, b in pairwise(self.lengths_mm)):
            raise ValueError(f"lengths_mm {list(self.lengths_mm)} do not grow from one target to the next")
        return self


class AcceptancePart(_Part):
    """The limit of the length measurement error, E = A + K L but no more than B, for `testfield accept`."""

    a_mm: float = Field(ge=0, description="A: the part that does not depend on the length.")
    k_ppm: float = Field(0, ge=0, description="K: the part that grows with the length, in mm a kilometre.")
    b_mm: PositiveFloat | None = Field(None, description="B: the most that the limit may be; absent for none.")


class Aimed(_Part):
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


class StationPose(_Part):
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


class StationGrid(Aimed, _Box):
    """Stations on a regular lattice."""

    generator: Literal["grid"]
    counts: tuple[Count, Count, Count] = Field(description="How many along x, y and z.")


class StationRandom(Aimed, _Box):
    """Stations at random places of a box."""

    generator: Literal["random"]
    count: Count = Field(description="How many.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


StationPart = Annotated[
    StationSingle | StationPose | StationArc | StationRing | StationGrid | StationRandom,
    Field(discriminator="generator"),
]


class SurfacePart(_Part):
    """A flat surface of the room: floor, wall, screen."""

    name: Label = Field(description="Unique name.")
    size_mm: Size = Field(description="Width and height.")
    position_mm: Vector3 = Field(description="Where its middle is.")
    normal: Direction = Field(description="Direction of the side that is seen.")
    albedo: float = Field(0.5, ge=0, le=0.95, description="Diffuse reflectance.")


class AreaLightPart(_Part):
    """A soft rectangular light."""

    kind: Literal["area"] = Field("area", description="A soft rectangle.")
    size_mm: Size = Field(description="Width and height.")
    position_mm: Vector3 = Field(description="Where its middle is.")
    normal: Direction = Field((0, 0, -1), description="Direction it shines.")
    radiance_w_m2_sr: PositiveFloat = Field(description="Radiance of its surface.")


class PointLightPart(_Part):
    """A light without size, alike in all directions; its shadows are hard."""

    kind: Literal["point"] = Field(description="A light without size.")
    position_mm: Vector3 = Field(description="Where it is.")
    intensity_w_sr: PositiveFloat = Field(description="Radiant intensity.")


LightPart = Annotated[AreaLightPart | PointLightPart, Field(discriminator="kind")]


class GradientPart(_Part):
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


class MapPart(_Part):
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


class RoomPart(_Part):
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


class RetroPart(_Part):
    """Retro-reflective ink (glass beads), by its coefficient of retroreflection R_A."""

    coefficient_cd_lx_m2: PositiveFloat = Field(
        300.0, description="R_A at normal entrance and observation angle zero, in cd / (lx m^2), that is 1 / sr."
    )
    half_entrance_deg: float = Field(
        45.0, gt=0, le=80,
        description="Entrance angle at which R_A has halved; it falls as 2^-(angle / half)^4, flat at first.",
    )  # fmt: skip
    half_observation_deg: float = Field(
        0.8, ge=0.1, le=10, description="Observation angle at which R_A has halved; it falls as 2^-(angle / half)^2."
    )
    matt: float = Field(0.35, gt=0, le=0.95, description="The ink's diffuse reflectance, which ordinary light meets.")
    shift_um_at_40_deg: float = Field(
        0.0, ge=-1000, le=1000,
        description="How far what retro-reflects lies from the print when seen 40 degrees off the normal, towards the "
        "viewer; proportional to the sine. The truth stays at the print.",
    )  # fmt: skip


class GlossPart(_Part):
    """A clear rough coat (GGX) over ink and ground, its light added to that of the matt paint below."""

    roughness: float = Field(0.3, ge=0.01, le=1, description="GGX alpha; below 0.1 the image is path traced.")
    reflectance: float = Field(0.04, gt=0, le=1, description="Reflectance at normal incidence; Schlick's law beyond.")


class LuminousPart(_Part):
    """Ink that shines by itself."""

    radiance_w_m2_sr: PositiveFloat = Field(1.0, description="Radiance of the ink, alike in all directions.")


class MeshPart(_Part):
    """A body of any shape, matt and of one colour, from a mesh file."""

    name: Name = Field(description="Unique name.")
    file: str = Field(
        min_length=1, max_length=1000, description="STL, OBJ, PLY or GLB file, relative to the scene file."
    )
    unit: Literal["um", "mm", "cm", "m", "in", "ft"] | None = Field(
        None, description="Unit of the file's coordinates; if not given, m for GLB, as glTF defines, and mm for others."
    )
    position_mm: Vector3 = Field((0, 0, 0), description="Where the origin of the file's coordinates is.")
    rotation_deg: Vector3 = Field(
        (0, 0, 0), description="Turns about the world's x axis, then its y axis, then its z axis, before it is placed."
    )
    albedo: float = Field(0.5, ge=0, le=0.95, description="Diffuse reflectance.")


class PaintPart(_Part):
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


class RenderPart(_Part):
    """How images are computed."""

    mode: Literal["fast", "path"] = Field(
        "fast", description="fast: exact edges under known light; path: plain path tracing, the reference."
    )
    cells: int = Field(3, ge=1, le=16, description="fast: cells along each side of a pixel.")
    light_spacing_mm: PositiveFloat = Field(60, description="fast: distance of the points at which light is computed.")
    light_paths: int = Field(4096, ge=16, le=10_000_000, description="fast: paths for each of these points.")
    blur_shots: int = Field(
        64, ge=2, le=4096, description="fast: the most sharp pictures whose mean makes a defocused or moved one."
    )
    samples: int = Field(64, ge=1, le=10_000_000, description="path: samples a pixel.")
    noise_target: float = Field(
        0.005, gt=0, le=1,
        description="What must be sampled (gloss) is, until each pixel's standard error is this part of white.",
    )  # fmt: skip
    most_samples: int = Field(
        4096, ge=64, le=10_000_000, description="Where a pixel's sampling ends even if noise_target is not reached."
    )


class MeasurePart(_Part):
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


class CertifiedPosesPart(_Part):
    """What the field sheet says of where boards are, in the frame of the first: the truth and an error drawn from the
    uncertainties given."""

    u_position_mm: float = Field(0, ge=0, le=1000, description="Standard uncertainty of each coordinate; 0 is exact.")
    u_rotation_deg: float = Field(0, ge=0, le=10, description="Standard uncertainty of the turn about each axis.")


class SceneFile(_Part):
    """A scene: the field as it truly is, the camera that sees it, and how it is measured."""

    @model_validator(mode="before")
    @classmethod
    def _with_preset(cls, data: Any) -> Any:
        return with_preset(data) if isinstance(data, dict) else data

    name: Name = Field(description="Name of the scene, also of its run's folder.")
    description: str = Field("", description="One sentence for the report.")
    seed: int = Field(1, ge=0, description="Seed of everything random.")
    code_bits: Literal[8, 10, 12, 14, 16, 20] = Field(14, description="Segments of every ring code.")
    code_radii: Literal["1:2:3", "1:2.5:4"] = Field(
        "1:2:3", description="Radii of every ring code: dot, ring's inner edge, ring's outer edge."
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
        20, ge=0, le=10000,
        description="Standard uncertainty of the scale all boards share (printing, temperature); "
        "the true scale differs by a draw from it.",
    )  # fmt: skip
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
