"""Radiance that a hit on a panel sends towards the eye, without noise.

The matt part under known light, and where the world asks for it: lights without size, retro-reflection, luminous ink.
A coat's reflection of lamps and surroundings is sampled (`gloss.py`); that of lights without size is exact and here.
"""

from typing import Any

from testfield.render.irradiance import IrradianceSum
from testfield.render.materials import retro_reflectance, retro_shift_mm
from testfield.render.points import LIFT_MM, Sources, light_from
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba
from testfield.scene.world import GLOSS, LUMINOUS, RETRO


def shade(
    stage: Stage, lookup: IrradianceSum, sources: list[Sources], hit: Any, towards: Any, faces: Any, parts: int
) -> Any:
    """Radiance of hits (with their footprints) along unit vectors `towards` the eye, where they face it."""
    mi = mitsuba()
    import drjit as dr

    materials, panel = stage.materials, stage.texture.panel(hit)
    reflectance = stage.texture.reflectance(hit, parts)
    radiance = reflectance * lookup.at(panel, hit.uv) / dr.pi
    if not sources and not materials.special:
        return radiance
    frame = mi.Frame3f(dr.normalize(hit.dp_du), dr.normalize(hit.dp_dv), hit.n)
    # A miss has no frame; a place on a panel must never come from what is not a number.
    to_eye = dr.select(faces, frame.to_local(towards), mi.Vector3f(0, 0, 1))
    returned, coated = mi.Float(0), mi.Float(0)
    for source in sources:
        matt, retro, gloss = light_from(source, stage.scene, materials, hit.p, frame, to_eye, faces)
        radiance += reflectance * matt / dr.pi
        returned += retro
        coated += gloss
    if materials.gloss:
        radiance += dr.select(materials.carries(panel, GLOSS), coated, 0)
    if materials.luminous_radiance:
        ink = stage.texture.coverage(hit, (0.0, 0.0), parts)
        radiance += dr.select(materials.carries(panel, LUMINOUS), ink * materials.luminous_radiance, 0)
    if materials.retro:
        ink = stage.texture.coverage(hit, retro_shift_mm(materials.retro, to_eye), parts)
        ink = dr.select(faces & materials.carries(panel, RETRO), ink, 0)
        # Of the room, ink sends back what lies behind the eye; the lobe is narrow, so one ray stands for it.
        back = mi.Ray3f(mi.Point3f(hit.p + LIFT_MM * hit.n), towards)
        behind = _behind(stage, lookup, back, ink > 0)
        radiance += ink * (returned + behind * retro_reflectance(materials.retro, to_eye))
    return radiance


def _behind(stage: Stage, lookup: IrradianceSum, ray: Any, active: Any) -> Any:
    """Radiance that arrives along rays from matt surfaces in the room's light, from lamps and from all around."""
    mi = mitsuba()
    import drjit as dr

    hit = stage.scene.ray_intersect(ray, ray_flags=mi.RayFlags.Minimal | mi.RayFlags.UV, coherent=False, active=active)
    lamp = stage.is_lamp(hit)
    seen = active & stage.is_panel(hit) & (dr.dot(ray.d, hit.n) < 0) & ~lamp
    panel = stage.texture.panel(hit)
    matt = stage.texture.reflectance(hit, 1) * lookup.at(panel, hit.uv) / dr.pi
    emitted = dr.select(active & lamp, hit.emitter(stage.scene).eval(hit, active & lamp)[0], 0)
    return dr.select(seen, matt, emitted)
