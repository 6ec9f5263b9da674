"""The light on meshes, known at nodes of every face and interpolated between them.

A face is divided into n x n small triangles of its own shape, and light is known at their corners. Neighbouring faces
share no nodes, because irradiance depends on the face's normal. Direct light is computed at every node, and a face gets
more of them until interpolation keeps the tolerance; indirect light is computed at places apart from each other and is
the mean of those near a node in place and in direction.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from testfield.render.direct import direct_irradiance
from testfield.render.lookup import bin_of
from testfield.render.variant import mitsuba
from testfield.scene.world import TrueMesh, World

MOST_CELLS = 64
FINEST_MM = 2.0
"""Nodes are not set closer than this for the sake of a shadow's edge."""
TOLERANCE = 2e-2
"""Error of interpolation of direct light as a part of the brightest node of all meshes."""
LATTICE = 377
"""Shadow rays from a node to a lamp: a Fibonacci number, see `direct.py`."""
NEAR = 8
TURN = 0.4
"""A difference of normals of this length counts as much as a distance of the light's spacing."""
ABOVE_MM = 0.02
CLEAR_MM = 3.0
"""Indirect light is estimated this high above the surface, over stickers: one estimate serves all around it."""


@dataclass(frozen=True)
class Sides:
    """What can be seen of all meshes: the outer sides of closed ones; of open ones both, the inner after the outer.

    `corners_mm` (s, 3, 3), `normals` (s, 3) towards the viewer.
    """

    corners_mm: np.ndarray
    normals: np.ndarray

    @staticmethod
    def of(meshes: tuple[TrueMesh, ...]) -> "Sides":
        """All sides in the order of meshes and faces."""
        corners, normals = [np.zeros((0, 3, 3))], [np.zeros((0, 3))]
        for mesh in meshes:
            for sign in (1,) if mesh.closed else (1, -1):
                corners.append(mesh.corners_mm)
                normals.append(sign * mesh.normals)
        return Sides(np.concatenate(corners), np.concatenate(normals))


@dataclass(frozen=True)
class MeshLight:
    """Irradiance on meshes in W/m^2. `cells` (sides,) along each edge; `values` all sides' nodes one after the other,
    float32: rows along the first edge, then towards the third corner."""

    cells: np.ndarray
    values: np.ndarray

    @staticmethod
    def even(meshes: tuple[TrueMesh, ...], value: float) -> "MeshLight":
        """The same irradiance everywhere."""
        sides = len(Sides.of(meshes).normals)
        return MeshLight(np.ones(sides, int), np.full(3 * sides, value, np.float32))


class LitMeshes:
    """Meshes of a world under direct light, and the places at which the indirect light on them is to be estimated."""

    def __init__(self, world: World, scene: Any, spacing_mm: float):
        """`scene` the world's Mitsuba scene; `spacing_mm` about between the places."""
        sides = Sides.of(world.meshes)
        edge = np.linalg.norm(sides.corners_mm - np.roll(sides.corners_mm, 1, axis=1), axis=2).max(axis=1)
        cells = np.clip(2 ** np.ceil(np.log2(np.maximum(edge / spacing_mm, 1))), 1, MOST_CELLS).astype(int)
        self.indirect = _Indirect(sides, cells, spacing_mm)
        values: list[np.ndarray] = [np.zeros(0)] * len(cells)
        active, n = np.arange(len(cells)), cells.copy()
        coarse: dict[int, np.ndarray] = {}
        brightest = 0.0
        while len(active):
            for side, light in zip(active, _direct(world, scene, sides, active, n[active]), strict=True):
                values[side] = light
            if not coarse:
                brightest = max(float(values[side].max()) for side in active)
            unsettled = [
                side
                for side in active.tolist()
                if (side not in coarse or _interpolation_error(coarse[side], values[side]) > TOLERANCE * brightest)
                and 2 * n[side] <= MOST_CELLS
                and edge[side] / (2 * n[side]) >= FINEST_MM
            ]
            coarse = {side: values[side] for side in unsettled}
            active = np.array(unsettled, int)
            n[active] *= 2
        self.points, self.normals, _ = _places(sides, np.arange(len(n)), n)
        self.cells, self.direct = n, np.concatenate([np.zeros(0), *values])

    def with_indirect(self, values: np.ndarray) -> MeshLight:
        """All light on them, from the indirect irradiance at the places."""
        smooth = self.indirect.at(values, self.points, self.normals)
        return MeshLight(self.cells, (self.direct + smooth).astype(np.float32))


def node_weights(n: int) -> np.ndarray:
    """(nodes, 3) barycentric weights of the nodes of a face with n cells along each edge."""
    j, i = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    i, j = i[i + j <= n], j[i + j <= n]
    return np.column_stack([n - i - j, i, j]) / n


def _places(sides: Sides, which: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points just above the nodes of some sides, their normals, and how many nodes each side has."""
    counts = (n + 1) * (n + 2) // 2
    start = np.cumsum(counts) - counts
    points = np.empty((counts.sum(), 3))
    for size in np.unique(n):
        here = np.flatnonzero(n == size)
        # A little inside the face, so that at an inner edge a point does not lie behind the neighbour.
        weights = 0.98 * node_weights(size) + 0.02 / 3
        at = start[here, None] + np.arange(counts[here[0]])
        points[at] = np.einsum("ki,sij->skj", weights, sides.corners_mm[which[here]])
    normals = np.repeat(sides.normals[which], counts, axis=0)
    return points + ABOVE_MM * normals, normals, counts


def _direct(world: World, scene: Any, sides: Sides, which: np.ndarray, n: np.ndarray) -> list[np.ndarray]:
    points, normals, counts = _places(sides, which, n)
    light = direct_irradiance(world, scene, points, normals, np.full(len(points), -1), LATTICE)
    return np.split(light, np.cumsum(counts)[:-1])


def _interpolation_error(coarse: np.ndarray, fine: np.ndarray) -> float:
    """Largest difference of the fine nodes of a face from interpolation between every second one."""
    n = int(np.sqrt(2 * len(fine))) - 1  # (n + 1) (n + 2) / 2 nodes
    i, j = (np.rint(node_weights(n)[:, k] * n).astype(int) for k in (1, 2))
    # A node in the middle of an edge lies between its two ends.
    low_i, low_j = i // 2, (j + 1) // 2
    high_i, high_j = (i + 1) // 2, j // 2
    middle = (coarse[_row(low_i, low_j, n // 2)] + coarse[_row(high_i, high_j, n // 2)]) / 2
    return float(np.abs(middle - fine).max())


def _row(i: Any, j: Any, n: Any) -> Any:
    """Place of node (i, j) in the order of `node_weights`."""
    return j * (n + 1) - (j * j - j) // 2 + i


class _Indirect:
    """Indirect light anywhere on the sides, from estimates at `places` about the light's spacing apart."""

    def __init__(self, sides: Sides, cells: np.ndarray, spacing_mm: float):
        points, normals, _ = _places(sides, np.arange(len(cells)), cells)
        self.spacing_mm = spacing_mm
        _, chosen = np.unique(np.floor(self._key(points, normals)), axis=0, return_index=True)
        points, normals = points[chosen], normals[chosen]
        helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
        tangents = np.cross(normals, helper)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        self.tree = cKDTree(self._key(points, normals))
        self.places = points + CLEAR_MM * normals, normals, tangents

    def _key(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        return np.column_stack([points / self.spacing_mm, normals / TURN])

    def at(self, values: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(n,) the weighted mean of the nearest estimates."""
        if not len(values):
            return np.zeros(0)
        distance, near = self.tree.query(self._key(points, normals), min(NEAR, len(values)))
        distance, near = distance.reshape(len(points), -1), near.reshape(len(points), -1)
        weight = np.exp(-2 * (distance**2 - distance[:, :1] ** 2))
        return (weight * values[near]).sum(axis=1) / weight.sum(axis=1)


class MeshLookup:
    """Radiance of meshes on the device."""

    def __init__(self, world: World, light: MeshLight, shape_numbers: tuple[int, ...]):
        """`shape_numbers` Mitsuba's number of every mesh's shape."""
        mi = mitsuba()
        table = np.zeros((3, max(shape_numbers) + 1), np.uint32)  # one plus the first side, faces, whether closed
        albedo = np.zeros(table.shape[1], np.float32)
        first = 0
        for mesh, number in zip(world.meshes, shape_numbers, strict=True):
            table[:, number] = first + 1, len(mesh.faces), mesh.closed
            albedo[number] = mesh.albedo
            first += len(mesh.faces) * (1 if mesh.closed else 2)
        self.first, self.faces, self.closed = (mi.UInt32(row) for row in table)
        self.albedo = mi.Float(albedo)
        counts = (light.cells + 1) * (light.cells + 2) // 2
        self.cells = mi.UInt32(light.cells.astype(np.uint32))
        self.start = mi.UInt32((np.cumsum(counts) - counts).astype(np.uint32))
        self.values = mi.Float(light.values)
        self.last_shape = len(albedo) - 1

    def radiance(self, hit: Any, front: Any) -> tuple[Any, Any, Any]:
        """Whether each hit is on a mesh, the radiance there, and the albedo of what is seen of it.

        `front` where the face is seen from outside.
        """
        mi = mitsuba()
        import drjit as dr

        number: Any = dr.reinterpret_array(mi.UInt32, hit.shape)
        known = number <= self.last_shape
        first = dr.gather(mi.UInt32, self.first, number, known)
        here = hit.is_valid() & (first > 0)
        closed = dr.gather(mi.UInt32, self.closed, number, here) > 0
        seen = here & (front | ~closed)
        side = first - 1 + hit.prim_index
        side = dr.select(front, side, side + dr.gather(mi.UInt32, self.faces, number, here))
        n = dr.gather(mi.UInt32, self.cells, side, seen)
        # Without texture coordinates a mesh's uv are the barycentric weights of the second and third corner.
        u, v = hit.uv.x * mi.Float(n), hit.uv.y * mi.Float(n)
        cells = dr.maximum(n, 1)
        i = bin_of(u, cells)
        j = bin_of(v, cells - i)
        fu, fv = dr.clip(u - mi.Float(i), 0, 1), dr.clip(v - mi.Float(j), 0, 1)
        far = (fu + fv > 1) & (i + j < cells - 1)
        start = dr.gather(mi.UInt32, self.start, side, seen)

        def value(di: int, dj: int, where: Any) -> Any:
            return dr.gather(mi.Float, self.values, start + _row(i + di, j + dj, n), where)

        b, c = value(1, 0, seen), value(0, 1, seen)
        near = (1 - fu - fv) * value(0, 0, seen) + fu * b + fv * c
        beyond = (fu + fv - 1) * value(1, 1, seen & far) + (1 - fv) * b + (1 - fu) * c
        albedo = dr.gather(mi.Float, self.albedo, number, seen)
        light = dr.select(far, beyond, near) * albedo / dr.pi
        return here, dr.select(seen, light, 0), albedo
