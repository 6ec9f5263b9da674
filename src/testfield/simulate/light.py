"""How bright every mark will be, boards' and others', with the light that the room throws back once.

`scene/exposure.py` estimates the boards' white to tell a wrong exposure from a right one. A plan needs more: light from
all around reaches each mark by its own sky, and surfaces in its sight return what lamps throw on them. A ray for each
direction says which surface that is; its own light comes from the lamps straight, further bounces are a geometric
series of the mean reflectance. Good to a few percent in matt rooms, that is to half of it in a standard uncertainty.
"""

import numpy as np

from testfield.scene.exposure import flash_light
from testfield.scene.sight import first_hits, hidden_by_meshes
from testfield.scene.sunflower import sunflower
from testfield.scene.world import LUMINOUS, TrueMesh, World

DIRECTIONS = 48
LIFT_MM = 0.5
LAMP_NODES = 2
"""Along each side of each quarter of a lamp."""
MOST_RAYS = 400_000
"""More marks get fewer directions each."""


def white_and_contrast(world: World, panels: TrueMesh, of_panel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(marks,) radiance in W/(m^2 sr) of the white at each mark, and how much brighter than black it is; with a flash,
    as the station sees it that is lit best. `panels` is all that is flat, `of_panel` (f,) whose face each is, -1 where
    it is a lamp's."""
    panel = world.marks.panel
    ink, ground = world.panels.ink_albedo[panel], world.panels.ground_albedo[panel]
    white, black = np.maximum(ink, ground), np.minimum(ink, ground)
    flash, returned = flash_light(world)
    points, frames = world.panels.place(panel, world.marks.xy_mm)
    light = irradiance_at(world, points, frames, panels, of_panel) + flash
    shining = np.where(world.panels.carry(LUMINOUS)[panel], world.luminous_radiance, 0)
    bright = white * light / np.pi + returned + shining
    return bright, bright - black * light / np.pi


def irradiance_at(
    world: World, points: np.ndarray, frames: np.ndarray, panels: TrueMesh, of_panel: np.ndarray
) -> np.ndarray:
    """(n,) irradiance in W/m^2 of places (n, 3) on surfaces whose frames (n, 3, 3) have the normal last."""
    obstacles = (panels, *world.meshes)
    normals = frames[:, :, 2]
    lifted = points + LIFT_MM * normals
    straight = lamp_light(world, lifted, normals, obstacles)
    around = world.ambient_radiance if world.sky is None else float(world.sky.radiance.mean())
    count = int(np.clip(MOST_RAYS // max(len(points), 1), 12, DIRECTIONS))
    across = sunflower(count)
    local = np.column_stack([across, np.sqrt(1 - (across**2).sum(axis=1))])  # evenly by the cosine
    ways = np.einsum("nij,kj->nki", frames, local).reshape(-1, 3)
    origin = np.repeat(lifted, count, axis=0)
    face, distance = first_hits(origin, ways, obstacles)
    met = face >= 0
    albedo, normal = _surfaces(world, panels, of_panel)
    light = np.where(met, 0.0, around)
    there = np.flatnonzero(met)
    if len(there):
        own = normal[face[there]]
        own = own * -np.sign(np.einsum("ni,ni->n", own, ways[there]))[:, None]  # the side that is seen
        place = origin[there] + distance[there, None] * ways[there] + LIFT_MM * own
        lamps = lamp_light(world, place, own, obstacles)
        sky = np.pi * around * float(1 - met.mean())
        series = 1 / (1 - float(albedo[face[there]].mean()) * float(met.mean()))
        light[there] = albedo[face[there]] / np.pi * (lamps + sky) * series
    return np.asarray(straight + np.pi * light.reshape(len(points), count).mean(axis=1))


def _surfaces(world: World, panels: TrueMesh, of_panel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance (f,) and unit normal (f, 3) of all faces, the panels' first; a lamp's own light has been counted."""
    albedo = np.where(of_panel >= 0, world.panels.ground_albedo[np.maximum(of_panel, 0)], 0.0)
    parts = [albedo, *(np.full(len(mesh.faces), mesh.albedo) for mesh in world.meshes)]
    return np.concatenate(parts), np.concatenate([panels.normals, *(mesh.normals for mesh in world.meshes)])


def lamp_light(world: World, points: np.ndarray, normals: np.ndarray, obstacles: tuple[TrueMesh, ...]) -> np.ndarray:
    """(n,) irradiance in W/m^2 straight from lamps and lights without size on places (n, 3) with normals (n, 3); a lamp
    is seen in four parts."""
    total = np.zeros(len(points))
    node, weight = np.polynomial.legendre.leggauss(LAMP_NODES)
    for lamp in world.lights:
        R, middle = lamp.world_from_light.R[0], lamp.world_from_light.t_mm[0]
        for sign in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            centre = middle + R[:, :2] @ (np.array(sign) * lamp.size_mm) / 4 + R[:, 2]
            faces = ((points - centre) @ R[:, 2] > 0) & (((centre - points) * normals).sum(axis=1) > 0)
            lit = np.flatnonzero(faces)
            lit = lit[~hidden_by_meshes(centre, points[lit], obstacles)]
            for x, wx in zip(node, weight, strict=True):
                for y, wy in zip(node, weight, strict=True):
                    at = centre + R[:, :2] @ (np.array([x, y]) * lamp.size_mm) / 4
                    to = at - points[lit]
                    d2 = (to**2).sum(axis=1)
                    cosines = np.maximum((to * normals[lit]).sum(axis=1), 0) * np.maximum(-(to @ R[:, 2]), 0) / d2
                    total[lit] += lamp.radiance * wx * wy / 16 * lamp.size_mm[0] * lamp.size_mm[1] * cosines / d2
    for point in world.point_lights:
        to = point.position_mm - points
        d2 = (to**2).sum(axis=1)
        cosine = np.maximum((to * normals).sum(axis=1) / np.sqrt(d2), 0)
        lit = ~hidden_by_meshes(point.position_mm, points, obstacles)
        total += np.where(lit, point.intensity_w_sr * 1e6 * cosine / d2, 0)
    return total
