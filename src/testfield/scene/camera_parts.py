"""The camera of a scene file: body, lens, sensor, exposure, motion, flash; rigs of several."""

from typing import Literal

from pydantic import (
    Field,
    model_validator,
)

from testfield.choices import LensName
from testfield.scene.fields import Name, Pair, Part, PositiveFloat, PresetName, Vector3


class ResidualField(Part):
    """A smooth field of displacements on top of the lens model: the true lens is richer than what is calibrated."""

    rms_px: float = Field(0.05, ge=0, le=5, description="Root mean square displacement over the image.")
    degree: int = Field(6, ge=3, le=12, description="Highest degree of the Chebyshev polynomials in x and y, plus one.")
    seed: int = Field(0, ge=0, description="Another seed gives another field.")


class MotionPart(Part):
    """A steady motion while the shutter is open."""

    velocity_mm_s: Vector3 = Field((0, 0, 0), description="Linear velocity; camera: x right, y down, z forward.")
    angular_velocity_deg_s: Vector3 = Field((0, 0, 0), description="Rotation about the axes, right-handed.")


class TargetMotionPart(MotionPart):
    """A steady motion, in the world, of all that carries marks: boards, bars, check targets. The room stands still."""

    about_mm: Vector3 = Field((0, 0, 0), description="The point the rotation goes about.")


class FlashPart(Part):
    """A ring flash around the lens that travels with the camera: equal points on a circle, shining forwards."""

    on: bool = Field(True, description="Whether it fires.")
    radius_mm: PositiveFloat = Field(40.0, description="Radius of the ring.")
    points: int = Field(16, ge=1, le=256, description="Equal points on the ring.")
    radiant_intensity_w_sr: PositiveFloat = Field(description="Of the whole ring, along the optical axis.")
    falloff_exponent: float = Field(
        1.0, ge=0, le=100, description="Intensity falls as cos^n of the angle from the optical axis."
    )


class CameraPart(Part):
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
    coefficients: dict[str, float] = Field(
        {}, description="Coefficients by name, for a lens model of one's own that has others than these."
    )
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
        None,
        description="Depth of the plane in focus; absent, everything is. focal_length_mm is then the principal "
        "distance at this focus.",
    )
    vignetting: Vector3 = Field(
        (0, 0, 0), description="Coefficients of r^2, r^4, r^6 by which light is weakened, r in half-diagonals."
    )
    natural_vignetting: bool = Field(False, description="Fall-off with the fourth power of the field angle's cosine.")
    motion: MotionPart | None = Field(None, description="How the camera moves during the exposure, in its own frame.")
    flash: FlashPart | None = Field(None, description="Ring flash around the lens.")


class SensorPart(Part):
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


class ExposurePart(Part):
    """How long light is gathered."""

    time_ms: PositiveFloat = Field(20.0, description="Exposure time.")
    shutter: Literal["global", "rolling"] = Field("global", description="All rows at once, or one after the other.")
    row_time_us: float = Field(
        0,
        ge=0,
        description="rolling: time from one row's beginning to the next's; the truth is as it stands in the "
        "middle of the middle row's exposure.",
    )


class NamedCameraPart(CameraPart):
    """One of several cameras."""

    name: Name = Field(description="Unique name; images are called after their station and it.")
    sensor: SensorPart | None = Field(None, description="Its sensor; absent, the scene's.")
    exposure: ExposurePart | None = Field(None, description="Its exposure; absent, the scene's.")


class RigMemberPart(Part):
    """A camera in its rig. The rig's frame is such as a camera's: x right, y down, z forward."""

    camera: Name = Field(description="Name of the camera.")
    position_mm: Vector3 = Field((0, 0, 0), description="Its projection centre in the rig's frame.")
    rotation_deg: Vector3 = Field(
        (0, 0, 0), description="Rotation vector that turns the rig's axes into its own: (0, 8, 0) looks to the right."
    )
    u_position_mm: PositiveFloat | None = Field(
        None,
        description="Standard uncertainty with which its position beside the rig's first camera is stated; with "
        "u_rotation_deg absent, nothing is stated.",
    )
    u_rotation_deg: PositiveFloat | None = Field(
        None, description="The same of its turn about each axis, beside the rig's first camera."
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> "RigMemberPart":
        if (self.u_position_mm is None) != (self.u_rotation_deg is None):
            raise ValueError("give both u_position_mm and u_rotation_deg, or none of them")
        return self


class RigPart(Part):
    """A bar or a frame that holds cameras at poses that stay the same from station to station."""

    name: Name = Field(description="Unique name.")
    cameras: tuple[RigMemberPart, ...] = Field(min_length=2, max_length=100, description="The cameras that it holds.")
