"""A Mitsuba sensor with lens distortion, exact per ray.

Mitsuba's own cameras have one focal length and no distortion. This one undistorts each ray by Newton's method
inside the kernel. All numbers that change from view to view are opaque variables, so no view compiles again.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.render.variant import mitsuba

NEWTON_STEPS = 6
FIELD_STEPS = 3


class _DeviceMaths:
    """What a lens formula needs beside plain arithmetic, on the device."""

    @staticmethod
    def sqrt(x: Any) -> Any:
        import drjit as dr

        return dr.sqrt(x)

    @staticmethod
    def atan2(y: Any, x: Any) -> Any:
        import drjit as dr

        return dr.atan2(y, x)

    @staticmethod
    def tan(x: Any) -> Any:
        import drjit as dr

        return dr.tan(x)

    @staticmethod
    def minimum(x: Any, y: Any) -> Any:
        import drjit as dr

        return dr.minimum(x, y)


def _chebyshev(x: Any, count: int) -> list[Any]:
    """The first `count` Chebyshev polynomials."""
    terms = [0 * x + 1, x]
    while len(terms) < count:
        terms.append(2 * x * terms[-1] - terms[-2])
    return terms[:count]


class CameraRays:
    """Maps pixels to rays in the kernel. Pixels are OpenCV's: (0, 0) is the centre of the top-left pixel."""

    def __init__(self, interior: Interior, poses: Poses, station: int):
        mi = mitsuba()
        import drjit as dr

        self.interior = interior
        self.parameters = [mi.Float(float(value)) for value in interior.parameters]
        self.field = [] if interior.residual_px is None else [mi.Float(float(v)) for v in interior.residual_px.ravel()]
        world_from_camera = poses.inverse()
        self.rotation = [[mi.Float(float(v)) for v in row] for row in world_from_camera.R[station]]
        self.origin = mi.Point3f(*[mi.Float(float(v)) for v in world_from_camera.t_mm[station]])
        dr.make_opaque(self.parameters, self.field, self.rotation, self.origin)

    def direction(self, x_px: Any, y_px: Any) -> tuple[Any, Any, Any]:
        """World direction with unit depth along the optical axis, and its derivatives by x and y in px."""
        mi = mitsuba()
        fx, fy, cx, cy, *c = self.parameters
        x_px, y_px = self._without_field(x_px, y_px)
        xd, yd = (x_px - cx) / fx, (y_px - cy) / fy
        lens, maths = self.interior.lens, _DeviceMaths
        x, y = lens.start(mi.Float(xd), mi.Float(yd), maths)
        for _ in range(NEWTON_STEPS):
            ex, ey, xx, xy, yx, yy = lens.image(x, y, c, maths)
            ex, ey, inverse_det = ex - xd, ey - yd, 1 / (xx * yy - xy * yx)
            x, y = x - (yy * ex - xy * ey) * inverse_det, y - (xx * ey - yx * ex) * inverse_det
        _, _, xx, xy, yx, yy = lens.image(x, y, c, maths)
        inverse_det = 1 / (xx * yy - xy * yx)
        by_x = self._rotate(yy * inverse_det / fx, -yx * inverse_det / fx, mi.Float(0))
        by_y = self._rotate(-xy * inverse_det / fy, xx * inverse_det / fy, mi.Float(0))
        return self._rotate(x, y, mi.Float(1)), by_x, by_y

    def _without_field(self, x_px: Any, y_px: Any) -> tuple[Any, Any]:
        """Pixels before the residual field moved them; its slope is far too small to change a footprint."""
        if not self.field:
            return x_px, y_px
        degree = self.interior.residual_px.shape[1]  # type: ignore[union-attr]
        x, y = x_px, y_px
        for _ in range(FIELD_STEPS):
            columns = _chebyshev((x + 0.5) * (2 / self.interior.width_px) - 1, degree)
            rows = _chebyshev((y + 0.5) * (2 / self.interior.height_px) - 1, degree)
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

    def _rotate(self, x: Any, y: Any, z: Any) -> Any:
        return mitsuba().Vector3f(*[row[0] * x + row[1] * y + row[2] * z for row in self.rotation])


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

        def sample_ray(self, time, wavelength_sample, position_sample, aperture_sample, active=True):  # type: ignore[no-untyped-def]
            # position_sample covers the crop window; Mitsuba's origin is the corner of the top-left pixel.
            film = self.film()
            size, offset = film.crop_size(), film.crop_offset()
            x_px = position_sample.x * float(size[0]) + float(offset[0]) - 0.5
            y_px = position_sample.y * float(size[1]) + float(offset[1]) - 0.5
            assert self.rays is not None
            direction, _, _ = self.rays.direction(x_px, y_px)
            ray = mi.Ray3f(self.rays.origin, dr.normalize(direction), time, mi.Color0f())
            return ray, mi.Color1f(1.0)

        def sample_ray_differential(self, time, wavelength_sample, position_sample, aperture_sample, active=True):  # type: ignore[no-untyped-def]
            ray, weight = self.sample_ray(time, wavelength_sample, position_sample, aperture_sample, active)
            return mi.RayDifferential3f(ray), weight

        def to_string(self):  # type: ignore[no-untyped-def]
            return "DistortedCamera[]"

        def bbox(self):  # type: ignore[no-untyped-def]
            return mi.BoundingBox3f()

    mi.register_sensor("testfield_camera", DistortedCamera)
    return DistortedCamera


def mitsuba_sensor(interior: Interior, poses: Poses, station: int) -> Any:
    """A Mitsuba sensor of one station, with a box filter and a float32 film."""
    _camera_class()
    sensor = mitsuba().load_dict(
        {
            "type": "testfield_camera",
            "film": {
                "type": "hdrfilm",
                "width": interior.width_px,
                "height": interior.height_px,
                "rfilter": {"type": "box"},
                "pixel_format": "luminance",
                "component_format": "float32",
            },
        }
    )
    sensor.rays = CameraRays(interior, poses, station)
    return sensor


def opaque_float(value: float) -> Any:
    """A number that does not become part of the kernel's code."""
    import drjit as dr

    return dr.opaque(mitsuba().Float, float(np.float32(value)))
