"""What each station truly sees of each mark: where, how large, how oblique, and how much of it."""

from dataclasses import dataclass, field

import numpy as np

from testfield.camera.circle import CONTOUR_POINTS, contour_image, disc_image
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.scene.bend import crossings, to_paper
from testfield.scene.world import Panels, World

RIM_POINTS = 12
EDGE_MARGIN_PX = 2.0
OWN_CROSSING = 1e-6
"""Nearer than this part of its distance, a crossing with a bent panel is the point itself."""


@dataclass(frozen=True)
class Views:
    """Truth of every mark in every station, in arrays (stations, marks).

    `centre_px` (.., 2) projection of the mark's centre; `disc_px` (.., 2) centre of area of the dot's image, which is
    what a detector sees; `diameter_px` of the circle of equal area; `obliquity_deg` angle between the mark's normal
    and the line of sight; `visible` fraction, from 0 to 1, of the printed area's rim and centre that is in the image,
    faces the camera and has nothing before it, times `clean`; `clean` (marks,) part of the printed circle without dirt.
    """

    centre_px: np.ndarray
    disc_px: np.ndarray
    diameter_px: np.ndarray
    obliquity_deg: np.ndarray
    visible: np.ndarray
    clean: np.ndarray = field(default_factory=lambda: np.ones(1))


def see(world: World) -> Views:
    """The truth of all stations of a world."""
    marks = world.marks
    centre, normal = world.mark_world_mm, world.mark_normal
    stations, n = len(world.camera_from_world), len(marks)
    eyes = world.camera_from_world.origin_mm
    shape = (stations, n)
    unseen, nowhere = np.full(shape, np.nan), np.full((*shape, 2), np.nan)
    views = Views(nowhere, nowhere.copy(), unseen, unseen.copy(), np.zeros(shape), world.mark_clean)
    extent = marks.printed_radius_mm
    circle = np.vstack([[0, 0], _circle(RIM_POINTS)])
    R = world.panels.world_from_panel.R[marks.panel]
    rim = centre[:, None, :] + extent[:, None, None] * np.einsum("mij,kj->mki", R[:, :, :2], circle)
    bent = np.flatnonzero(world.panels.bent[marks.panel])
    rim[bent] = _on_panels(world, bent, extent[bent], circle)
    edge = _on_panels(world, bent, marks.diameter_mm[bent] / 2, _circle(CONTOUR_POINTS))
    with np.errstate(invalid="ignore", divide="ignore"):
        for s in range(stations):
            pose = world.camera_from_world[np.full(n, s)]
            image = disc_image(world.interior, pose, centre, normal, marks.diameter_mm / 2)
            views.centre_px[s] = project(world.interior, pose, centre)
            views.disc_px[s], views.diameter_px[s] = image.centroid_px, image.diameter_px
            if len(bent):
                image = contour_image(world.interior, pose[bent], edge)
                views.disc_px[s, bent], views.diameter_px[s, bent] = image.centroid_px, image.diameter_px
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
            views.visible[s] = seen.mean(axis=1) * views.clean
    return views


def _circle(points: int) -> np.ndarray:
    """(points, 2) of the unit circle."""
    angle = 2 * np.pi * np.arange(points) / points
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _on_panels(world: World, marks: np.ndarray, radius_mm: np.ndarray, circle: np.ndarray) -> np.ndarray:
    """(m, k, 3) points in the world of circles (k, 2) printed about marks (m,)."""
    xy = world.marks.xy_mm[marks][:, None, :] + radius_mm[:, None, None] * circle
    points, _ = world.panels.place(np.repeat(world.marks.panel[marks], len(circle)), xy.reshape(-1, 2))
    return points.reshape(len(marks), len(circle), 3)


def hidden(eye_mm: np.ndarray, points_mm: np.ndarray, world: World, own_panel: np.ndarray) -> np.ndarray:
    """(n,) whether a panel or a lamp stands between the eye (3,) and each point (n, 3).

    A flat panel does not hide points of its own; a bent one may.
    """
    lamps = [light.world_from_light for light in world.lights]
    poses = Poses.join([world.panels.world_from_panel, *lamps])
    sizes = np.vstack([world.panels.size_mm, *[light.size_mm for light in world.lights]])
    blocked = np.zeros(len(points_mm), bool)
    ray = points_mm - eye_mm
    for k in range(len(poses)):
        R, t = poses.R[k], poses.t_mm[k]
        if k < len(world.panels) and world.panels.bent[k]:
            blocked |= _behind_bent(world.panels, k, eye_mm, points_mm, own_panel == k)
            continue
        start = (eye_mm - t) @ R
        slope = ray @ R
        along = -start[2] / np.where(slope[:, 2] == 0, np.inf, slope[:, 2])
        at = start[:2] + along[:, None] * slope[:, :2]
        within = np.all(np.abs(at) <= sizes[k] / 2, axis=1)
        blocked |= within & (along > 0) & (along < 1 - 1e-9) & (own_panel != k)
    return blocked


def _behind_bent(panels: Panels, k: int, eye_mm: np.ndarray, points_mm: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(n,) whether bent panel k stands between the eye and each point; `own` (n,) says which points lie on it."""
    R, t = panels.world_from_panel.R[k], panels.world_from_panel.t_mm[k]
    start, slope = (eye_mm - t) @ R, (points_mm - eye_mm) @ R
    blocked = np.zeros(len(points_mm), bool)
    curve = panels.curvature_per_mm[k], panels.bend_axis_rad[k]
    for along in crossings(np.broadcast_to(start, slope.shape), slope, *curve).T:
        at = start + np.where(np.isfinite(along), along, 0)[:, None] * slope
        paper = to_paper(at, *(np.full(len(at), value) for value in curve))
        within = np.all(np.abs(paper[:, :2]) <= panels.size_mm[k] / 2, axis=1)
        # A point of this very panel is itself a crossing.
        blocked |= within & (along > 0) & (along < np.where(own, 1 - OWN_CROSSING, 1 - 1e-9))
    return blocked
