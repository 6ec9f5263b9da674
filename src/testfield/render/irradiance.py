"""The light on every panel, computed once a world and used by every view.

On a matt surface irradiance does not depend on the viewer. What comes straight from the lamps is computed without noise
(`direct.py`). Everything else, light that was reflected before and light from all around, is smooth; it is estimated
with Mitsuba's path integrator at a grid of points on each panel and replaced by the polynomial that predicts it best.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from testfield.render.device_maths import opaque_float
from testfield.render.direct import LATTICE, LEVELS, DirectLight, DirectLookup, compute_direct
from testfield.render.fetch import fetch
from testfield.render.lookup import cell_of
from testfield.render.mesh_light import MeshLight, compute_mesh_light
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba
from testfield.scene.world import TrueMesh
from testfield.store.sheets import FORMAT

PATHS_A_PASS = 1 << 21
MESH_SEEDS = 1 << 20
"""Batches on meshes take seeds from here on, so that none is used twice."""
SMOOTH_NODES = 33
MAX_DEPTH = 6
GOLDEN = 0.6180339887498949
MOST_DEGREE = 12
MESH_PATHS = 0.25
"""Paths for a point on a mesh as a part of those for one on a panel; nothing is measured on a mesh's own shade."""

NO_MESHES = MeshLight.even((), 0)


@dataclass(frozen=True)
class Irradiance:
    """Irradiance on all panels in W/m^2: indirect at nodes that span each panel edge to edge, and direct in tiles.

    `shape` (panels, 2) rows and columns of the indirect nodes; `values` all grids one after the other, float32;
    `meshes` that on meshes.
    """

    shape: np.ndarray
    values: np.ndarray
    direct: DirectLight
    meshes: MeshLight = NO_MESHES

    def save(self, path: Path) -> None:
        """Write as NPZ."""
        d, m = self.direct, self.meshes
        with path.open("wb") as file:
            np.savez(
                file,
                shape=self.shape,
                values=self.values,
                tile_shape=d.tile_shape,
                nodes=d.nodes,
                direct=d.values,
                mesh_cells=m.cells,
                meshes=m.values,
                format=FORMAT,
            )

    @staticmethod
    def load(path: Path) -> "Irradiance":
        """Read what `save` wrote."""
        with np.load(path) as data:
            direct = DirectLight(data["tile_shape"], data["nodes"], data["direct"])
            return Irradiance(data["shape"], data["values"], direct, MeshLight(data["mesh_cells"], data["meshes"]))

    @staticmethod
    def even(panels: int, value: float, meshes: tuple[TrueMesh, ...] = ()) -> "Irradiance":
        """The same irradiance everywhere on some panels and meshes."""
        nothing = DirectLight(np.ones((panels, 2), int), np.full(panels, 2), np.zeros(4 * panels, np.float32))
        values = np.full(4 * panels, value, np.float32)
        return Irradiance(np.full((panels, 2), 2), values, nothing, MeshLight.even(meshes, value))


def grid_shape(size_mm: np.ndarray, spacing_mm: float) -> np.ndarray:
    """(panels, 2) rows and columns of the points at which light is estimated."""
    return np.clip(np.ceil(size_mm[:, ::-1] / spacing_mm).astype(int), 5, 64)


def compute_irradiance(
    stage: Stage,
    spacing_mm: float,
    paths: int,
    seed: int,
    progress: Callable[[float], None],
    levels: tuple[int, ...] = LEVELS,
    rays: int = LATTICE,
) -> Irradiance:
    """Estimate the light on every panel of a stage.

    `spacing_mm` between points, `paths` for each point, `seed` of the random numbers, `progress` is told the fraction
    done of the work since the last call; `levels` and `rays` as in `compute_direct`.
    """
    world = stage.world
    shapes = grid_shape(world.panels.size_mm, spacing_mm)
    position, normal, tangent = [], [], []
    for k, (rows, columns) in enumerate(shapes):
        u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        local = np.column_stack([(u.ravel() - 0.5), (v.ravel() - 0.5)]) * world.panels.size_mm[k]
        place, frame = world.panels.place(np.full(u.size, k), local)
        position.append(place + 0.02 * frame[:, :, 2])
        normal.append(frame[:, :, 2])
        tangent.append(frame[:, :, 0])
    points, normals, tangents = (np.concatenate(part) for part in (position, normal, tangent))
    mean, variance = _estimate(stage, points, normals, tangents, paths, seed, progress)

    grids, start = [], 0
    for rows, columns in shapes:
        part = slice(start, start + rows * columns)
        start += rows * columns
        grids.append(_nodes(mean[part].reshape(rows, columns), variance[part].reshape(rows, columns)))

    def on_meshes(points: np.ndarray, normals: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        fewer = max(16, int(paths * MESH_PATHS))
        return _estimate(stage, points, normals, tangents, fewer, seed + MESH_SEEDS, lambda _: None)[0]

    return Irradiance(
        np.array([grid.shape for grid in grids]),
        np.concatenate([grid.ravel() for grid in grids]).astype(np.float32),
        compute_direct(world, stage.scene, levels, rays),
        compute_mesh_light(world, stage.scene, spacing_mm, on_meshes),
    )


def _estimate(
    stage: Stage,
    points: np.ndarray,
    normals: np.ndarray,
    tangents: np.ndarray,
    paths: int,
    seed: int,
    progress: Callable[[float], None],
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) means of `paths` unbiased estimates of indirect irradiance at points (n, 3), and the means' variances."""
    mean, variance = np.empty(len(points)), np.empty(len(points))
    batch = max(1, PATHS_A_PASS // paths)
    batches = -(-len(points) // batch)
    # Every batch has the same size, so that one kernel serves all; the last one wraps round.
    for k in range(batches):
        index = (np.arange(batch) + k * batch) % len(points)
        samples = _sample(stage, points[index], normals[index], tangents[index], paths, seed, k)
        fresh = min(batch, len(points) - k * batch)
        mean[index[:fresh]] = samples.mean(axis=1, dtype=np.float64)[:fresh]
        variance[index[:fresh]] = samples.var(axis=1, dtype=np.float64)[:fresh] / paths
        progress(1 / batches)
    return mean, variance


def _sample(
    stage: Stage, points: np.ndarray, normals: np.ndarray, tangents: np.ndarray, paths: int, seed: int, batch: int
) -> np.ndarray:
    """(points, paths) unbiased estimates of indirect irradiance."""
    mi = mitsuba()
    import drjit as dr

    count = len(points) * paths
    point = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, paths)

    def at(values: np.ndarray) -> Any:
        return mi.Vector3f(
            *[dr.gather(mi.Float, mi.Float(np.ascontiguousarray(values[:, k], np.float32)), point) for k in range(3)]
        )

    position, normal, tangent = mi.Point3f(at(points)), at(normals), at(tangents)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed + batch, count)
    # Cosine-distributed directions on a golden-ratio lattice, the same at all points: what is left of its error changes
    # little from point to point, and only a gradient moves a centre. Straight light from a lamp is not part of this.
    path = mi.Float(dr.arange(mi.UInt32, count) % dr.opaque(mi.UInt32, paths))
    shift = [opaque_float(v) for v in np.random.default_rng(seed).random(2)]
    square = mi.Point2f((path + 0.5) / dr.opaque(mi.Float, paths) + shift[0], path * GOLDEN + shift[1])
    local = mi.warp.square_to_cosine_hemisphere(square - dr.floor(square))
    bitangent = dr.cross(normal, tangent)
    ray = mi.RayDifferential3f(mi.Ray3f(position, tangent * local.x + bitangent * local.y + normal * local.z))
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 1000})
    radiance, _, _ = integrator.sample(stage.scene, sampler, ray)
    hit = stage.scene.ray_intersect(ray)
    direct = dr.select(hit.is_valid() & stage.is_lamp(hit), hit.emitter(stage.scene).eval(hit)[0], 0)
    total = dr.pi * (radiance[0] - direct)
    return fetch(total).reshape(len(points), paths)


def _nodes(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Values at nodes that span the panel, from estimates in the cells' middles.

    Of the polynomials up to the grid's own degree the one is taken whose generalised cross-validation is least: it
    predicts a left-out estimate best, so it follows what the noise lets one see and no more (Craven and Wahba 1979).
    """
    rows, columns = mean.shape
    x, y = ((np.arange(n) + 0.5) / n * 2 - 1 for n in (columns, rows))
    floor = 1e-12 * mean.mean() ** 2 + 1e-30
    weight = 1 / np.sqrt(np.maximum(variance, floor)).reshape(-1, 1)
    best, chosen = np.inf, (0, np.zeros(1))
    for degree in range(min(MOST_DEGREE, min(rows, columns) - 1) + 1):
        terms = (degree + 1) ** 2
        if 1.5 * terms > mean.size:
            break
        across, up = chebyshev.chebvander(x, degree), chebyshev.chebvander(y, degree)
        basis = np.einsum("yi,xj->yxij", up, across).reshape(-1, terms)
        weighted = basis * weight
        # Chebyshev products are nearly orthogonal on the grid, so the normal equations lose nothing.
        solution = np.linalg.solve(weighted.T @ weighted, weighted.T @ (mean.ravel() * weight[:, 0]))
        residual = (mean.ravel() - basis @ solution) * weight[:, 0]
        score = mean.size * (residual @ residual) / (mean.size - terms) ** 2
        if score < best:
            best, chosen = score, (degree, solution)
    degree, solution = chosen
    at = np.linspace(-1, 1, SMOOTH_NODES)
    return np.maximum(chebyshev.chebgrid2d(at, at, solution.reshape(degree + 1, degree + 1)), 0)


class IrradianceSum:
    """Look-up of several lights together."""

    def __init__(self, lights: list[Irradiance]):
        self.parts = [IrradianceLookup(light) for light in lights]

    def at(self, panel: Any, uv: Any) -> Any:
        """Irradiance at panel coordinates uv in [0, 1]^2."""
        first, *rest = [part.at(panel, uv) for part in self.parts]
        return sum(rest, first)


class IrradianceLookup:
    """Bilinear look-up on the device."""

    def __init__(self, light: Irradiance):
        mi = mitsuba()
        self.rows, self.columns = (mi.UInt32(light.shape[:, k].astype(np.uint32)) for k in (0, 1))
        self.start = mi.UInt32(np.concatenate([[0], np.cumsum(light.shape.prod(axis=1))[:-1]]).astype(np.uint32))
        self.values = mi.Float(light.values)
        self.direct = DirectLookup(light.direct)

    def at(self, panel: Any, uv: Any) -> Any:
        """Irradiance at panel coordinates uv in [0, 1]^2."""
        mi = mitsuba()
        import drjit as dr

        rows, columns = dr.gather(mi.UInt32, self.rows, panel), dr.gather(mi.UInt32, self.columns, panel)
        start = dr.gather(mi.UInt32, self.start, panel)
        column, fx = cell_of(uv.x * mi.Float(columns - 1), columns)
        row, fy = cell_of(uv.y * mi.Float(rows - 1), rows)
        first = start + row * columns + column
        a, b = (dr.gather(mi.Float, self.values, first + k) for k in (0, 1))
        c, d = (dr.gather(mi.Float, self.values, first + columns + k) for k in (0, 1))
        indirect = (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d)
        return indirect + self.direct.at(panel, uv)
