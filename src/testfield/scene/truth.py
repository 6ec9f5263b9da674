"""What each station truly sees of each mark: where, how large, how oblique, and how much of it."""

from dataclasses import dataclass, field, replace

import numpy as np

from testfield.camera.circle import CONTOUR_POINTS, DiscImage, contour_image, disc_image
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.scene.bend import crossings, to_paper
from testfield.scene.sight import hidden_by_meshes
from testfield.scene.sunflower import sunflower
from testfield.scene.world import Panels, World

RIM_POINTS = 12
AREA_POINTS, FINE_AREA_POINTS = 48, 1024
"""Points of equal shares of the printed area: to notice that some of it is hidden, and to say how much."""
EDGE_MARGIN_PX = 2.0
ROW_STEPS = 8
OWN_CROSSING = 1e-6
"""Nearer than this part of its distance, a crossing with a bent panel is the point itself."""


@dataclass(frozen=True)
class Views:
    """Truth of every mark in every station, in arrays (stations, marks).

    `centre_px` (.., 2) projection of the mark's centre; `disc_px` (.., 2) what a detector sees, the centre of area of
    the dot's image, of a corner its projection; `diameter_px` of the circle of equal area; `obliquity_deg` angle
    between the mark's normal and the line of sight; `visible` fraction, from 0 to 1, of the printed area that is in
    the image, faces the camera and has nothing before it (as it stands in the middle of the exposure), 1 only where
    that holds for all points looked at, those of the rim among them, times `clean`. `semi_axes_px` (.., 2) major and
    minor of the ellipse with the second moments of the dot's image, `angle_deg` of its major axis from x to y, in
    (-90, 90]; `clean` (marks,) part of the printed circle without dirt. Where things move, centres and discs are
    means over the exposure, and size and shape are those of the middle of it.
    """

    centre_px: np.ndarray
    disc_px: np.ndarray
    diameter_px: np.ndarray
    obliquity_deg: np.ndarray
    visible: np.ndarray
    semi_axes_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 2)))
    angle_deg: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    clean: np.ndarray = field(default_factory=lambda: np.ones(1))


def see(world: World) -> Views:
    """The truth of all stations of a world."""
    marks = world.marks
    centre, normal = world.mark_world_mm, world.mark_normal
    shape = (len(world.camera_from_world), len(marks))

    def nowhere(*more: int) -> np.ndarray:
        return np.full((*shape, *more), np.nan)

    views = Views(
        nowhere(2), nowhere(2), nowhere(), nowhere(), np.zeros(shape), nowhere(2), nowhere(), world.mark_clean
    )
    discs = _Discs(world)
    with np.errstate(invalid="ignore", divide="ignore"):
        for s in range(shape[0]):
            pose, views.centre_px[s], views.disc_px[s] = _exposed(world, s, discs)
            views.disc_px[s, marks.corner] = views.centre_px[s, marks.corner]
            image = discs.seen_from(pose)
            views.diameter_px[s] = image.diameter_px
            views.semi_axes_px[s], views.angle_deg[s] = _ellipse(image.moments_px2)
            sight = world.camera_from_world.origin_mm[s] - centre
            cosine = np.einsum("mi,mi->m", sight, normal) / np.linalg.norm(sight, axis=1)
            views.obliquity_deg[s] = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            views.visible[s] = _visible(world, s, cosine > 0) * views.clean
    return views


class _Discs:
    """The dots of all marks, flat ones on their planes and those of bent panels on their surfaces."""

    def __init__(self, world: World):
        self.interior, self.radius_mm = world.interior, world.marks.diameter_mm / 2
        self.centre_mm, self.normal = world.mark_world_mm, world.mark_normal
        self.bent = np.flatnonzero(world.panels.bent[world.marks.panel])
        self.contour_mm = _on_panels(world, self.bent, self.radius_mm[self.bent], _circle(CONTOUR_POINTS))

    def seen_from(self, pose: Poses) -> DiscImage:
        """Their images, disc i seen from camera-from-world pose i."""
        image = disc_image(self.interior, pose, self.centre_mm, self.normal, self.radius_mm)
        if len(self.bent):
            part = contour_image(self.interior, pose[self.bent], self.contour_mm)
            image = replace(image, **{name: values.copy() for name, values in vars(image).items()})
            for name, values in vars(part).items():
                getattr(image, name)[self.bent] = values
        return image


def _exposed(world: World, station: int, marks: _Discs) -> tuple[Poses, np.ndarray, np.ndarray]:
    """Cameras (n) in the middle of each mark's exposure; centres and discs (n, 2) in px, means over the exposure."""
    motion, centre_mm, n = world.motion, marks.centre_mm, len(marks.centre_mm)
    rest = world.camera_from_world[np.full(n, station)]
    at_s = np.zeros(n)
    # A row's exposure begins when the shutter comes to it: the time a mark is exposed follows from where it is seen.
    for _ in range(ROW_STEPS if motion.moves and motion.row_s else 0):
        row = project(world.interior, motion.camera_from_rest(rest, at_s), centre_mm)[:, 1]
        at_s = np.nan_to_num((row - (world.interior.height_px - 1) / 2) * motion.row_s)
    middle = motion.camera_from_rest(rest, at_s) if motion.moves else rest
    centres, discs = np.zeros((n, 2)), np.zeros((n, 2))
    for node, weight in zip(*np.polynomial.legendre.leggauss(3 if motion.moves else 1), strict=True):
        during = at_s + node / 2 * motion.exposure_s
        pose = motion.camera_from_rest(rest, during) if motion.moves else rest
        centres += weight / 2 * project(world.interior, pose, centre_mm)
        discs += weight / 2 * marks.seen_from(pose).centroid_px
    return middle, centres, discs


def _ellipse(moments_px2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Semi-axes (n, 2) in px and angle (n,) in degrees of ellipses with second moments (n, 2, 2) over their areas."""
    xx, xy, yy = moments_px2[:, 0, 0], moments_px2[:, 0, 1], moments_px2[:, 1, 1]
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    axes = 2 * np.sqrt(np.maximum(np.column_stack([middle + half, middle - half]), 0))
    angle = np.degrees(np.arctan2(2 * xy, xx - yy)) / 2
    return axes, np.where(angle <= -90, 90.0, angle)


def _visible(world: World, station: int, facing: np.ndarray) -> np.ndarray:
    """(n,) visible fraction of the printed area of every mark; `facing` (n,) those that face the camera."""
    front = np.flatnonzero(facing)
    seen = _points_seen(world, station, front, np.vstack([sunflower(AREA_POINTS), _circle(RIM_POINTS)]))
    visible = np.zeros(len(facing))
    visible[front] = seen.mean(axis=1)
    part = np.flatnonzero((visible > 0) & (visible < 1))
    fine = _points_seen(world, station, part, sunflower(FINE_AREA_POINTS)).mean(axis=1)
    # What the coarse points saw a part of is neither whole nor gone, whatever the fine ones say.
    visible[part] = np.clip(fine, 0.5 / FINE_AREA_POINTS, 1 - 0.5 / FINE_AREA_POINTS)
    return visible


def _points_seen(world: World, station: int, marks: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(m, k) whether a station sees places (k, 2), in units of the printed radius, of marks (m,) that face it."""
    panel = world.marks.panel[marks]
    points = _on_panels(world, marks, world.marks.printed_radius_mm[marks], places)
    pose = world.camera_from_world[np.full(points.shape[0] * points.shape[1], station)]
    uv = project(world.interior, pose, points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
    limit = np.array([world.interior.width_px, world.interior.height_px]) - 1 - EDGE_MARGIN_PX
    seen = np.all((uv >= EDGE_MARGIN_PX) & (uv <= limit), axis=-1)
    mark, place = np.nonzero(seen)
    eye = world.camera_from_world.origin_mm[station]
    seen[mark, place] = ~hidden(eye, points[mark, place], world, panel[mark])
    return seen


def _circle(points: int) -> np.ndarray:
    """(points, 2) of the unit circle."""
    angle = 2 * np.pi * np.arange(points) / points
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _on_panels(world: World, marks: np.ndarray, radius_mm: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(m, k, 3) points in the world of places (k, 2), in units of radii (m,), about marks (m,) on their panels."""
    xy = world.marks.xy_mm[marks][:, None, :] + radius_mm[:, None, None] * places
    points, _ = world.panels.place(np.repeat(world.marks.panel[marks], len(places)), xy.reshape(-1, 2))
    return points.reshape(len(marks), len(places), 3)


def hidden(eye_mm: np.ndarray, points_mm: np.ndarray, world: World, own_panel: np.ndarray) -> np.ndarray:
    """(n,) whether a panel, a lamp or a mesh hides points (n, 3) from the eye (3,).

    A flat panel does not hide points of its own; a bent one may.
    """
    lamps = [light.world_from_light for light in world.lights]
    poses = Poses.join([world.panels.world_from_panel, *lamps])
    sizes = np.vstack([world.panels.size_mm, *[light.size_mm for light in world.lights]])
    blocked = hidden_by_meshes(eye_mm, points_mm, world.meshes)
    ray = points_mm - eye_mm
    near = _towards(ray, poses.t_mm - eye_mm, np.linalg.norm(sizes, axis=1) / 2)
    for k in range(len(poses)):
        here = np.flatnonzero(near[k])
        own = own_panel[here] == k
        if k < len(world.panels) and world.panels.bent[k]:
            blocked[here] |= _behind_bent(world.panels, k, eye_mm, points_mm[here], own)
            continue
        R, t = poses.R[k], poses.t_mm[k]
        start, slope = (eye_mm - t) @ R, ray[here] @ R[:, 2]
        along = -start[2] / np.where(slope == 0, np.inf, slope)
        crossed = (along > 0) & (along < 1 - 1e-9) & ~own
        here, along = here[crossed], along[crossed]
        at = start[:2] + along[:, None] * (ray[here] @ R[:, :2])
        blocked[here] |= np.all(np.abs(at) <= sizes[k] / 2, axis=1)
    return blocked


def _towards(ray: np.ndarray, centre_mm: np.ndarray, radius_mm: np.ndarray) -> np.ndarray:
    """(p, n) whether rays (n, 3) from the eye may meet spheres about centres (p, 3) with radii (p,), as seen from the
    eye; a hair wider than they are."""
    far = np.linalg.norm(centre_mm, axis=1)
    sine = np.minimum(1.001 * radius_mm / np.maximum(far, 1e-300), 1.0)
    length = np.linalg.norm(ray, axis=1)
    along = centre_mm / np.maximum(far, 1e-300)[:, None] @ ray.T
    least = np.where(sine < 1, np.sqrt(1 - sine**2), -2.0)  # inside a sphere every ray meets it
    return along >= least[:, None] * length


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
