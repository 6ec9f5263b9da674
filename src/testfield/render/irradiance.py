"""The light on every panel, computed once a world and used by every view.

On a diffuse surface irradiance does not depend on the viewer and, away from shadow edges, is smooth. So it is
estimated with Mitsuba's path integrator at a grid of points on each panel: light that comes straight from an area
light by sampling the light, everything else by sampling the hemisphere. Where a low polynomial explains a panel's
values to within their noise, the polynomial takes their place and most of the noise is gone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from testfield.render.stage import Stage
from testfield.render.variant import mitsuba

PATHS_A_PASS = 1 << 21
SMOOTH_NODES = 33
MAX_DEPTH = 6


@dataclass(frozen=True)
class Irradiance:
    """Irradiance in W/m^2 at nodes that span each panel edge to edge.

    `shape` (panels, 2) rows and columns of nodes; `values` all grids one after the other, float32;
    `smooth` (panels,) whether a polynomial took the place of the estimates.
    """

    shape: np.ndarray
    values: np.ndarray
    smooth: np.ndarray

    def save(self, path: Path) -> None:
        """Write as NPZ."""
        with path.open("wb") as file:
            np.savez(file, shape=self.shape, values=self.values, smooth=self.smooth)

    @staticmethod
    def load(path: Path) -> "Irradiance":
        """Read what `save` wrote."""
        with np.load(path) as data:
            return Irradiance(data["shape"], data["values"], data["smooth"])

    def of_panel(self, panel: int) -> np.ndarray:
        """(rows, columns) irradiance of one panel, W/m^2; rows run upwards."""
        sizes = self.shape.prod(axis=1)
        start = sizes[:panel].sum()
        return self.values[start : start + sizes[panel]].reshape(self.shape[panel])


def grid_shape(size_mm: np.ndarray, spacing_mm: float) -> np.ndarray:
    """(panels, 2) rows and columns of the points at which light is estimated."""
    return np.clip(np.ceil(size_mm[:, ::-1] / spacing_mm).astype(int), 5, 64)


def compute_irradiance(
    stage: Stage, spacing_mm: float, paths: int, seed: int, progress: Callable[[float], None]
) -> Irradiance:
    """Estimate the light on every panel of a stage.

    `spacing_mm` between points, `paths` for each point, `seed` of the random numbers, `progress` is told the fraction
    done of the work since the last call.
    """
    world = stage.world
    shapes = grid_shape(world.panels.size_mm, spacing_mm)
    position, normal, tangent = [], [], []
    for k, (rows, columns) in enumerate(shapes):
        u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        rotation, origin = world.panels.world_from_panel.R[k], world.panels.world_from_panel.t_mm[k]
        local = np.column_stack([(u.ravel() - 0.5), (v.ravel() - 0.5)]) * world.panels.size_mm[k]
        position.append(local @ rotation[:, :2].T + origin + 0.02 * rotation[:, 2])
        normal.append(np.broadcast_to(rotation[:, 2], (u.size, 3)))
        tangent.append(np.broadcast_to(rotation[:, 0], (u.size, 3)))
    points, normals, tangents = (np.concatenate(part) for part in (position, normal, tangent))

    mean, variance = np.empty(len(points)), np.empty(len(points))
    batch = max(1, PATHS_A_PASS // paths)
    batches = -(-len(points) // batch)
    # Every batch has the same size, so that one kernel serves all; the last one wraps round.
    for k in range(batches):
        index = (np.arange(batch) + k * batch) % len(points)
        samples = _sample(stage, points[index], normals[index], tangents[index], paths, seed + k)
        fresh = min(batch, len(points) - k * batch)
        mean[index[:fresh]] = samples.mean(axis=1, dtype=np.float64)[:fresh]
        variance[index[:fresh]] = samples.var(axis=1, dtype=np.float64)[:fresh] / paths
        progress(1 / batches)

    grids, smooth, start = [], [], 0
    for rows, columns in shapes:
        part = slice(start, start + rows * columns)
        start += rows * columns
        nodes, fits = _nodes(mean[part].reshape(rows, columns), variance[part].reshape(rows, columns))
        grids.append(nodes)
        smooth.append(fits)
    return Irradiance(
        np.array([grid.shape for grid in grids]),
        np.concatenate([grid.ravel() for grid in grids]).astype(np.float32),
        np.array(smooth),
    )


def _sample(
    stage: Stage, points: np.ndarray, normals: np.ndarray, tangents: np.ndarray, paths: int, seed: int
) -> np.ndarray:
    """(points, paths) unbiased estimates of irradiance."""
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
    sampler.seed(seed, count)
    total = mi.Float(0)

    for light in stage.world.lights:
        rotation, origin = light.world_from_light.R[0], light.world_from_light.t_mm[0]
        across, up, facing = (mi.Vector3f(*rotation[:, k].tolist()) for k in range(3))
        sample = sampler.next_2d()
        target = (
            mi.Point3f(*origin.tolist())
            + across * ((sample.x - 0.5) * light.size_mm[0])
            + up * ((sample.y - 0.5) * light.size_mm[1])
        )
        towards = target - position
        distance2 = dr.squared_norm(towards)
        direction = towards * dr.rsqrt(distance2)
        cosines = dr.maximum(dr.dot(direction, normal), 0) * dr.maximum(-dr.dot(direction, facing), 0)
        ray = mi.Ray3f(position, direction, dr.sqrt(distance2) * (1 - 1e-4), 0.0, mi.Color0f())
        lit = (cosines > 0) & ~stage.scene.ray_test(ray)
        area = light.size_mm[0] * light.size_mm[1]
        total += dr.select(lit, light.radiance * area * cosines / distance2, 0)

    # Everything else: a cosine-distributed direction; light straight from an area light is counted already.
    local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    bitangent = dr.cross(normal, tangent)
    ray = mi.RayDifferential3f(mi.Ray3f(position, tangent * local.x + bitangent * local.y + normal * local.z))
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 1000})
    radiance, _, _ = integrator.sample(stage.scene, sampler, ray)
    hit = stage.scene.ray_intersect(ray)
    emitter = hit.emitter(stage.scene)
    direct = dr.select(hit.is_valid() & (emitter != None), emitter.eval(hit)[0], 0)  # noqa: E711 (a device pointer)
    total += dr.pi * (radiance[0] - direct)
    dr.eval(total)
    return np.asarray(total).reshape(len(points), paths)


def _nodes(mean: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, bool]:
    """Values at nodes that span the panel, from estimates in the cells' middles; and whether they are a polynomial.

    The lowest degree is taken whose chi-squared lies within three standard deviations of what the estimates' own noise
    makes; without one the estimates stay, carried out to the edges.
    """
    rows, columns = mean.shape
    x, y = ((np.arange(n) + 0.5) / n * 2 - 1 for n in (columns, rows))
    weight = 1 / np.sqrt(np.maximum(variance, 1e-12 * mean.mean() ** 2 + 1e-30))
    for degree in range(1, 9):
        terms = (degree + 1) ** 2
        if terms * 2 > mean.size or degree >= min(rows, columns):
            break
        basis = np.einsum("yi,xj->yxij", chebyshev.chebvander(y, degree), chebyshev.chebvander(x, degree)).reshape(
            -1, terms
        )
        solution, *_ = np.linalg.lstsq(basis * weight.reshape(-1, 1), (mean * weight).ravel(), rcond=None)
        residual = (mean.ravel() - basis @ solution) * weight.ravel()
        if residual @ residual < (1 + 3 * np.sqrt(2 / (mean.size - terms))) * (mean.size - terms):
            at = np.linspace(-1, 1, SMOOTH_NODES)
            return chebyshev.chebgrid2d(at, at, solution.reshape(degree + 1, degree + 1)), True
    from scipy.ndimage import map_coordinates

    at_row, at_column = (np.linspace(-0.5, n - 0.5, n + 1) for n in (rows, columns))
    grid = np.stack(np.meshgrid(at_row, at_column, indexing="ij"))
    return map_coordinates(mean, grid, order=1, mode="nearest"), False


class IrradianceLookup:
    """Bilinear look-up on the device."""

    def __init__(self, light: Irradiance):
        mi = mitsuba()
        self.rows, self.columns = (mi.UInt32(light.shape[:, k].astype(np.uint32)) for k in (0, 1))
        self.start = mi.UInt32(np.concatenate([[0], np.cumsum(light.shape.prod(axis=1))[:-1]]).astype(np.uint32))
        self.values = mi.Float(light.values)

    def at(self, panel: Any, uv: Any) -> Any:
        """Irradiance at panel coordinates uv in [0, 1]^2."""
        mi = mitsuba()
        import drjit as dr

        rows, columns = dr.gather(mi.UInt32, self.rows, panel), dr.gather(mi.UInt32, self.columns, panel)
        start = dr.gather(mi.UInt32, self.start, panel)
        x = dr.clip(uv.x, 0, 1) * mi.Float(columns - 1)
        y = dr.clip(uv.y, 0, 1) * mi.Float(rows - 1)
        column, row = dr.minimum(mi.UInt32(x), columns - 2), dr.minimum(mi.UInt32(y), rows - 2)
        fx, fy = x - mi.Float(column), y - mi.Float(row)
        first = start + row * columns + column
        a, b = (dr.gather(mi.Float, self.values, first + k) for k in (0, 1))
        c, d = (dr.gather(mi.Float, self.values, first + columns + k) for k in (0, 1))
        return (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d)
