"""One station's image, in the way that its materials allow, and how it was made.

Matt, retro-reflecting and luminous panels: fast, without noise. Rough coats: fast, and what they reflect is sampled on
top until the noise target is met. Coats so smooth that light they throw on others has edges: the whole image is path
traced to the same target.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.bounce import flash_bounce
from testfield.render.camera_plugin import CameraRays
from testfield.render.fast import render_fast
from testfield.render.fetch import fetch
from testfield.render.gather import MAX_DEPTH
from testfield.render.gloss import gloss_estimate, pixel_estimate
from testfield.render.irradiance import Irradiance
from testfield.render.path import PILOT_SAMPLES, path_noise, render_path
from testfield.render.sampled import sample_to_target
from testfield.render.stage import Stage, build_stage
from testfield.render.variant import mitsuba
from testfield.scene.world import SMOOTHEST, World

FAST, FAST_SAMPLED, PATH_SAMPLED, PATH = "fast", "fast, gloss sampled", "path, to the noise target", "path"
WHITE_PERCENTILE = 99.0


@dataclass(frozen=True)
class Making:
    """How an image was made.

    `mode`; mean `samples` a pixel where there was sampling; `noise`, the root mean square of the pixels' standard
    errors as a part of white's radiance without a coat; `over_target`, the part of the pixels above the noise target.
    All zero for a fast image, which has no sampling.
    """

    mode: str
    samples: float = 0.0
    noise: float = 0.0
    over_target: float = 0.0


def fast_carries(world: World) -> bool:
    """Whether the fast renderer, with sampling where need be, is right for all of the world's materials."""
    return world.gloss is None or world.gloss.alpha >= SMOOTHEST


def render_view(
    stage: Stage,
    light: Irradiance,
    station: int,
    cells: int,
    noise_target: float,
    most_samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda _: None,
    blur_shots: int = 64,
) -> tuple[Radiance, Making]:
    """Radiance of one station and how it was made. `light` is not used where the whole image is path traced."""
    world = stage.world
    if not fast_carries(world):
        return _traced(stage, station, noise_target, most_samples, seed, progress)
    sampled = world.gloss is not None
    part = 0.1 if sampled else 1.0
    bounce = flash_bounce(world, station, seed)
    image = render_fast(stage, light, station, cells, lambda done: progress(part * done), blur_shots, bounce)
    if not sampled:
        return image, Making(FAST)
    shape = image.values.shape
    white = white_radiance(stage, station, image.values)
    lit = stage if world.flash is None else build_stage(world, station)  # walls that the flash lights are reflected too
    found = sample_to_target(
        gloss_estimate(lit, station), shape, noise_target * white, most_samples, seed, lambda d: progress(0.9 * d)
    )
    met = found.u > 0
    making = Making(
        FAST_SAMPLED,
        round(float(found.samples.mean()), 1),
        _rms(found.u[met]) / white,
        float((found.u > noise_target * white).mean()),
    )
    return Radiance(image.station, image.values + found.values), making


def render_reference(
    stage: Stage, station: int, samples: int, seed: int, progress: Callable[[float], None] = lambda _: None
) -> tuple[Radiance, Making]:
    """Radiance of one station by plain path tracing with `samples` a pixel, and its noise as its samples tell it."""
    image = render_path(stage, station, samples, seed, progress)
    noise = _rms(path_noise(stage, station, samples, seed)) / white_radiance(stage, station, image.values)
    return image, Making(PATH, samples, noise)


def _traced(
    stage: Stage, station: int, noise_target: float, most: int, seed: int, progress: Callable[[float], None]
) -> tuple[Radiance, Making]:
    mi = mitsuba()
    lit = build_stage(stage.world, station)
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH + 1, "rr_depth": 1000})
    estimate = pixel_estimate(lit, station, lambda sampler, ray: integrator.sample(lit.scene, sampler, ray)[0][0])
    white = white_radiance(stage, station, render_path(stage, station, PILOT_SAMPLES, seed).values)
    shape = (stage.world.interior.height_px, stage.world.interior.width_px)
    found = sample_to_target(estimate, shape, noise_target * white, most, seed, progress)
    over = float((found.u > noise_target * white).mean())
    making = Making(PATH_SAMPLED, round(float(found.samples.mean()), 1), _rms(found.u) / white, over)
    return Radiance(stage.world.station_name[station], found.values), making


def white_radiance(stage: Stage, station: int, values: np.ndarray) -> float:
    """What noise is measured by: the radiance that 99 % of the pixels on panels with marks do not exceed."""
    mi = mitsuba()
    import drjit as dr

    world = stage.world
    height, width = values.shape
    index = dr.arange(mi.UInt32, height * width)
    rays = CameraRays(world, station).at(mi.Float(index % width), mi.Float(index // width))
    hit = stage.scene.ray_intersect(mi.Ray3f(rays.origin, dr.normalize(rays.direction)))
    facing = hit.is_valid() & (hit.wi.z > 0) & ~stage.is_lamp(hit)
    panel = fetch(dr.select(facing, mi.Int32(stage.texture.panel(hit)), -1)).reshape(height, width)
    marked = np.isin(panel, world.marks.panel)
    return float(max(np.percentile(values[marked] if marked.any() else values, WHITE_PERCENTILE), 1e-12))


def _rms(u: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(u, dtype=float)))) if u.size else 0.0
