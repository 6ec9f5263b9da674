"""What each station truly sees of each mark: where, how large, how oblique, and how much of it."""

from dataclasses import dataclass

import numpy as np

from testfield.camera.circle import disc_image
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.scene.world import World

RIM_POINTS = 12
EDGE_MARGIN_PX = 2.0
ROW_STEPS = 8


@dataclass(frozen=True)
class Views:
    """Truth of every mark in every station, in arrays (stations, marks).

    `centre_px` (.., 2) projection of the mark's centre; `disc_px` (.., 2) centre of area of the dot's image, which is
    what a detector sees; `diameter_px` of the circle of equal area; `obliquity_deg` angle between the mark's normal
    and the line of sight; `visible` fraction, from 0 to 1, of the printed area's rim and centre that is in the image,
    faces the camera and has nothing before it (as it stands in the middle of the exposure).
    """

    centre_px: np.ndarray
    disc_px: np.ndarray
    diameter_px: np.ndarray
    obliquity_deg: np.ndarray
    visible: np.ndarray


def see(world: World) -> Views:
    """The truth of all stations of a world."""
    marks = world.marks
    centre, normal = world.mark_world_mm, world.mark_normal
    stations, n = len(world.camera_from_world), len(marks)
    eyes = world.camera_from_world.origin_mm
    shape = (stations, n)
    unseen, nowhere = np.full(shape, np.nan), np.full((*shape, 2), np.nan)
    views = Views(nowhere, nowhere.copy(), unseen, unseen.copy(), np.zeros(shape))
    extent = marks.printed_radius_mm
    R = world.panels.world_from_panel.R[marks.panel]
    angle = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    circle = np.vstack([[0, 0], np.column_stack([np.cos(angle), np.sin(angle)])])
    rim = centre[:, None, :] + extent[:, None, None] * np.einsum("mij,kj->mki", R[:, :, :2], circle)
    with np.errstate(invalid="ignore", divide="ignore"):
        for s in range(stations):
            views.centre_px[s], views.disc_px[s], views.diameter_px[s] = _images(world, s, centre, normal)
            sight = eyes[s] - centre
            cosine = np.einsum("mi,mi->m", sight, normal) / np.linalg.norm(sight, axis=1)
            views.obliquity_deg[s] = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            pose = world.camera_from_world[np.full(rim.shape[0] * rim.shape[1], s)]
            uv = project(world.interior, pose, rim.reshape(-1, 3)).reshape(*rim.shape[:2], 2)
            limit = np.array([world.interior.width_px, world.interior.height_px]) - 1 - EDGE_MARGIN_PX
            inside = np.all((uv >= EDGE_MARGIN_PX) & (uv <= limit), axis=-1)
            seen = inside & (cosine > 0)[:, None]
            candidates = np.argwhere(seen)
            points = rim[candidates[:, 0], candidates[:, 1]]
            seen[candidates[:, 0], candidates[:, 1]] = ~hidden(eyes[s], points, world, marks.panel[candidates[:, 0]])
            views.visible[s] = seen.mean(axis=1)
    return views


def _images(world: World, station: int, centre_mm: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, ...]:
    """Centres (n, 2), discs (n, 2) and diameters (n,) in px of all marks, means over the exposure where things move."""
    motion, n = world.motion, len(centre_mm)
    rest = world.camera_from_world[np.full(n, station)]
    radius = world.marks.diameter_mm / 2
    if not motion.moves:
        image = disc_image(world.interior, rest, centre_mm, normal, radius)
        return project(world.interior, rest, centre_mm), image.centroid_px, image.diameter_px
    # A row's exposure begins when the shutter comes to it: the time a mark is exposed follows from where it is seen.
    at_s = np.zeros(n)
    for _ in range(ROW_STEPS if motion.row_s else 0):
        row = project(world.interior, motion.camera_from_rest(rest, at_s), centre_mm)[:, 1]
        at_s = np.nan_to_num((row - (world.interior.height_px - 1) / 2) * motion.row_s)
    centres, discs, diameters = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n)
    for node, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        pose = motion.camera_from_rest(rest, at_s + node / 2 * motion.exposure_s)
        image = disc_image(world.interior, pose, centre_mm, normal, radius)
        centres += weight / 2 * project(world.interior, pose, centre_mm)
        discs += weight / 2 * image.centroid_px
        diameters += weight / 2 * image.diameter_px
    return centres, discs, diameters


def hidden(eye_mm: np.ndarray, points_mm: np.ndarray, world: World, own_panel: np.ndarray) -> np.ndarray:
    """(n,) whether a panel other than the point's own, or a lamp, stands between the eye (3,) and each point (n, 3)."""
    lamps = [light.world_from_light for light in world.lights]
    poses = Poses.join([world.panels.world_from_panel, *lamps])
    sizes = np.vstack([world.panels.size_mm, *[light.size_mm for light in world.lights]])
    blocked = np.zeros(len(points_mm), bool)
    ray = points_mm - eye_mm
    for k in range(len(poses)):
        R, t = poses.R[k], poses.t_mm[k]
        start = (eye_mm - t) @ R
        slope = ray @ R
        along = -start[2] / np.where(slope[:, 2] == 0, np.inf, slope[:, 2])
        at = start[:2] + along[:, None] * slope[:, :2]
        within = np.all(np.abs(at) <= sizes[k] / 2, axis=1)
        blocked |= within & (along > 0) & (along < 1 - 1e-9) & (own_panel != k)
    return blocked
