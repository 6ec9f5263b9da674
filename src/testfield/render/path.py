"""Reference mode: plain Mitsuba path tracing with the same camera and the same pattern. Slow, and what the fast
renderer is judged by."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.camera_plugin import mitsuba_sensor
from testfield.render.fetch import fetch
from testfield.render.gather import MAX_DEPTH
from testfield.render.psf import PointSpread, point_spread
from testfield.render.stage import Stage, build_stage
from testfield.render.variant import mitsuba

SAMPLES_A_PASS = 1 << 26
"""Beyond 2^32 samples Mitsuba's own splitting exhausts memory; passes of this size need about a gigabyte."""
PILOT_SAMPLES = 16


def render_path(
    stage: Stage, station: int, samples: int, seed: int, progress: Callable[[float], None] = lambda _: None
) -> Radiance:
    """Radiance image of one station by path tracing with `samples` a pixel.

    A point spread weighs cells of pixels as in the fast renderer, and the samples are shared out among the cells.
    Raises `ValueError` where the target moves, which this mode does not carry.
    """
    mi = mitsuba()
    world = stage.world
    scene, spread, samples = _as_asked(stage, station, samples)
    sensor = mitsuba_sensor(world, station, spread.cells, spread.margin)
    # rr_depth beyond max_depth: no Russian roulette, as in the fast renderer's light.
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH + 1, "rr_depth": 1000})
    width, height = (int(n) for n in sensor.film().size())
    a_pass = max(1, min(samples, SAMPLES_A_PASS // (width * height)))
    total = np.zeros((height, width))
    done = 0
    while done < samples:
        now = min(a_pass, samples - done)
        image = mi.render(scene, sensor=sensor, integrator=integrator, spp=now, seed=seed + done)
        total += now * fetch(image)[..., 0].astype(float)
        done += now
        progress(now / samples)
    fine = (total / samples).astype(np.float32)
    image = spread.weigh(fine, world.interior.height_px, world.interior.width_px)
    return Radiance(world.station_name[station], image)


def path_noise(stage: Stage, station: int, samples: int, seed: int) -> np.ndarray:
    """(h, w) standard error that `render_path` has with `samples` a pixel, from the spread of a few samples more."""
    mi = mitsuba()
    world = stage.world
    scene, spread, samples = _as_asked(stage, station, samples)
    nested = {"type": "path", "max_depth": MAX_DEPTH + 1, "rr_depth": 1000}
    moments = fetch(
        mi.render(
            scene,
            sensor=mitsuba_sensor(world, station, spread.cells, spread.margin),
            integrator=mi.load_dict({"type": "moment", "nested": nested}),
            spp=PILOT_SAMPLES,
            seed=seed ^ 0x5EED,
        )
    ).astype(float)
    variance = np.maximum(moments[..., 4] - moments[..., 1] ** 2, 0) * PILOT_SAMPLES / (PILOT_SAMPLES - 1)
    squared = replace(spread, line=None if spread.line is None else spread.line**2, plane=spread.plane**2)
    cells = (variance / samples).astype(np.float32)
    return np.sqrt(np.maximum(squared.weigh(cells, world.interior.height_px, world.interior.width_px), 0))


def _as_asked(stage: Stage, station: int, samples: int) -> tuple[Any, PointSpread, int]:
    """The scene with the station's flash, the point spread, and how many of a pixel's samples each cell gets."""
    world = stage.world
    if world.motion.target.moves:
        raise ValueError("path tracing does not carry a target that moves during the exposure")
    scene = stage.scene if world.flash is None else build_stage(world, station).scene
    blurs = world.psf_sigma_px or world.optics.airy_px
    spread = point_spread(2 if blurs else 1, world.psf_sigma_px, world.optics.airy_px)
    return scene, spread, -(-samples // spread.cells**2)
