"""What a coat reflects of lamps, panels and surroundings: sampled, for it changes with the viewer.

Each sample is a ray through a random point of the pixel as its area and the optics' blur weigh it. At a coated panel
light is gathered twice, towards an emitter and along a direction that the coat prefers, and both are joined by the
balance heuristic; the path integrator goes on from there. Lights without size are not part of it: their reflection has
no noise and is in the fast image already.
"""

from typing import Any

import numpy as np

from testfield.render.camera_plugin import CameraRays
from testfield.render.fetch import fetch
from testfield.render.gather import MAX_DEPTH
from testfield.render.materials import coat, coat_pdf, sample_coat
from testfield.render.sampled import Estimate
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba
from testfield.render.vignetting import Vignetting, vignettes
from testfield.scene.world import GLOSS


def gloss_estimate(stage: Stage, station: int) -> Estimate:
    """Samples of the radiance that coats send to one station's pixels."""
    return pixel_estimate(stage, station, lambda sampler, ray: _reflected(stage, sampler, ray))


def pixel_estimate(stage: Stage, station: int, radiance: Any) -> Estimate:
    """Samples of `radiance(sampler, ray)` over pixels, weighed by their area and the Gaussian of the world's optics."""
    mi = mitsuba()
    import drjit as dr

    world = stage.world
    rays = CameraRays(world, station)
    vignetting = Vignetting(world) if vignettes(world) else None
    sigma = dr.opaque(mi.Float, float(world.psf_sigma_px))
    width = world.interior.width_px

    def estimate(pixels: np.ndarray, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        count = len(pixels) * samples
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), dr.arange(mi.UInt32, count) // samples)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count)
        within, blur = sampler.next_2d() - 0.5, mi.warp.square_to_std_normal(sampler.next_2d())
        x_px, y_px = mi.Float(pixel % width) + within.x, mi.Float(pixel // width) + within.y
        x_px, y_px = x_px + sigma * blur.x, y_px + sigma * blur.y
        pupil = mi.warp.square_to_uniform_disk_concentric(sampler.next_2d()) * rays.pupil_mm
        seen = rays.at(x_px, y_px, pupil.x, pupil.y, (sampler.next_1d() - 0.5) * rays.exposure_s)
        value = radiance(sampler, mi.RayDifferential3f(mi.Ray3f(seen.origin, dr.normalize(seen.direction))))
        if vignetting is not None:
            value *= vignetting.at(x_px, y_px, seen)
        values = fetch(value).reshape(len(pixels), samples).astype(float)
        return values.sum(axis=1), (values**2).sum(axis=1)

    return estimate


def _reflected(stage: Stage, sampler: Any, ray: Any) -> Any:
    mi = mitsuba()
    import drjit as dr

    scene, gloss = stage.scene, stage.materials.gloss
    assert gloss is not None
    hit = scene.ray_intersect(ray)
    coated = hit.is_valid() & (hit.wi.z > 0) & ~stage.is_lamp(hit)
    coated &= stage.materials.carries(stage.texture.panel(hit), GLOSS)

    towards, light = scene.sample_emitter_direction(hit, sampler.next_2d(), True, coated)
    to_light = hit.to_local(towards.d)
    share = towards.pdf / (towards.pdf + coat_pdf(gloss, hit.wi, to_light))
    met = coated & ~towards.delta & (towards.pdf > 0)
    total = dr.select(met, coat(gloss, hit.wi, to_light) * light[0] * share, 0)

    to_light = sample_coat(gloss, hit.wi, sampler.next_2d())
    density = coat_pdf(gloss, hit.wi, to_light)
    going = coated & (to_light.z > 0) & (density > 0)
    weight = dr.select(going, coat(gloss, hit.wi, to_light) / dr.maximum(density, 1e-20), 0)
    onward = mi.RayDifferential3f(hit.spawn_ray(hit.to_world(to_light)))
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 1000})
    arriving, _, _ = integrator.sample(scene, sampler, onward, None, going)
    end = scene.ray_intersect(onward, active=going)
    emitter = end.emitter(scene, going)
    shines = going & (emitter != None)  # noqa: E711 (a device pointer)
    seen = mi.DirectionSample3f(scene, end, hit)
    emitted = dr.select(shines, emitter.eval(end, shines)[0], 0)
    other = dr.select(shines, scene.pdf_emitter_direction(hit, seen, shines), 0)
    return total + weight * (arriving[0] - emitted * other / dr.maximum(density + other, 1e-20))
