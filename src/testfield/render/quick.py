"""One quick view for a preview: a smaller image, coarser light."""

from dataclasses import replace

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.irradiance import compute_irradiance
from testfield.render.stage import build_stage
from testfield.render.view import render_view
from testfield.scene.world import World

WIDTH_PX = 900
SPACING_MM, PATHS = 250.0, 256
LEVELS, RAYS = (3, 5), 233
"""Nodes along a tile's side, and rays to each lamp that may be hidden: shadows in a preview need no sharp edge."""
NOISE, SAMPLES = 0.05, 64
"""Of what a coat reflects."""


def quick_view(world: World, station: int) -> Radiance:
    """Radiance image of one station, about 900 px wide, in a few seconds."""
    shrink = min(1.0, WIDTH_PX / world.interior.width_px)
    parameters = world.interior.parameters.copy()
    # A pixel's centre lies at whole numbers, so an image shrinks about its corner at -0.5.
    parameters[:2] *= shrink
    parameters[2:4] = (parameters[2:4] + 0.5) * shrink - 0.5
    width, height = (int(np.ceil(n * shrink)) for n in (world.interior.width_px, world.interior.height_px))
    small = replace(
        world,
        interior=replace(world.interior, width_px=width, height_px=height, parameters=parameters),
        psf_sigma_px=0.0,
        optics=replace(world.optics, airy_px=0.0),
        motion=replace(world.motion, row_s=world.motion.row_s / shrink),
    )
    stage = build_stage(small)
    light = compute_irradiance(stage, SPACING_MM, PATHS, 1, lambda _: None, LEVELS, RAYS)
    return render_view(stage, light, station, 3, NOISE, SAMPLES, 1)[0]
