"""The scene file: every field a person can write, with its unit, its default and what it means."""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, model_validator

Vector3 = tuple[float, float, float]
Pair = tuple[float, float]
Size = tuple[PositiveFloat, PositiveFloat]
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


def _direction(vector: Vector3) -> Vector3:
    if not any(vector):
        raise ValueError("a direction must not have length zero")
    return vector


Direction = Annotated[Vector3, AfterValidator(_direction)]


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


class CameraPart(_Part):
    """The camera body and its lens, as they truly are. The measuring side is told only the image size."""

    width_px: int = Field(2448, ge=64, le=20000, description="Image width.")
    height_px: int = Field(2048, ge=64, le=20000, description="Image height.")
    pixel_pitch_um: float = Field(3.45, gt=0.5, lt=50, description="Distance of neighbouring pixels.")
    focal_length_mm: float = Field(12.0, gt=1, lt=2000, description="Principal distance.")
    aspect: float = Field(1.0, gt=0.5, lt=2, description="fy / fx.")
    principal_point_offset_px: Pair = Field((0, 0), description="Principal point minus the image's middle, x and y.")
    lens: Literal["brown", "rational", "fisheye"] = Field(
        "brown",
        description="brown (k1 k2 k3 p1 p2), rational (OpenCV's 12 coefficients), fisheye (Kannala-Brandt k1-k4).",
    )
    k1: float = Field(0, description="First radial coefficient, OpenCV's normalised convention.")
    k2: float = Field(0, description="Second radial coefficient.")
    k3: float = Field(0, description="Third radial coefficient.")
    k4: float = Field(0, description="Fourth radial coefficient (rational: of the denominator).")
    k5: float = Field(0, description="Second of the denominator (rational).")
    k6: float = Field(0, description="Third of the denominator (rational).")
    p1: float = Field(0, description="First decentring coefficient (brown, rational).")
    p2: float = Field(0, description="Second decentring coefficient (brown, rational).")
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


class SensorPart(_Part):
    """The sensor, with the figures of an EMVA 1288 data sheet. The defaults are of a global-shutter CMOS of 3.45 um."""

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


class BoardPart(_Part):
    """A flat sub-board with its two zones."""

    name: Label = Field(description="Unique name.")
    size_mm: Size = Field((1100, 800), description="Width and height.")
    thickness_mm: PositiveFloat = Field(10, description="The back lies this far behind the front.")
    position_mm: Vector3 = Field(description="Where the middle of the front is.")
    normal: Direction = Field((0, -1, 0), description="Direction the front faces; any length.")
    spin_deg: float = Field(0, description="Rotation about the normal, counter-clockwise seen from the front.")
    extension_zone: ExtensionZone = Field(ExtensionZone(), description="The plain dots.")
    recognition_zone: RecognitionZone = Field(RecognitionZone(first_code=1), description="The coded targets.")
    print_sigma_mm: float = Field(
        0.01, ge=0, le=10, description="Standard deviation of each mark's true x and y about the nominal."
    )


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


CheckPart = Annotated[CheckSingle | CheckOnBoard | CheckGrid | CheckRandom, Field(discriminator="generator")]


class _Aimed(_Part):
    look_at_mm: Vector3 = Field((0, 0, 1500), description="Point the optical axis goes through.")
    roll_deg: tuple[float, ...] = Field(
        (0,), description="Rotation about the optical axis, taken in turn by the stations."
    )


class StationSingle(_Aimed):
    """One station."""

    generator: Literal["single"] = "single"
    name: Name | None = Field(None, description="Name of the station; numbered where absent.")
    position_mm: Vector3 = Field(description="Projection centre.")


class StationArc(_Aimed):
    """Stations on a horizontal arc around `look_at_mm`; azimuth 0 looks along +y, positive to the right of it."""

    generator: Literal["arc"]
    count: Count = Field(description="How many.")
    radius_mm: PositiveFloat = Field(description="Horizontal distance from look_at_mm.")
    height_mm: float = Field(description="z of all of them.")
    azimuth_deg: Pair = Field((-45, 45), description="First and last azimuth.")


class StationRing(_Aimed):
    """Stations on a full circle around `look_at_mm` in a plane square to `axis`."""

    generator: Literal["ring"]
    count: Count = Field(description="How many.")
    radius_mm: PositiveFloat = Field(description="Radius of the circle.")
    centre_mm: Vector3 = Field(description="Middle of the circle.")
    axis: Direction = Field((0, 1, 0), description="Direction square to the circle.")


class StationGrid(_Aimed, _Box):
    """Stations on a regular lattice."""

    generator: Literal["grid"]
    counts: tuple[Count, Count, Count] = Field(description="How many along x, y and z.")


class StationRandom(_Aimed, _Box):
    """Stations at random places of a box."""

    generator: Literal["random"]
    count: Count = Field(description="How many.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


StationPart = Annotated[
    StationSingle | StationArc | StationRing | StationGrid | StationRandom, Field(discriminator="generator")
]


class SurfacePart(_Part):
    """A flat surface of the room: floor, wall, screen."""

    name: Label = Field(description="Unique name.")
    size_mm: Size = Field(description="Width and height.")
    position_mm: Vector3 = Field(description="Where its middle is.")
    normal: Direction = Field(description="Direction of the side that is seen.")
    albedo: float = Field(0.5, ge=0, le=0.95, description="Diffuse reflectance.")


class LightPart(_Part):
    """A soft rectangular light."""

    size_mm: Size = Field(description="Width and height.")
    position_mm: Vector3 = Field(description="Where its middle is.")
    normal: Direction = Field((0, 0, -1), description="Direction it shines.")
    radiance_w_m2_sr: PositiveFloat = Field(description="Radiance of its surface.")


class RoomPart(_Part):
    """What stands around the field, and the light."""

    surfaces: tuple[SurfacePart, ...] = Field((), description="Floor, walls and other plain surfaces.")
    lights: tuple[LightPart, ...] = Field((), description="Area lights.")
    ambient_w_m2_sr: float = Field(0.5, ge=0, description="Radiance that comes from every direction no surface hides.")


class PaintPart(_Part):
    """Reflectance of boards, cards and bars."""

    white: float = Field(0.85, gt=0, le=0.95, description="Diffuse reflectance of white.")
    black: float = Field(0.04, ge=0, le=0.95, description="Diffuse reflectance of black.")
    back: float = Field(0.4, ge=0, le=0.95, description="Diffuse reflectance of the backs.")
    white_on_black: bool = Field(True, description="White marks on black ground; false for the reverse.")


class RenderPart(_Part):
    """How images are computed."""

    mode: Literal["fast", "path"] = Field(
        "fast", description="fast: exact edges under known light; path: plain path tracing, the reference."
    )
    cells: int = Field(3, ge=1, le=16, description="fast: cells along each side of a pixel.")
    light_spacing_mm: PositiveFloat = Field(60, description="fast: distance of the points at which light is computed.")
    light_paths: int = Field(4096, ge=16, description="fast: paths for each of these points.")
    samples: int = Field(64, ge=1, description="path: samples a pixel.")


class MeasurePart(_Part):
    """Which algorithms measure the images; `testfield list` shows their names."""

    centroid: str = Field("ellipse_model", description="Centroid estimator.")
    calibrator: str = Field("stitched", description="Calibration method.")
    lens: Literal["brown", "rational", "fisheye"] | None = Field(
        None, description="Lens model to calibrate; absent, that of the camera."
    )
    hold: tuple[str, ...] = Field((), description="Parameters of the calibrated lens that are held at zero, as k5.")
    reconstructor: str = Field("gls", description="Reconstruction method.")
    smallest_diameter_px: float = Field(5.0, ge=3, description="Smaller dots are not looked for.")


class SceneFile(_Part):
    """A scene: the field as it truly is, the camera that sees it, and how it is measured."""

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
    paint: PaintPart = PaintPart()
    room: RoomPart = RoomPart()
    boards: tuple[BoardPart, ...] = Field(
        min_length=1, description="Sub-boards; the first defines the measuring frame."
    )
    u_print_scale_ppm: float = Field(
        20, ge=0, le=10000,
        description="Standard uncertainty of the scale all boards share (printing, temperature); "
        "the true scale differs by a draw from it.",
    )  # fmt: skip
    scale_bars: tuple[ScaleBarPart, ...] = Field((), description="Scale bars.")
    check_targets: tuple[CheckPart, ...] = Field((), description="Targets whose true positions only scoring knows.")
    stations: tuple[StationPart, ...] = Field(
        min_length=1, description="Where the camera is, one by one or by generators."
    )
    render: RenderPart = RenderPart()
    measure: MeasurePart = MeasurePart()
