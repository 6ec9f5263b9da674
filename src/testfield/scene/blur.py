"""How far each mark's image is blurred by defocus and by motion."""

import numpy as np

from testfield.camera.optics import blur_circle_px
from testfield.camera.project import project
from testfield.scene.world import World


def blur_circles_px(world: World, station: int) -> np.ndarray:
    """(n,) diameters of the marks' blur circles, without the lens' distortion; NaN behind the camera."""
    depth = world.camera_from_world[np.full(len(world.marks), station)].apply(world.mark_world_mm)[:, 2]
    return blur_circle_px(world.optics, world.interior.fx, np.where(depth > 0, depth, np.nan))


def streaks_px(world: World, station: int) -> np.ndarray:
    """(n,) lengths that the marks' images move from the first to the last moment of an exposure; NaN out of view."""
    n, motion = len(world.marks), world.motion
    if not motion.moves:
        return np.zeros(n)
    rest = world.camera_from_world[np.full(n, station)]
    first, last = (
        project(world.interior, motion.camera_from_rest(rest, np.full(n, time_s)), world.mark_world_mm)
        for time_s in (-motion.exposure_s / 2, motion.exposure_s / 2)
    )
    return np.linalg.norm(last - first, axis=1)
