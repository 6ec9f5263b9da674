"""Reference mode: plain Mitsuba path tracing with the same camera and the same pattern. Slow, and what the fast
renderer is judged by."""

from collections.abc import Callable

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.camera_plugin import mitsuba_sensor
from testfield.render.irradiance import MAX_DEPTH
from testfield.render.psf import point_spread
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba

SAMPLES_A_PASS = 1 << 26
"""Beyond 2^32 samples Mitsuba's own splitting exhausts memory; passes of this size need about a gigabyte."""


def render_path(
    stage: Stage, station: int, samples: int, seed: int, progress: Callable[[float], None] = lambda _: None
) -> Radiance:
    """Radiance image of one station by path tracing with `samples` a pixel.

    A point spread weighs cells of pixels as in the fast renderer, and the samples are shared out among the cells.
    Raises `ValueError` where the target moves, which this mode does not carry.
    """
    mi = mitsuba()
    world = stage.world
    if world.motion.target.moves:
        raise ValueError("path tracing does not carry a target that moves during the exposure")
    blurs = world.psf_sigma_px or world.optics.airy_px
    spread = point_spread(2 if blurs else 1, world.psf_sigma_px, world.optics.airy_px)
    samples = -(-samples // spread.cells**2)
    sensor = mitsuba_sensor(world, station, spread.cells, spread.margin)
    # rr_depth beyond max_depth: no Russian roulette, as in the fast renderer's light.
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH + 1, "rr_depth": 1000})
    width, height = (int(n) for n in sensor.film().size())
    a_pass = max(1, min(samples, SAMPLES_A_PASS // (width * height)))
    total = np.zeros((height, width))
    done = 0
    while done < samples:
        now = min(a_pass, samples - done)
        image = mi.render(stage.scene, sensor=sensor, integrator=integrator, spp=now, seed=seed + done)
        total += now * np.asarray(image, np.float64)[..., 0]
        done += now
        progress(now / samples)
    fine = (total / samples).astype(np.float32)
    image = spread.weigh(fine, world.interior.height_px, world.interior.width_px)
    return Radiance(world.station_name[station], image)
