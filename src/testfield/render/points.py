"""Lights without size: the room's point lights and the camera's ring flash.

In the fast renderer each hit sees each of them along one shadow ray, so the light has no noise and a shadow's edge is
where geometry puts it, to one cell of a pixel. For the path tracer the flash is an emitter of the same points.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from testfield.render.lookup import bin_of
from testfield.render.materials import Materials, coat, retro_coefficient
from testfield.render.variant import mitsuba
from testfield.scene.world import World

MM2_A_M2 = 1e6
LIFT_MM = 0.02
"""Shadow rays begin this far above the surface."""


class Sources:
    """Points of light on the device: `axis` (3,) and `falloff` of their common beam; no axis for all directions."""

    def __init__(self, places_mm: np.ndarray, intensity_w_sr: np.ndarray, axis: np.ndarray | None, falloff: float):
        mi = mitsuba()
        import drjit as dr

        places = np.asarray(places_mm, np.float32).reshape(-1, 3)
        self.count = len(places)
        self.places = [mi.Float(np.ascontiguousarray(places[:, k])) for k in range(3)]
        self.intensity = mi.Float(np.asarray(intensity_w_sr, np.float32) * MM2_A_M2)
        self.beamed = axis is not None
        self.axis = mi.Vector3f(*[mi.Float(float(v)) for v in (axis if axis is not None else np.zeros(3))])
        self.falloff = falloff
        dr.make_opaque(self.places, self.intensity, self.axis)

    def place(self, index: Any) -> Any:
        """Where a point is."""
        mi = mitsuba()
        import drjit as dr

        return mi.Point3f(*[dr.gather(mi.Float, values, index) for values in self.places])

    def power(self, index: Any, direction: Any) -> Any:
        """Intensity of a point along a direction away from it, in W/sr times mm^2 a m^2."""
        import drjit as dr

        intensity = dr.gather(mitsuba().Float, self.intensity, index)
        if not self.beamed:
            return intensity
        cosine = dr.maximum(dr.dot(self.axis, direction), 0)
        beam = 1 if self.falloff == 0 else dr.power(dr.maximum(cosine, 1e-12), self.falloff)
        return dr.select(cosine > 0, intensity * beam, 0)


def room_sources(world: World) -> Sources | None:
    """The room's point lights, if there are any."""
    if not world.point_lights:
        return None
    places = np.array([light.position_mm for light in world.point_lights])
    return Sources(places, np.array([light.intensity_w_sr for light in world.point_lights]), None, 0.0)


def flash_sources(world: World, station: int) -> Sources | None:
    """The camera's flash where it is at one station, if it has one."""
    flash = world.flash
    if flash is None:
        return None
    share = np.full(flash.points, flash.intensity_w_sr / flash.points)
    places = flash.places_mm(world.camera_from_world, station)
    return Sources(places, share, world.camera_from_world.R[station, 2], flash.falloff)


def light_from(
    sources: Sources, scene: Any, materials: Materials, position: Any, frame: Any, to_eye: Any, active: Any
) -> tuple[Any, Any, Any]:
    """What all sources do at hits: irradiance (W/m^2), and radiance towards the eye (W/(m^2 sr)) that is sent by fully
    retro-reflecting ink and by the coat.

    `frame` of the panel (x, y, normal); `to_eye` in that frame.
    """
    mi = mitsuba()
    import drjit as dr

    origin = position + LIFT_MM * frame.n

    def body(index: Any, matt: Any, retro: Any, gloss: Any) -> tuple[Any, Any, Any, Any]:
        to = sources.place(index) - origin
        d2 = dr.squared_norm(to)
        distance = dr.sqrt(d2)
        direction = to / distance
        to_light = frame.to_local(direction)
        power = sources.power(index, -direction)
        lit = active & (to_light.z > 0) & (power > 0)
        lit &= ~scene.ray_test(mi.Ray3f(origin, direction, distance * (1 - 1e-4), 0.0, mi.Color0f()), lit)
        square_on = dr.select(lit, power / d2, 0)
        matt += square_on * dr.maximum(to_light.z, 0)
        if materials.retro:
            retro += square_on * retro_coefficient(materials.retro, to_eye, to_light) / dr.maximum(to_eye.z, 1e-3)
        if materials.gloss:
            gloss += dr.select(lit, square_on * coat(materials.gloss, to_eye, to_light), 0)
        return index + 1, matt, retro, gloss

    nothing = dr.zeros(mi.Float, dr.width(position))
    state = (dr.zeros(mi.UInt32, dr.width(position)), nothing, mi.Float(nothing), mi.Float(nothing))
    _, matt, retro, gloss = dr.while_loop(
        state=state, cond=lambda index, *_: index < sources.count, body=body, label="points of light"
    )
    return matt, retro, gloss


@lru_cache
def flash_class() -> type:
    """The flash as an emitter of the path tracer, registered once."""
    mi = mitsuba()
    import drjit as dr

    class Flash(mi.Emitter):  # type: ignore[name-defined]
        def __init__(self, props: Any):
            super().__init__(props)
            self.m_flags = +mi.EmitterFlags.DeltaPosition
            self.sources: Sources | None = None

        def sample_direction(self, it, sample, active=True):  # type: ignore[no-untyped-def]
            sources = self.sources
            assert sources is not None
            index = bin_of(sample.x * sources.count, sources.count)
            ds = dr.zeros(mi.DirectionSample3f)
            ds.p = sources.place(index)
            ds.n = mi.Normal3f(sources.axis)
            ds.time = it.time
            ds.pdf = mi.Float(1)
            ds.delta = mi.Bool(True)
            ds.emitter = mi.EmitterPtr(self)
            to = ds.p - it.p
            ds.dist = dr.norm(to)
            ds.d = to / ds.dist
            value = sources.count * sources.power(index, -ds.d) / dr.square(ds.dist)
            return ds, mi.Color1f(dr.select(active, value, 0))

        def pdf_direction(self, it, ds, active=True):  # type: ignore[no-untyped-def]
            return mi.Float(0)

        def eval_direction(self, it, ds, active=True):  # type: ignore[no-untyped-def]
            return mi.Color1f(0)

        def eval(self, si, active=True):  # type: ignore[no-untyped-def]
            return mi.Color1f(0)

        def bbox(self):  # type: ignore[no-untyped-def]
            return mi.BoundingBox3f()

        def to_string(self):  # type: ignore[no-untyped-def]
            return "Flash[]"

    mi.register_emitter("testfield_flash", Flash)
    return Flash
