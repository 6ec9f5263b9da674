"""The light on every panel, computed once a world and used by every view.

On a matt surface irradiance does not depend on the viewer. What comes straight from the lamps is computed without noise
(`direct.py`). Everything else, light that was reflected before and light from all around, is smooth; it is estimated
at a grid of points on each panel (`gather.py`), one bounce after another, and replaced by the polynomial that
predicts it best and by as much of what that leaves as is no noise.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from testfield.render.direct import LATTICE, LEVELS, DirectLight, DirectLookup, compute_direct
from testfield.render.gather import MAX_DEPTH, Places, Radiances, gather, matt_radiances, path_radiances
from testfield.render.lookup import cell_of
from testfield.render.mesh_light import LitMeshes, MeshLight, MeshLookup
from testfield.render.points import room_sources
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba
from testfield.scene.world import TrueMesh, World
from testfield.store.sheets import FORMAT

MESH_SEEDS = 1 << 20
"""Batches on meshes take seeds from here on, so that none is used twice."""
SMOOTH_NODES = 65
MOST_DEGREE = 3
"""Polynomials carry the slopes at a panel's border, which waves cannot; what is finer, waves follow with less noise."""
STIFFNESS = np.append(np.geomspace(1e-2, 1e8, 41), 1e30)
"""Weights of waves' bending that are tried, the last of which lets none pass."""
STILL_FREE = 1 / 4
"""Part of the estimates that must remain to judge a fit by."""
MOST_POINTS, MOST_POINTS_PLAIN = 64, 40
"""Along each side of a panel with marks, and of a plain one, which needs no more for a polynomial of that degree."""
EARLIER = 1 / 8
"""Rays for every bounce but the last, as a part of those for the last."""
LEAST_RAYS = 64
"""However small a part of them is asked for."""
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


def grid_shape(size_mm: np.ndarray, spacing_mm: float, marked: np.ndarray) -> np.ndarray:
    """(panels, 2) rows and columns of the points at which light is estimated; fewer on panels without marks."""
    most = np.where(marked, MOST_POINTS, MOST_POINTS_PLAIN)
    return np.clip(np.ceil(size_mm[:, ::-1] / spacing_mm).astype(int), 5, most[:, None])


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
    shapes = grid_shape(world.panels.size_mm, spacing_mm, np.isin(np.arange(len(world.panels)), world.marks.panel))
    places = _on_panels(world, shapes)
    direct, bodies = compute_direct(world, stage.scene, levels, rays), LitMeshes(world, stage.scene, spacing_mm)
    on_bodies = Places(*bodies.indirect.places)
    paths, fewer = _whole(paths), _whole(paths * MESH_PATHS)

    def bounced(radiance: Radiances, share: float, tell: Callable[[float], None]) -> Irradiance:
        """The light whose indirect part is what arrives along a `share` of the rays."""
        here = gather(radiance, places, _whole(paths * share), seed, tell)
        there = gather(radiance, on_bodies, _whole(fewer * share), seed + MESH_SEEDS)
        grids, start = [], 0
        for rows, columns in shapes:
            grids.append(_nodes(here[start : start + rows * columns].reshape(rows, columns)))
            start += rows * columns
        values = np.concatenate([grid.ravel() for grid in grids]).astype(np.float32)
        return Irradiance(np.array([grid.shape for grid in grids]), values, direct, bodies.with_indirect(there))

    if stage.materials.retro or stage.materials.gloss or stage.flash_at is not None:
        return bounced(path_radiances(stage), 1.0, progress)
    sources = [source for source in [room_sources(world)] if source is not None]
    dark = bodies.with_indirect(np.zeros(len(on_bodies)))
    light = replace(Irradiance.even(len(shapes), 0.0), direct=direct, meshes=dark)
    # Each round adds a bounce. The last one sees those before it by way of the surfaces' albedo, and as a mean over all
    # that is in view: a part of the rays is enough for them.
    shares = np.array([EARLIER] * (MAX_DEPTH - 2) + [1.0])
    for share in shares.tolist():
        meshes = MeshLookup(world, light.meshes, stage.mesh_numbers) if world.meshes else None
        radiance = matt_radiances(stage, IrradianceLookup(light), meshes, sources)
        light = bounced(radiance, share, partial(_part_of, progress, share / shares.sum()))
    return light


def _part_of(progress: Callable[[float], None], share: float, done: float) -> None:
    progress(share * done)


def _whole(rays: float) -> int:
    """A number of rays."""
    return max(LEAST_RAYS, round(rays))


def _on_panels(world: World, shapes: np.ndarray) -> Places:
    """The middles of (rows, columns) cells on every panel, just above it."""
    position, normal, tangent = [], [], []
    for k, (rows, columns) in enumerate(shapes):
        u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        local = np.column_stack([(u.ravel() - 0.5), (v.ravel() - 0.5)]) * world.panels.size_mm[k]
        place, frame = world.panels.place(np.full(u.size, k), local)
        position.append(place + 0.02 * frame[:, :, 2])
        normal.append(frame[:, :, 2])
        tangent.append(frame[:, :, 0])
    return Places(*(np.concatenate(part) for part in (position, normal, tangent)))


def _nodes(estimates: np.ndarray) -> np.ndarray:
    """Values at nodes that span the panel, from estimates (rows, columns) in the cells' middles.

    Of the polynomials up to the grid's own degree the one is taken whose generalised cross-validation is least: it
    predicts a left-out estimate best, so it follows what the noise lets one see and no more (Craven and Wahba 1979).
    """
    (up, up_nodes), (across, across_nodes) = (_polynomials(n) for n in estimates.shape)
    terms = up.T @ estimates @ across
    # On polynomials that are orthonormal on the grid, a fit of lower degree has the same coefficients, fewer of them.
    left = (estimates**2).sum() - np.array([(terms[: d + 1, : d + 1] ** 2).sum() for d in range(len(terms))])
    count = (np.arange(len(terms)) + 1) ** 2
    told = 1.5 * count <= estimates.size
    degree = int(np.argmin(left[told] / (estimates.size - count[told]) ** 2)) + 1
    up, up_nodes, across, across_nodes = (side[:, :degree] for side in (up, up_nodes, across, across_nodes))
    kept = terms[:degree, :degree]
    rest = estimates - up @ kept @ across.T
    return np.maximum(up_nodes @ kept @ across_nodes.T + _waves(rest, degree**2), 0)


def _waves(rest: np.ndarray, told: int) -> np.ndarray:
    """What a fit of `told` terms leaves (rows, columns), without its noise, at the nodes: such light as falls past the
    edge of something near.

    A smoothing spline on an even grid, whose cosines pass the less the more they bend; how much less, generalised
    cross-validation says again (Garcia 2010).
    """
    (up, up_nodes), (across, across_nodes) = (_cosines(n) for n in rest.shape)
    terms = up.T @ rest @ across
    bending = np.add.outer(*((np.arange(n) / n) ** 2 for n in rest.shape)) ** 2
    passed = 1 / (1 + STIFFNESS[:, None, None] * bending)
    free = rest.size - told - passed.sum(axis=(1, 2))
    left = (((1 - passed) * terms) ** 2).sum(axis=(1, 2))
    tried = np.append(free[:-1] > STILL_FREE * rest.size, True)
    best = np.flatnonzero(tried)[np.argmin(left[tried] / free[tried] ** 2)]
    return np.asarray(up_nodes @ (passed[best] * terms) @ across_nodes.T)


@cache
def _cosines(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosines that are orthonormal on the middles of `count` cells: their values there and at the nodes."""
    height = np.sqrt(np.where(np.arange(count) > 0, 2, 1) / count)
    middles = (np.arange(count) + 0.5) / count
    at_middles, at_nodes = (
        np.cos(np.pi * np.outer(at, np.arange(count))) * height for at in (middles, np.linspace(0, 1, SMOOTH_NODES))
    )
    return at_middles, at_nodes


@cache
def _polynomials(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Polynomials that are orthonormal on the middles of `count` cells: their values there and at the nodes."""
    # Beyond this degree a fit to even points swings between the last of them and the border (Rakhmanov 2007).
    degree = min(MOST_DEGREE, int(2 * np.sqrt(count)) - 1)
    middles = (np.arange(count) + 0.5) / count * 2 - 1
    orthonormal, triangle = np.linalg.qr(chebyshev.chebvander(middles, degree))
    at_nodes = chebyshev.chebvander(np.linspace(-1, 1, SMOOTH_NODES), degree)
    return orthonormal, np.linalg.solve(triangle.T, at_nodes.T).T


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
