"""The camera of a scene as it truly is: interior orientation, optics, motion, flash."""

import numpy as np

from testfield.camera.interior import Interior, parameter_names
from testfield.camera.lens import all_coefficients
from testfield.camera.motion import Motion, Twist
from testfield.camera.optics import Optics, entrance_pupil_mm
from testfield.errors import TestfieldError
from testfield.scene.camera_parts import MotionPart, TargetMotionPart
from testfield.scene.schema import SceneFile
from testfield.scene.world import (
    RingFlash,
)
from testfield.seeds import Plane


def flash(scene: SceneFile) -> RingFlash | None:
    """The camera's flash, None where it has none or it is off."""
    part = scene.camera.flash
    if part is None or not part.on:
        return None
    return RingFlash(part.radius_mm, part.points, part.radiant_intensity_w_sr, part.falloff_exponent)


def true_interior(scene: SceneFile) -> Interior:
    """The camera's true interior orientation in px."""
    camera = scene.camera
    focal = 1000 * camera.focal_length_mm / camera.pixel_pitch_um
    middle = ((camera.width_px - 1) / 2, (camera.height_px - 1) / 2)
    cx, cy = (m + offset for m, offset in zip(middle, camera.principal_point_offset_px, strict=True))
    own = parameter_names(camera.lens)[4:]
    given = {name: getattr(camera, name, 0.0) for name in sorted(all_coefficients())} | camera.coefficients
    for name, value in given.items():
        if name not in own and (value != 0 or name in camera.coefficients):
            raise TestfieldError(
                f"value {value}: the lens model '{camera.lens}' has no such coefficient",
                f"camera.coefficients.{name}" if name in camera.coefficients else f"camera.{name}",
                f"its coefficients are {', '.join(own)}",
            )
    values = [focal, focal * camera.aspect, cx, cy, *[given[name] for name in own]]
    return Interior(camera.width_px, camera.height_px, np.array(values, float), camera.lens, _residual_field(scene))


def true_optics(scene: SceneFile) -> Optics:
    """What the lens does besides bending light."""
    camera = scene.camera
    airy_um = 1e-3 * scene.sensor.wavelength_nm * camera.f_number
    return Optics(
        0.0 if camera.focus_mm is None else entrance_pupil_mm(camera.focal_length_mm, camera.f_number, camera.focus_mm),
        camera.focus_mm or 0.0,
        airy_um / camera.pixel_pitch_um if camera.diffraction else 0.0,
        camera.vignetting,
        camera.natural_vignetting,
    )


def true_motion(scene: SceneFile) -> Motion:
    """What moves while the shutter is open."""

    def twist(part: MotionPart | None) -> Twist:
        if part is None:
            return Twist()
        x, y, z = np.radians(part.angular_velocity_deg_s).tolist()
        about = part.about_mm if isinstance(part, TargetMotionPart) else (0.0, 0.0, 0.0)
        return Twist(part.velocity_mm_s, (x, y, z), about)

    exposure = scene.exposure
    row_s = 1e-6 * exposure.row_time_us if exposure.shutter == "rolling" else 0.0
    return Motion(twist(scene.camera.motion), twist(scene.target_motion), 1e-3 * exposure.time_ms, row_s)


def _residual_field(scene: SceneFile) -> np.ndarray | None:
    """(2, d, d) Chebyshev coefficients: random, smaller at higher degree, without what pinhole parameters take up."""
    part = scene.camera.residual_field
    if part is None or part.rms_px == 0:
        return None
    order = np.add.outer(np.arange(part.degree), np.arange(part.degree))
    planes = (Plane(scene.seed, f"residual_field/{part.seed}/{axis}") for axis in "xy")
    drawn = np.array([plane.normals(range(part.degree), part.degree) for plane in planes])
    field = np.where(order < 2, 0.0, drawn / np.maximum(order, 1) ** 1.5)
    at = np.linspace(-1, 1, 41)
    values = [np.polynomial.chebyshev.chebgrid2d(at, at, c) for c in field]
    return field * part.rms_px / np.sqrt(np.mean(np.square(values).sum(axis=0)))
