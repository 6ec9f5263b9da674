"""Flash light that reaches panels by way of other panels.

Like the room's indirect light it is smooth, but it travels with the camera, so it is computed for each view: on a
coarse grid and with few paths, for it is a few hundredths of the flash's own light.
"""

from dataclasses import replace

from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.stage import build_stage
from testfield.scene.world import World

SPACING_MM, PATHS = 120.0, 512


def flash_bounce(world: World, station: int, seed: int) -> Irradiance | None:
    """Indirect irradiance on every panel from the camera's flash at one station; None where there is no flash."""
    if world.flash is None:
        return None
    # What bounces onto meshes is left out: nothing is measured on them. They are in the way all the same.
    alone = replace(world, lights=(), point_lights=(), ambient_radiance=0.0, sky=None, luminous_radiance=0.0)
    return compute_irradiance(build_stage(alone, station), SPACING_MM, PATHS, seed, lambda _: None)
