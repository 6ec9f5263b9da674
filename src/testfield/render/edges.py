"""Which pixels an edge may cross: the others see smooth light, for which one ray is enough.

Decided by geometry alone. Every outline in the world is followed through the lens, with points closer than a pixel, and
the pixels it passes are marked with those beside them. Whether an outline is hidden is not asked. Where outlines do not
tell (bodies that cut each other, shadows of lights without size), all pixels that show it are marked.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from testfield.camera.motion import Motion, Twist
from testfield.camera.project import project_camera
from testfield.render.direct import TOLERANCE, TOLERANCE_PLAIN, DirectLight
from testfield.render.outlines import Curves, Lines, borders, cut_panels, lattice_mm, lines_in_space, prints
from testfield.scene.world import RETRO, World

SMOOTH, EDGE, BORDER = np.arange(3, dtype=np.uint8)
GAP_PX = 0.7
"""Points of an outline are no farther apart in the image."""
LONGEST_PX, BOW_PX = 64.0, 0.4
"""A piece no longer than the first whose middle is no farther from its chord is two straight ones: each half bows by a
quarter of it, and half a gap beside it is still within the pixels marked around."""
TURN = 0.02
"""Nor farther apart in direction, in radians: between them the lens' distortion cannot hide a bulge."""
ROUNDS = 40
CIRCLE_PIECES, POLYGON_SIDES = 8, 32
RIM = np.array([[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1], [0, 0.5]])
"""Around a tile: its corners and the middles of its sides."""
MOST_PX = 1 << 20
HALVINGS = 8
KINK, KINK_PLAIN = 2 * TOLERANCE, 2 * TOLERANCE_PLAIN
"""Steps of the light's slope that one ray a pixel may pass over, on panels with marks and on plain ones: by one pixel,
as a part of the panel's brightest node. One ray errs by an eighth of it, as interpolation of settled nodes does."""

Seen = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""World points (n, 3) to pixels (n, 2), NaN out of the lens' domain, and unit directions (n, 3) in the camera."""


def edge_pixels(world: World, light: DirectLight, station: int, exposure: np.ndarray, margin: int) -> np.ndarray:
    """(h + 2 margin, w + 2 margin) of SMOOTH, EDGE, BORDER: pixels of the image, and around it, that an edge may cross
    at any of the `exposure`'s shots (k, 3) (`shots.py`); at a border one thing stands before another."""
    size = world.interior.height_px + 2 * margin, world.interior.width_px + 2 * margin
    if world.point_lights or world.flash is not None:
        return np.full(size, EDGE)
    crossed, bordered = np.zeros((2, *size), np.uint8)
    eye = world.camera_from_world.origin_mm[station]
    outlines: tuple[tuple[np.ndarray, Curves | Lines, int], ...] = (
        (crossed, prints(world, _faced(world, eye)), CIRCLE_PIECES),
        (bordered, borders(world), 1),
        (bordered, lines_in_space(world, eye), 1),
    )
    shadows = _kinked(world, light, _faced(world, eye), _eye(world, world.motion, station, np.zeros(3)))
    if shadows is None:
        return np.full(size, EDGE)
    areas = [*_returning(world), *_touching(world), *shadows]
    # Where the target moves, the room and its lamps do not: every outline is followed both ways.
    motions: list[Motion] = [world.motion]
    if world.motion.target.moves:
        motions.append(replace(world.motion, target=Twist()))
    for see in (_eye(world, motion, station, shot) for shot in exposure for motion in motions):
        for mask, curves, pieces in outlines:
            _follow(mask, curves, pieces, see, world, margin)
        if not _fill(crossed, areas, see, margin):
            return np.full(size, EDGE)
    around = np.ones((3, 3), np.uint8)
    found = np.where(cv2.dilate(crossed, around) > 0, EDGE, SMOOTH)
    found[cv2.dilate(bordered, around) > 0] = BORDER
    return found


def _faced(world: World, eye_mm: np.ndarray) -> np.ndarray:
    """(panels,) whether a panel's front may be seen from a place."""
    panels = world.panels
    towards = np.einsum("ni,ni->n", eye_mm - panels.world_from_panel.t_mm, panels.world_from_panel.R[:, :, 2])
    return (towards > 0) | panels.bent | world.motion.moves | (world.optics.aperture_mm > 0)


def _eye(world: World, motion: Motion, station: int, shot: np.ndarray) -> Seen:
    """What a camera does to points at one shot: a point of its pupil and a moment of the exposure."""
    pupil, time_s = np.array([*shot[:2], 0.0]), shot[2]
    interior, optics = world.interior, world.optics

    def pixels(camera_mm: np.ndarray) -> np.ndarray:
        if not optics.aperture_mm:
            return project_camera(interior, camera_mm)
        with np.errstate(divide="ignore", invalid="ignore"):
            # All rays of a pixel meet on the plane in focus.
            return project_camera(interior, pupil + (camera_mm - pupil) * (optics.focus_mm / camera_mm[:, 2:]))

    def see(world_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rest = world.camera_from_world[np.full(len(world_mm), station)]
        at_s = np.full(len(world_mm), time_s)
        camera = rest.apply(world_mm) if not motion.moves else motion.camera_from_rest(rest, at_s).apply(world_mm)
        px = pixels(camera)
        for _ in range(4 if motion.moves and motion.row_s else 0):
            # Rows far beyond the image have no time of their own: what is out of view stays there.
            row = np.clip(np.nan_to_num(px[:, 1]), -interior.height_px, 2 * interior.height_px)
            at_s = time_s + (row - (interior.height_px - 1) / 2) * motion.row_s
            camera = motion.camera_from_rest(rest, at_s).apply(world_mm)
            px = pixels(camera)
        return px, camera / np.linalg.norm(camera, axis=1, keepdims=True)

    return see


def _follow(crossed: np.ndarray, outlines: Curves | Lines, pieces: int, see: Seen, world: World, margin: int) -> None:
    """Mark the pixels that outlines pass, halving their pieces until each is short or straight in the image."""
    n, focal_px = len(outlines), float(min(world.interior.fx, world.interior.fy))
    index = np.repeat(np.arange(n), pieces)
    t = np.tile(np.arange(pieces) / pieces, n)
    ends = t, t + 1 / pieces
    px, way = zip(*(see(outlines.at(index, end)) for end in ends), strict=True)
    _mark(crossed, np.concatenate(px), margin)
    size = np.array([world.interior.width_px, world.interior.height_px])
    straight = np.zeros(len(index), bool)
    for _ in range(ROUNDS):
        gap, turn = np.linalg.norm(px[1] - px[0], axis=1), np.linalg.norm(way[1] - way[0], axis=1)
        known = np.isfinite(gap)
        # As far from the image as the ends from each other, a piece cannot reach it.
        reach = (np.where(known, gap, turn * focal_px) + margin + 2)[:, None]
        near = [np.all((p > -reach) & (p < size + reach), axis=1) for p in px]
        split = (turn > TURN) | ((near[0] | near[1]) & np.where(known, gap > GAP_PX, turn * focal_px > 0.3))
        drawn = split & straight
        _draw(crossed, px[0][drawn], px[1][drawn], margin)
        split &= ~drawn
        if not split.any():
            return
        index, known, gap, turn = (v[split] for v in (index, known, gap, turn))
        low, high = (end[split] for end in ends)
        px, way = tuple(p[split] for p in px), tuple(w[split] for w in way)
        middle = (low + high) / 2
        at_px, at_way = see(outlines.at(index, middle))
        _mark(crossed, at_px, margin)
        with np.errstate(invalid="ignore"):
            bow = np.linalg.norm(at_px - (px[0] + px[1]) / 2, axis=1)
            flat = known & (turn <= TURN) & (gap <= LONGEST_PX) & (bow <= BOW_PX)
        ends = np.concatenate([low, middle]), np.concatenate([middle, high])
        px = np.concatenate([px[0], at_px]), np.concatenate([at_px, px[1]])
        way = np.concatenate([way[0], at_way]), np.concatenate([at_way, way[1]])
        index, straight = np.tile(index, 2), np.tile(flat, 2)


def _draw(crossed: np.ndarray, start: np.ndarray, end: np.ndarray, margin: int) -> None:
    """Mark the pixels along straight pieces (n, 2) px, whose ends are marked."""
    steps = np.ceil(np.linalg.norm(end - start, axis=1) / GAP_PX).astype(int)
    first = np.cumsum(steps) - steps
    part = (np.arange(steps.sum()) - np.repeat(first, steps)) / np.repeat(steps, steps)
    _mark(crossed, np.repeat(start, steps, axis=0) + part[:, None] * np.repeat(end - start, steps, axis=0), margin)


def _mark(crossed: np.ndarray, px: np.ndarray, margin: int) -> None:
    height, width = crossed.shape
    px = px[np.isfinite(px[:, 0])] + (margin + 0.5)
    inside = (px[:, 0] >= 0) & (px[:, 1] >= 0) & (px[:, 0] < width) & (px[:, 1] < height)
    column, row = px[inside].astype(np.int64).T
    crossed[row, column] = 1


def _fill(crossed: np.ndarray, areas: list[np.ndarray], see: Seen, margin: int) -> bool:
    """Mark all pixels that show convex areas, each by points (n, 3) around it; False where these cannot be told."""
    if not areas:
        return True
    px = see(np.concatenate([np.vstack([points, points.mean(axis=0)]) for points in areas]))[0]
    for own in np.split(px, np.cumsum([len(points) + 1 for points in areas])[:-1]):
        known = np.isfinite(own[:, 0])
        if known.any() and not known.all():
            return False
        if known.all() and np.abs(own).max() < MOST_PX:
            hull = np.rint(cv2.convexHull(own.astype(np.float32)) + margin).astype(np.int32)
            cv2.fillConvexPoly(crossed, hull, 1)
            cv2.polylines(crossed, [hull], True, 1, thickness=3)
    return True


def _returning(world: World) -> list[np.ndarray]:
    """Retro-reflecting marks, which send back what lies behind the eye, with its edges."""
    marks, retro = world.marks, world.retro
    if retro is None:
        return []
    turn = 2 * np.pi * np.arange(POLYGON_SIDES) / POLYGON_SIDES
    around = np.column_stack([np.cos(turn), np.sin(turn)]) / np.cos(np.pi / POLYGON_SIDES)
    reach = marks.printed_radius_mm + retro.shift_mm
    of_ink = np.flatnonzero(world.panels.carry(RETRO)[marks.panel])
    return [
        world.panels.place(np.full(POLYGON_SIDES, marks.panel[k]), marks.xy_mm[k] + reach[k] * around)[0]
        for k in of_ink.tolist()
    ]


def _touching(world: World) -> list[np.ndarray]:
    """Bent panels and meshes that may cut what is not flat."""
    panels, spheres = world.panels, [mesh.sphere for mesh in world.meshes]
    areas = [lattice_mm(panels, k) for k in cut_panels(world).tolist()]
    bent = [(panels.world_from_panel.t_mm[k], np.hypot(*panels.size_mm[k]) / 2) for k in np.flatnonzero(panels.bent)]
    for k, (mesh, (middle, reach)) in enumerate(zip(world.meshes, spheres, strict=True)):
        others = [*bent, *spheres[:k], *spheres[k + 1 :]]
        if any(np.linalg.norm(middle - m) < reach + r for m, r in others):
            areas.append(mesh.vertices_mm)
    return areas


def _kinked(world: World, light: DirectLight, seen: np.ndarray, see: Seen) -> list[np.ndarray] | None:
    """Tiles of panels on which light changes too fast for one ray a pixel, shadows whose edges are sharp, of those
    panels that may be `seen` (panels,); None where it cannot be told where in the image they are."""
    kinks = _kinks(world, light)
    kink, panel, low, side = (column[seen[kinks[1]]] for column in kinks)
    areas: list[np.ndarray] = []
    width, height = world.interior.width_px, world.interior.height_px
    for _ in range(HALVINGS):
        uv = low[:, None] + side[:, None] * RIM
        points = world.panels.place(
            np.repeat(panel, len(RIM)),
            (uv.reshape(-1, 2) - 0.5) * np.repeat(world.panels.size_mm[panel], len(RIM), axis=0),
        )[0]
        px = see(points)[0].reshape(-1, len(RIM), 2)
        known = np.isfinite(px[:, :, 0])
        whole, parted = known.all(axis=1), known.any(axis=1) & ~known.all(axis=1)
        steps = np.linalg.norm(np.roll(px, -1, axis=1) - px, axis=2).min(axis=1)
        reach = 1 + np.linalg.norm(np.ptp(px, axis=1), axis=1)[:, None]
        middle = px.mean(axis=1)
        in_view = np.all((middle > -reach) & (middle < (width, height) + reach), axis=1)
        sharp = whole & in_view & (kink > 2 * steps)
        areas += list(points.reshape(-1, len(RIM), 3)[sharp])
        if not parted.any():
            return areas
        # Partly out of the lens' domain: each quarter on its own.
        kink, panel, low, side = (np.repeat(v[parted], 4, axis=0) for v in (kink, panel, low, side / 2))
        low = low + side * np.tile([[0, 0], [1, 0], [0, 1], [1, 1]], (len(low) // 4, 1))
    seen = np.all((px > -1) & (px < (width + 1, height + 1)), axis=2)
    return None if (parted & seen.any(axis=1)).any() else areas


def _kinks(world: World, light: DirectLight) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of tiles (t,): the pixels that a side must have for its steps to be harmless; their panels, lower left corners
    (t, 2) and sides (t, 2) as parts of the panels."""
    shape, counts = light.tile_shape, light.tile_shape.prod(axis=1)
    panel = np.repeat(np.arange(len(counts)), counts)
    tile = np.flatnonzero(light.kinks > 0)
    panel, within = panel[tile], tile - np.repeat(np.cumsum(counts) - counts, counts)[tile]
    side = 1 / shape[panel][:, ::-1]
    low = np.column_stack([within % shape[panel, 1], within // shape[panel, 1]]) * side
    limit = np.where(np.isin(np.arange(len(counts)), world.marks.panel), KINK, KINK_PLAIN)
    return light.kinks[tile] / limit[panel], panel, low, side
