"""Reference mode: plain Mitsuba path tracing with the same camera and the same pattern. Slow, and what the fast
renderer is judged by."""

from collections.abc import Callable

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.camera_plugin import mitsuba_sensor
from testfield.render.irradiance import MAX_DEPTH
from testfield.render.stage import Stage, build_stage
from testfield.render.variant import mitsuba

SAMPLES_A_PASS = 1 << 26
"""Beyond 2^32 samples Mitsuba's own splitting exhausts memory; passes of this size need about a gigabyte."""
PILOT_SAMPLES = 16


def render_path(
    stage: Stage, station: int, samples: int, seed: int, progress: Callable[[float], None] = lambda _: None
) -> Radiance:
    """Radiance image of one station by path tracing with `samples` a pixel.

    Raises `ValueError` where the world asks for a point spread, which this mode does not carry yet.
    """
    mi = mitsuba()
    world = stage.world
    if world.psf_sigma_px:
        raise ValueError("render.mode = 'path' does not carry lens.psf_sigma_px")
    scene = stage.scene if world.flash is None else build_stage(world, station).scene
    sensor = mitsuba_sensor(world.interior, world.camera_from_world, station)
    # rr_depth beyond max_depth: no Russian roulette, as in the fast renderer's light.
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH + 1, "rr_depth": 1000})
    pixels = world.interior.width_px * world.interior.height_px
    a_pass = max(1, min(samples, SAMPLES_A_PASS // pixels))
    total = np.zeros((world.interior.height_px, world.interior.width_px))
    done = 0
    while done < samples:
        now = min(a_pass, samples - done)
        image = mi.render(scene, sensor=sensor, integrator=integrator, spp=now, seed=seed + done)
        total += now * np.asarray(image, np.float64)[..., 0]
        done += now
        progress(now / samples)
    return Radiance(world.station_name[station], (total / samples).astype(np.float32))


def path_noise(stage: Stage, station: int, samples: int, seed: int) -> np.ndarray:
    """(h, w) standard error that `render_path` has with `samples` a pixel, from the spread of a few samples more."""
    mi = mitsuba()
    world = stage.world
    scene = stage.scene if world.flash is None else build_stage(world, station).scene
    nested = {"type": "path", "max_depth": MAX_DEPTH + 1, "rr_depth": 1000}
    moments = np.asarray(
        mi.render(
            scene,
            sensor=mitsuba_sensor(world.interior, world.camera_from_world, station),
            integrator=mi.load_dict({"type": "moment", "nested": nested}),
            spp=PILOT_SAMPLES,
            seed=seed ^ 0x5EED,
        ),
        np.float64,
    )
    variance = np.maximum(moments[..., 4] - moments[..., 1] ** 2, 0) * PILOT_SAMPLES / (PILOT_SAMPLES - 1)
    return np.sqrt(variance / samples)
