"""Light that comes straight from the lamps: without noise, and with its shadows.

From a rectangular lamp in full view it is a smooth integral, done by Gauss-Legendre quadrature over the lamp. What flat
panels hide of it is known in closed form (`shadow.py`). Where a bent one or a mesh may stand between, the visible part
is counted on a lattice of rays that is the same for every point, so neighbouring points see the same shadow edge.
Panels are cut into tiles; a tile gets finer nodes until interpolation between them keeps the tolerance, so only
penumbrae cost anything.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.render.fetch import fetch
from testfield.render.lookup import cell_of
from testfield.render.shadow import Rectangles, visible_part
from testfield.render.variant import mitsuba
from testfield.scene.world import AreaLight, World

QUADRATURE = 12
LATTICE = 4181
"""A Fibonacci number: the golden-ratio lattice of this many points has no preferred direction."""
RAYS_A_PASS, POINTS_A_PASS = 1 << 23, 1 << 13
LEVELS = (3, 5, 9, 17, 33)
"""Nodes along each side of a tile."""
TILE_MM, TILE_PLAIN_MM = 120.0, 600.0
TOLERANCE, TOLERANCE_PLAIN = 1e-3, 2e-2
"""Error of interpolation as a part of the panel's brightest node: on panels with marks, and on plain ones."""


@dataclass(frozen=True)
class DirectLight:
    """Direct irradiance in W/m^2 at the nodes of tiles that cover every panel.

    `tile_shape` (panels, 2) rows and columns of tiles; `nodes` (tiles,) along each side of a tile, edges included;
    `values` all tiles' nodes one after the other, row by row from the panel's lower left, float32.
    """

    tile_shape: np.ndarray
    nodes: np.ndarray
    values: np.ndarray

    @cached_property
    def kinks(self) -> np.ndarray:
        """(tiles,) the largest step of the light's slope within each, for lengths in the tile's sides, as a part of the
        panel's brightest node."""
        panel = np.repeat(np.arange(len(self.tile_shape)), self.tile_shape.prod(axis=1))
        first = np.cumsum(self.nodes**2) - self.nodes**2
        brightest, kink = np.zeros(len(self.tile_shape)), np.zeros(len(panel))
        for n in np.unique(self.nodes).tolist():
            own = np.flatnonzero(self.nodes == n)
            values = self.values[first[own, None] + np.arange(n * n)].reshape(-1, n, n)
            np.maximum.at(brightest, panel[own], values.max(axis=(1, 2)))
            bends = (np.abs(np.diff(values, 2, axis=k)).reshape(len(own), -1).max(axis=1, initial=0) for k in (1, 2))
            kink[own] = np.maximum(*bends) * (n - 1)
        return kink / np.maximum(brightest[panel], 1e-30)


def compute_direct(world: World, scene: Any, levels: tuple[int, ...] = LEVELS, rays: int = LATTICE) -> DirectLight:
    """Direct light on every panel of a world whose Mitsuba scene is `scene`; `levels` of nodes along a tile's side and
    `rays` to a lamp that may be hidden are fewer for a first look."""
    marked = np.isin(np.arange(len(world.panels)), world.marks.panel)
    side = np.where(marked, TILE_MM, TILE_PLAIN_MM)
    shape = np.maximum(np.ceil(world.panels.size_mm[:, ::-1] / side[:, None]).astype(int), 1)
    panel = np.repeat(np.arange(len(shape)), shape.prod(axis=1))
    within = np.concatenate([np.arange(n) for n in shape.prod(axis=1)])
    row, column = within // shape[panel, 1], within % shape[panel, 1]
    values = [np.zeros((0, 0))] * len(panel)
    active = np.arange(len(panel))
    coarse: dict[int, np.ndarray] = {}
    brightest = np.zeros(len(shape))
    for level, n in enumerate(levels):
        if len(active) == 0:
            break
        at = np.linspace(0, 1, n)
        v, u = np.meshgrid(at, at, indexing="ij")
        uv = np.stack(
            [
                (column[active, None] + u.ravel()) / shape[panel[active], 1, None],
                (row[active, None] + v.ravel()) / shape[panel[active], 0, None],
            ],
            axis=-1,
        )
        points, normals, owner = _places(world, np.repeat(panel[active], n * n), uv.reshape(-1, 2))
        light = direct_irradiance(world, scene, points, normals, owner, rays).reshape(len(active), n, n)
        if level == 0:
            np.maximum.at(brightest, panel[active], light.max(axis=(1, 2)))
        unsettled = []
        for k, tile in enumerate(active.tolist()):
            values[tile] = light[k]
            if level == 0 or _interpolation_error(coarse[tile], light[k]) > brightest[panel[tile]] * (
                TOLERANCE if marked[panel[tile]] else TOLERANCE_PLAIN
            ):
                unsettled.append(tile)
                coarse[tile] = light[k]
        active = np.array(unsettled, int)
    return DirectLight(
        shape, np.array([v.shape[0] for v in values]), np.concatenate([v.ravel() for v in values]).astype(np.float32)
    )


def _places(world: World, panel: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World points just above panels, their normals, and the panels."""
    local = (uv - 0.5) * world.panels.size_mm[panel]
    points, frames = world.panels.place(panel, local)
    return points + 0.02 * frames[:, :, 2], frames[:, :, 2], panel


def _interpolation_error(coarse: np.ndarray, fine: np.ndarray) -> float:
    """Largest difference of the fine nodes from a bilinear interpolation of every second one of them."""
    n = len(coarse)
    between = (coarse[:-1] + coarse[1:]) / 2
    rows = np.empty((2 * n - 1, n))
    rows[::2], rows[1::2] = coarse, between
    full = np.empty((2 * n - 1, 2 * n - 1))
    full[:, ::2], full[:, 1::2] = rows, (rows[:, :-1] + rows[:, 1:]) / 2
    return float(np.abs(full - fine).max())


def direct_irradiance(
    world: World, scene: Any, points_mm: np.ndarray, normals: np.ndarray, own_panel: np.ndarray, rays: int = LATTICE
) -> np.ndarray:
    """(n,) irradiance in W/m^2 that reaches points (n, 3) with normals (n, 3) on their panels (n,) from all lamps.

    A point on a mesh has panel -1. `rays`, a Fibonacci number, go to each lamp that may be hidden.
    """
    total = np.zeros(len(points_mm))
    for number, light in enumerate(world.lights):
        full = _unhidden(light, points_mm, normals)
        lit = np.flatnonzero(full > 0)
        flat, hides, by_rays = _may_hide(world, number, points_mm[lit], own_panel[lit])
        some = lit[hides.any(axis=1) & ~by_rays]
        if len(some):
            asked = hides[hides.any(axis=1) & ~by_rays]
            full[some] *= visible_part(light, flat, points_mm[some], normals[some], asked)
        some = lit[by_rays]
        if len(some):
            full[some] *= _visible_part(light, scene, points_mm[some], normals[some], rays)
        total += full
    return total


def _unhidden(light: AreaLight, points_mm: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Irradiance from a lamp in full view: radiance x integral of cos cos' / d^2 over the lamp."""
    node, weight = np.polynomial.legendre.leggauss(QUADRATURE)
    x, y = np.meshgrid(node / 2, node / 2)
    w = np.outer(weight, weight).ravel() / 4 * light.size_mm[0] * light.size_mm[1]
    R, t = light.world_from_light.R[0], light.world_from_light.t_mm[0]
    places = np.column_stack([x.ravel() * light.size_mm[0], y.ravel() * light.size_mm[1]]) @ R[:, :2].T
    total = np.empty(len(points_mm))
    for start in range(0, len(points_mm), POINTS_A_PASS):
        part = slice(start, start + POINTS_A_PASS)
        own, normal = points_mm[part] - t, normals[part]
        rise = normal @ places.T - (normal * own).sum(axis=1)[:, None]
        square = (own**2).sum(axis=1)[:, None] + (places**2).sum(axis=1) - 2 * own @ places.T
        facing = np.maximum(own @ R[:, 2], 0)
        total[part] = facing * (np.maximum(rise, 0) / square**2 @ w)
    return light.radiance * total


def _may_hide(
    world: World, number: int, points_mm: np.ndarray, own_panel: np.ndarray
) -> tuple[Rectangles, np.ndarray, np.ndarray]:
    """All flat surfaces, (n, k) which of them may stand between points (n, 3) on panels (n,) and lamp `number`, and
    (n,) whether something that is not flat may."""
    light, panels = world.lights[number], world.panels
    centre = light.world_from_light.t_mm[0]
    radius = np.hypot(*light.size_mm) / 2
    axis = centre - points_mm
    distance = np.linalg.norm(axis, axis=1)
    axis = axis / distance[:, None]

    def in_the_way(middle: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """(n, k) where spheres (k, 3), (k,) touch the cones from points to the lamp's bounding sphere."""
        found = np.empty((len(points_mm), len(middle)), bool)
        for start in range(0, len(points_mm), POINTS_A_PASS):
            part = slice(start, start + POINTS_A_PASS)
            to = [middle[:, i] - points_mm[part, i, None] for i in range(3)]
            along = sum(to[i] * axis[part, i, None] for i in range(3))
            aside = sum((to[i] - along * axis[part, i, None]) ** 2 for i in range(3))
            far = distance[part, None]
            room = reach + radius * np.clip((along + reach) / far, 0, 1)
            found[part] = (along > -reach) & (along < far + reach) & (aside < room * room)
        return found

    which = np.flatnonzero(~panels.bent)
    lamps = [other for k, other in enumerate(world.lights) if k != number]
    poses = [panels.world_from_panel[which], *[other.world_from_light for other in lamps]]
    flat = Rectangles(
        Poses(np.concatenate([p.R for p in poses]), np.concatenate([p.t_mm for p in poses])),
        np.concatenate([panels.size_mm[which], np.reshape([other.size_mm for other in lamps], (-1, 2))]),
    )
    hides = in_the_way(flat.pose.t_mm, np.hypot(*flat.size_mm.T) / 2)
    hides[:, : len(which)] &= own_panel[:, None] != which
    for k in range(len(flat)):
        near = np.flatnonzero(hides[:, k])
        hides[near, k] = flat.may_hide(k, light, points_mm[near])
    bent, spheres = np.flatnonzero(panels.bent), [mesh.sphere for mesh in world.meshes]
    by_rays = in_the_way(
        np.array([*panels.world_from_panel.t_mm[bent], *[middle for middle, _ in spheres]]).reshape(-1, 3),
        np.array([*np.hypot(*panels.size_mm[bent].T) / 2, *[reach for _, reach in spheres]]),
    )
    # A hollow panel may shade itself.
    by_rays[:, : len(bent)] &= (own_panel[:, None] != bent) | (panels.curvature_per_mm[bent] < 0)
    return flat, hides, np.any(by_rays, axis=1)


def _visible_part(light: AreaLight, scene: Any, points_mm: np.ndarray, normals: np.ndarray, rays: int) -> np.ndarray:
    """(n,) part of a lamp's light that is not hidden, by `rays` to a lattice on the lamp."""
    mi = mitsuba()
    import drjit as dr

    k = np.arange(rays)
    lattice = np.column_stack([(k + 0.5) / rays, (k * 0.6180339887498949) % 1]) - 0.5
    R, t = light.world_from_light.R[0], light.world_from_light.t_mm[0]
    places = (t + (lattice * light.size_mm) @ R[:, :2].T).astype(np.float32)
    device = [mi.Float(np.ascontiguousarray(places[:, i])) for i in range(3)]
    facing = mi.Vector3f(*R[:, 2].tolist())
    batch = max(1, RAYS_A_PASS // rays)
    part = np.empty(len(points_mm))
    for start in range(0, len(points_mm), batch):
        # Every batch has the same size, so that one kernel serves all; the last one wraps round.
        index = (np.arange(batch) + start) % len(points_mm)
        ray = dr.arange(mi.UInt32, batch * rays)
        point, sample = ray // rays, ray % rays

        def gather(values: np.ndarray, at: Any) -> Any:
            return mi.Vector3f(
                *[dr.gather(mi.Float, mi.Float(np.ascontiguousarray(values[:, i], np.float32)), at) for i in range(3)]
            )

        origin, normal = gather(points_mm[index], point), gather(normals[index], point)
        to = mi.Vector3f(*[dr.gather(mi.Float, values, sample) for values in device]) - origin
        d2 = dr.squared_norm(to)
        weight = dr.maximum(dr.dot(to, normal), 0) * dr.maximum(-dr.dot(to, facing), 0) / (d2 * d2)
        shadow = mi.Ray3f(mi.Point3f(origin), to * dr.rsqrt(d2), dr.sqrt(d2) * (1 - 1e-4), 0.0, mi.Color0f())
        lit = dr.select(scene.ray_test(shadow, weight > 0), 0, weight)
        dr.eval(lit, weight)
        lit_sum, all_sum = (fetch(v).reshape(batch, rays).sum(axis=1, dtype=np.float64) for v in (lit, weight))
        fresh = min(batch, len(points_mm) - start)
        part[start : start + fresh] = (lit_sum / np.maximum(all_sum, 1e-300))[:fresh]
    return part


class DirectLookup:
    """Bilinear look-up in tiles, on the device."""

    def __init__(self, light: DirectLight):
        mi = mitsuba()
        self.rows, self.columns = (mi.UInt32(light.tile_shape[:, k].astype(np.uint32)) for k in (0, 1))
        first = np.concatenate([[0], np.cumsum(light.tile_shape.prod(axis=1))[:-1]])
        self.first = mi.UInt32(first.astype(np.uint32))
        self.nodes = mi.UInt32(light.nodes.astype(np.uint32))
        self.start = mi.UInt32(np.concatenate([[0], np.cumsum(light.nodes**2)[:-1]]).astype(np.uint32))
        self.values = mi.Float(light.values)

    def at(self, panel: Any, uv: Any) -> Any:
        """Direct irradiance at panel coordinates uv in [0, 1]^2."""
        mi = mitsuba()
        import drjit as dr

        rows, columns = dr.gather(mi.UInt32, self.rows, panel), dr.gather(mi.UInt32, self.columns, panel)
        # Tiles share their outermost nodes, so a tile of a row of tiles is an interval between its ends.
        (column, x), (row, y) = cell_of(uv.x * mi.Float(columns), columns + 1), cell_of(uv.y * mi.Float(rows), rows + 1)
        tile = dr.gather(mi.UInt32, self.first, panel) + row * columns + column
        nodes = dr.gather(mi.UInt32, self.nodes, tile)
        (i, fx), (j, fy) = cell_of(x * mi.Float(nodes - 1), nodes), cell_of(y * mi.Float(nodes - 1), nodes)
        node = dr.gather(mi.UInt32, self.start, tile) + j * nodes + i
        a, b = (dr.gather(mi.Float, self.values, node + k) for k in (0, 1))
        c, d = (dr.gather(mi.Float, self.values, node + nodes + k) for k in (0, 1))
        return (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d)
