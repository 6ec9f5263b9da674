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


class CameraRays:
    """Maps pixels to rays in the kernel. Pixels are OpenCV's: (0, 0) is the centre of the top-left pixel."""

    def __init__(self, interior: Interior, poses: Poses, station: int):
        mi = mitsuba()
        import drjit as dr

        self.parameters = [mi.Float(float(value)) for value in interior.parameters]
        world_from_camera = poses.inverse()
        self.rotation = [[mi.Float(float(v)) for v in row] for row in world_from_camera.R[station]]
        self.origin = mi.Point3f(*[mi.Float(float(v)) for v in world_from_camera.t_mm[station]])
        dr.make_opaque(self.parameters, self.rotation, self.origin)

    def direction(self, x_px: Any, y_px: Any) -> tuple[Any, Any, Any]:
        """World direction with unit depth along the optical axis, and its derivatives by x and y in px."""
        mi = mitsuba()
        fx, fy, cx, cy, k1, k2, k3, p1, p2 = self.parameters
        xd, yd = (x_px - cx) / fx, (y_px - cy) / fy
        x, y = mi.Float(xd), mi.Float(yd)
        # One step more than the solution needs: the last pass leaves the Jacobian at the solution.
        for step in range(NEWTON_STEPS + 1):
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
            off = x * y * slope + 2 * p1 * x + 2 * p2 * y
            xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
            yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
            inverse_det = 1 / (xx * yy - off * off)
            if step < NEWTON_STEPS:
                ex = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - xd
                ey = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - yd
                x, y = x - (yy * ex - off * ey) * inverse_det, y - (xx * ey - off * ex) * inverse_det
        by_x = self._rotate(yy * inverse_det / fx, -off * inverse_det / fx, mi.Float(0))
        by_y = self._rotate(-off * inverse_det / fy, xx * inverse_det / fy, mi.Float(0))
        return self._rotate(x, y, mi.Float(1)), by_x, by_y

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
