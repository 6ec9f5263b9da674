"""A Mitsuba sensor with lens distortion, depth of field, motion and a rolling shutter, exact per ray.

Mitsuba's own cameras have one focal length and no distortion. This one undistorts each ray by Newton's method
inside the kernel, of a fisheye its angle, which may exceed 90 degrees. All numbers that change from view to view are
opaque variables, so no view compiles again.
"""

from functools import lru_cache
from typing import Any

from testfield.render.device_maths import DeviceMaths, DeviceTwist, Rays, chebyshev
from testfield.render.variant import mitsuba
from testfield.render.vignetting import Vignetting, vignettes
from testfield.scene.world import World

NEWTON_STEPS, ANGLE_STEPS = 6, 12
FIELD_STEPS = 3


class CameraRays:
    """Maps pixels to rays in the kernel. Pixels are OpenCV's: (0, 0) is the centre of the top-left pixel."""

    def __init__(self, world: World, station: int):
        mi = mitsuba()
        import drjit as dr

        interior, optics, motion = world.interior, world.optics, world.motion
        self.interior, self.motion = interior, motion
        self.parameters = [mi.Float(float(value)) for value in interior.parameters]
        # In single precision a principal point alone is off by 1e-4 px, all over the image.
        fx, fy, cx, cy, *_ = interior.parameters
        self.pixel = [mi.Float64(float(value)) for value in (cx, cy, 1 / fx, 1 / fy)]
        self.field = [] if interior.residual_px is None else [mi.Float(float(v)) for v in interior.residual_px.ravel()]
        world_from_camera = world.camera_from_world.inverse()
        self.rotation = [[mi.Float(float(v)) for v in row] for row in world_from_camera.R[station]]
        self.turn = [[mi.Float64(float(v)) for v in row] for row in world_from_camera.R[station]]
        self.origin = mi.Point3f(*[mi.Float(float(v)) for v in world_from_camera.t_mm[station]])
        self.focus_mm = mi.Float(optics.focus_mm) if optics.aperture_mm else None
        self.pupil_mm = mi.Float(optics.aperture_mm / 2)
        self.twist = DeviceTwist(motion.camera) if motion.camera.moves else None
        self.middle_row = mi.Float((interior.height_px - 1) / 2)
        self.row_s, self.exposure_s = mi.Float(motion.row_s), mi.Float(motion.exposure_s)
        timing = self.middle_row, self.row_s, self.exposure_s
        angle = interior.lens.last_angle
        self.last_angle = None if angle is None else mi.Float(angle(interior.coefficients))
        if self.last_angle is not None:
            dr.make_opaque(self.last_angle)
        dr.make_opaque(
            self.parameters, self.pixel, self.field, self.rotation, self.turn, self.origin, self.pupil_mm, *timing
        )
        if self.focus_mm is not None:
            dr.make_opaque(self.focus_mm)

    def at(self, x_px: Any, y_px: Any, pupil_x_mm: Any = 0.0, pupil_y_mm: Any = 0.0, time_s: Any = 0.0) -> Rays:
        """Rays of pixels through a point of the entrance pupil, `time_s` from the middle of their rows' exposures."""
        mi = mitsuba()
        import drjit as dr

        direction, by_x, by_y = self._undistorted(x_px, y_px)
        origin = mi.Vector3f(0, 0, 0)
        time = mi.Float(time_s)
        if self.focus_mm is not None:
            # All rays of a pixel meet on the plane in focus.
            pupil = mi.Vector3f(pupil_x_mm, pupil_y_mm, 0)
            origin, direction = origin + pupil, direction - pupil * (direction.z / self.focus_mm)
        cosine = direction.z / dr.norm(direction)
        if self.motion.moves and self.motion.row_s:
            time = time + (y_px - self.middle_row) * self.row_s
        if self.twist is not None:
            origin = self.twist.turn(origin, time) + self.twist.velocity * time
            direction, by_x, by_y = (self.twist.turn(v, time) for v in (direction, by_x, by_y))
        if self.focus_mm is None and self.twist is None:
            start = self.origin
        else:
            start = self.origin + self._rotate(origin)
        return Rays(start, self._turned(direction), self._rotate(by_x), self._rotate(by_y), time, cosine)

    def _undistorted(self, x_px: Any, y_px: Any) -> tuple[Any, Any, Any]:
        """Direction in the camera with unit depth, of a fisheye of unit length; its derivatives by x and y in px."""
        mi = mitsuba()
        fx, fy, _, _, *c = self.parameters
        x_px, y_px = self._without_field(x_px, y_px)
        cx, cy, a_pixel_x, a_pixel_y = self.pixel
        xd, yd = mi.Float((x_px - cx) * a_pixel_x), mi.Float((y_px - cy) * a_pixel_y)
        lens, maths = self.interior.lens, DeviceMaths
        if self.last_angle is not None:
            return self._by_angle(xd, yd)
        x, y = mi.Float(xd), mi.Float(yd)
        for _ in range(NEWTON_STEPS):
            ex, ey, xx, xy, yx, yy = lens.image(x, y, c, maths)
            ex, ey, inverse_det = ex - xd, ey - yd, 1 / (xx * yy - xy * yx)
            x, y = x - (yy * ex - xy * ey) * inverse_det, y - (xx * ey - yx * ex) * inverse_det
        _, _, xx, xy, yx, yy = lens.image(x, y, c, maths)
        inverse_det = 1 / (xx * yy - xy * yx)
        by_x = mi.Vector3f(yy * inverse_det / fx, -yx * inverse_det / fx, 0)
        by_y = mi.Vector3f(-xy * inverse_det / fy, xx * inverse_det / fy, 0)
        return mi.Vector3f(x, y, 1), by_x, by_y

    def _by_angle(self, xd: Any, yd: Any) -> tuple[Any, Any, Any]:
        """Of a fisheye: Newton's method for the angle, and bisection wherever a step would leave the bracket."""
        mi = mitsuba()
        import drjit as dr

        fx, fy, _, _, *c = self.parameters
        r = dr.sqrt(xd * xd + yd * yd)
        low, high = mi.Float(0), mi.Float(self.last_angle)
        angle = dr.minimum(r, high)
        for _ in range(ANGLE_STEPS):
            image, slope = self.interior.lens.radial(angle, c)
            low, high = dr.select(image <= r, angle, low), dr.select(image > r, angle, high)
            step = angle - (image - r) / slope
            angle = dr.select((step >= low) & (step <= high), step, (low + high) / 2)
        sine, cosine = dr.sincos(angle)
        slope = self.interior.lens.radial(angle, c)[1]
        away = r > 1e-12
        ux, uy = dr.select(away, xd / r, 0), dr.select(away, yd / r, 0)
        across = dr.select(away, sine / r, 1)
        # Along the radius the angle changes, across it the direction about the axis.
        along = cosine / slope - across
        by_x = mi.Vector3f(across + along * ux * ux, along * ux * uy, -sine / slope * ux) / fx
        by_y = mi.Vector3f(along * ux * uy, across + along * uy * uy, -sine / slope * uy) / fy
        return mi.Vector3f(sine * ux, sine * uy, cosine), by_x, by_y

    def _without_field(self, x_px: Any, y_px: Any) -> tuple[Any, Any]:
        """Pixels before the residual field moved them; its slope is far too small to change a footprint."""
        if not self.field:
            return x_px, y_px
        degree = self.interior.residual_px.shape[1]  # type: ignore[union-attr]
        x, y = x_px, y_px
        for _ in range(FIELD_STEPS):
            columns = chebyshev((x + 0.5) * (2 / self.interior.width_px) - 1, degree)
            rows = chebyshev((y + 0.5) * (2 / self.interior.height_px) - 1, degree)
            moved = [
                sum(
                    self.field[(part * degree + i) * degree + j] * rows[i] * columns[j]
                    for i in range(degree)
                    for j in range(degree)
                )
                for part in (0, 1)
            ]
            x, y = x_px - moved[0], y_px - moved[1]
        return x, y

    def _turned(self, v: Any) -> Any:
        """A direction in the world, rotated in double precision."""
        mi = mitsuba()
        return mi.Vector3f(*[mi.Float(row[0] * v.x + row[1] * v.y + row[2] * v.z) for row in self.turn])

    def _rotate(self, v: Any) -> Any:
        return mitsuba().Vector3f(*[row[0] * v.x + row[1] * v.y + row[2] * v.z for row in self.rotation])


@lru_cache
def _camera_class() -> type:
    """The plugin class, registered once; it needs mitsuba, which is imported only when something renders."""
    mi = mitsuba()
    import drjit as dr

    class DistortedCamera(mi.Sensor):  # type: ignore[name-defined]
        def __init__(self, props: Any):
            super().__init__(props)
            size = self.film().size()
            self.width, self.height = int(size[0]), int(size[1])
            self.rays: CameraRays | None = None
            self.attenuation: Any = None
            self.cells, self.margin = 1, 0
            self.m_needs_sample_3 = True

        def sample_ray(self, time, wavelength_sample, position_sample, aperture_sample, active=True):  # type: ignore[no-untyped-def]
            # position_sample covers the crop window; Mitsuba's origin is the corner of the top-left pixel.
            # The film has `cells` x `cells` pixels for each of the camera's, and `margin` of these all around.
            film = self.film()
            size, offset = film.crop_size(), film.crop_offset()
            x_px = (position_sample.x * float(size[0]) + float(offset[0])) / self.cells - self.margin - 0.5
            y_px = (position_sample.y * float(size[1]) + float(offset[1])) / self.cells - self.margin - 0.5
            assert self.rays is not None
            pupil = mi.warp.square_to_uniform_disk_concentric(aperture_sample) * self.rays.pupil_mm
            rays = self.rays.at(x_px, y_px, pupil.x, pupil.y, (time - 0.5) * self.rays.exposure_s)
            ray = mi.Ray3f(rays.origin, dr.normalize(rays.direction), time, mi.Color0f())
            weight = mi.Float(1) if self.attenuation is None else self.attenuation.at(x_px, y_px, rays)
            return ray, mi.Color1f(weight)

        def sample_ray_differential(self, time, wavelength_sample, position_sample, aperture_sample, active=True):  # type: ignore[no-untyped-def]
            ray, weight = self.sample_ray(time, wavelength_sample, position_sample, aperture_sample, active)
            return mi.RayDifferential3f(ray), weight

        def to_string(self):  # type: ignore[no-untyped-def]
            return "DistortedCamera[]"

        def bbox(self):  # type: ignore[no-untyped-def]
            return mi.BoundingBox3f()

    mi.register_sensor("testfield_camera", DistortedCamera)
    return DistortedCamera


def mitsuba_sensor(world: World, station: int, cells: int = 1, margin: int = 0) -> Any:
    """A Mitsuba sensor of one station, with a box filter and a float32 film.

    The film has `cells` x `cells` pixels for each of the camera's, and `margin` of the camera's pixels all around.
    """
    _camera_class()
    interior = world.interior
    sensor = mitsuba().load_dict(
        {
            "type": "testfield_camera",
            "shutter_open": 0.0,
            "shutter_close": 1.0 if world.motion.moves else 0.0,
            "film": {
                "type": "hdrfilm",
                "width": (interior.width_px + 2 * margin) * cells,
                "height": (interior.height_px + 2 * margin) * cells,
                "rfilter": {"type": "box"},
                "pixel_format": "luminance",
                "component_format": "float32",
            },
        }
    )
    sensor.rays = CameraRays(world, station)
    sensor.attenuation = Vignetting(world) if vignettes(world) else None
    sensor.cells, sensor.margin = cells, margin
    return sensor
