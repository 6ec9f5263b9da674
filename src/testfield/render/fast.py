"""The fast renderer: exact edges under known light.

A pixel that an edge may cross (`edges.py`) is divided into n x n cells, another sees one ray or lies between some
(`lattice.py`). A ray finds the panel it falls on; the marks' coverage of a cell's footprint is integrated in closed
form, and the panel's irradiance, computed once a world, shades it. The optics' blur and the pixel's area are one
weighting of the cells (`psf.py`); defocus and motion are means over a few sharp pictures (`shots.py`). There is no
Monte Carlo noise.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.camera_plugin import CameraRays
from testfield.render.device_maths import DeviceTwist, Rays, opaque_float
from testfield.render.direct import DirectLight
from testfield.render.edges import BORDER, EDGE, edge_pixels
from testfield.render.fetch import fetch
from testfield.render.irradiance import Irradiance, IrradianceSum
from testfield.render.lattice import smooth_pixels
from testfield.render.mesh_light import MeshLookup
from testfield.render.points import flash_sources, light_from, room_sources
from testfield.render.psf import MOSTLY, PointSpread, point_spread
from testfield.render.shade import shade
from testfield.render.shots import shots
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba
from testfield.render.vignetting import Vignetting, vignettes
from testfield.scene.world import World

CELLS_A_PASS = 18_000_000
FINER = 2
"""Cells at a border are divided into this many parts each way, with a ray each: what a ray meets has no coverage."""
PARTS = 2
"""A cell is divided into this many parts each way where it meets a mark, each with a footprint of its own."""


def render_fast(
    stage: Stage,
    light: Irradiance,
    station: int,
    cells: int,
    progress: Callable[[float], None] = lambda _: None,
    blur_shots: int = 64,
    bounce: Irradiance | None = None,
) -> Radiance:
    """Radiance image of one station, noise-free.

    `cells` along each side of a pixel, more where a narrow point spread needs it; `progress` is told the fraction done
    since the last call; `blur_shots` the most sharp pictures whose mean a defocused or moved one is; `bounce` is the
    flash's indirect light (`bounce.py`). What a coat reflects of lamps and surroundings is not part of it: `view.py`
    adds that.
    """
    world = stage.world
    values = np.empty((world.interior.height_px, world.interior.width_px), np.float32)
    for strip in traced(stage, light, station, outlined(world, light.direct, station, cells, blur_shots), bounce):
        strip.blur_into(values)
        progress(len(strip) / len(values))
    return Radiance(world.station_name[station], values)


@dataclass(frozen=True)
class Outlined:
    """What is known of a view before any ray: the `exposure`'s shots (k, 3), the point `spread`, and the `edges` in the
    image and in a margin around it (`edges.py`)."""

    exposure: np.ndarray
    spread: PointSpread
    edges: np.ndarray


@dataclass(frozen=True)
class Strip:
    """Rows of an image from `top` to before `bottom`, as rays met them: `smooth` pixels with a margin around, of which
    those at `row`, `column` (k,) have `fine` cells (k, cells^2) of their own. The `spread` makes pixels of them."""

    top: int
    bottom: int
    spread: PointSpread
    smooth: np.ndarray
    row: np.ndarray
    column: np.ndarray
    fine: np.ndarray

    def __len__(self) -> int:
        return self.bottom - self.top

    def blur_into(self, values: np.ndarray) -> None:
        """Write the strip's pixels into the image's."""
        values[self.top : self.bottom] = self.spread.blurred(self.smooth, self.row, self.column, self.fine)


def outlined(world: World, direct: DirectLight, station: int, cells: int, blur_shots: int) -> Outlined:
    """What is known of a station's view before any ray; `cells` and `blur_shots` as in `render_fast`."""
    exposure = shots(world, station, blur_shots)
    spread = point_spread(cells, world.psf_sigma_px, world.optics.airy_px, len(exposure))
    return Outlined(exposure, spread, edge_pixels(world, direct, station, exposure, spread.margin))


def traced(
    stage: Stage, light: Irradiance, station: int, outline: Outlined, bounce: Irradiance | None = None
) -> Iterator[Strip]:
    """A station's image as rays meet it, from top to bottom."""
    exposure, spread, edges = outline.exposure, outline.spread, outline.edges
    cells, margin = spread.cells, spread.margin
    view = _View(stage, light, station, bounce)
    for top, bottom in _strips(edges > 0, cells, margin):
        part = edges[top : bottom + 2 * margin]
        smooth = smooth_pixels(partial(view.middles, top - margin, -margin), part > 0)
        row, column = np.nonzero(part)
        fine = np.empty((len(row), cells**2), np.float32)
        for kind, finer in ((EDGE, 1), (BORDER, max(1, round(FINER / np.sqrt(len(exposure)))))):
            own = part[row, column] == kind
            fine[own] = view.cells(exposure, row[own] + (top - margin), column[own] - margin, cells, finer)
        yield Strip(top, bottom, spread, smooth, row, column, fine)


def _strips(crossed: np.ndarray, cells: int, margin: int) -> list[tuple[int, int]]:
    """First row of the image, and the one after the last, of each pass. A pass costs time of its own, so each takes all
    the cells there is room for."""
    rows, width = crossed.shape
    so_far = np.append(0, np.cumsum(np.count_nonzero(crossed, axis=1)))
    found, top, height = [], 0, rows - 2 * margin
    while top < height:
        bottoms = np.arange(top + 1, height + 1)
        size = (bottoms - top + 2 * margin) * width
        own = so_far[bottoms + 2 * margin] - so_far[top]
        # Where most pixels are crossed, all are divided (`PointSpread.blurred`).
        count = np.where(own > MOSTLY * size, size * cells**2, size + own * cells**2)
        room = np.append(count > CELLS_A_PASS, True).argmax()
        # A wide point spread needs a margin above and below: no strip is so low that margins are most of it.
        bottom = min(top + max(int(room), 2 * margin, 1), height)
        found.append((top, bottom))
        top = bottom
    return found


class _View:
    """One station's view of a stage under its light."""

    def __init__(self, stage: Stage, light: Irradiance, station: int, bounce: Irradiance | None):
        self.stage = stage
        self.lookup = IrradianceSum([light] if bounce is None else [light, bounce])
        self.sources = [s for s in (room_sources(stage.world), flash_sources(stage.world, station)) if s is not None]
        self.bodies = MeshLookup(stage.world, light.meshes, stage.mesh_numbers) if stage.world.meshes else None
        self.rays = CameraRays(stage.world, station)
        self.vignetting = Vignetting(stage.world) if vignettes(stage.world) else None
        self.target = DeviceTwist(stage.world.motion.target) if stage.world.motion.target.moves else None

    def middles(self, top: int, left: int, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """(k,) radiance in the middles of pixels at `row`, `column` (k,) from (left, top) on, in the middle of the
        exposure."""
        if not len(row):
            return np.zeros(0, np.float32)
        mi = mitsuba()
        y_px, x_px = (mi.Float((at + start).astype(np.float32)) for at, start in ((row, top), (column, left)))
        return fetch(self._radiance(x_px, y_px, np.zeros(3), 1, 1))

    def cells(self, exposure: np.ndarray, row: np.ndarray, column: np.ndarray, cells: int, finer: int) -> np.ndarray:
        """(k, cells^2) mean radiance over all shots of each cell, row by row, of pixels at `row`, `column` (k,); a cell
        is divided into `finer` parts each way, with a ray each."""
        mi = mitsuba()
        import drjit as dr

        count, square, parts = len(row), cells * cells, finer * finer
        if not count:
            return np.zeros((0, square), np.float32)
        top, left = mi.Float(row.astype(np.float32)), mi.Float(column.astype(np.float32))
        total = mi.Float(0)
        for shot in exposure:
            # A cell's parts lie one after the other, so that the device sums them.
            index = dr.arange(mi.UInt32, count * square * parts)
            part, cell, pixel = index % parts, index // parts % square, index // (square * parts)
            across, down = cell % cells * finer + part % finer, cell // cells * finer + part // finer
            x_px = dr.gather(mi.Float, left, pixel) + ((mi.Float(across) + 0.5) / (cells * finer) - 0.5)
            y_px = dr.gather(mi.Float, top, pixel) + ((mi.Float(down) + 0.5) / (cells * finer) - 0.5)
            radiance = self._radiance(x_px, y_px, shot, cells * finer, max(1, PARTS // finer))
            radiance = dr.block_sum(radiance, parts) if parts > 1 else radiance
            total = total + radiance if len(exposure) > 1 else radiance
            dr.eval(total)
        return fetch(total).reshape(count, square) / np.float32(len(exposure) * parts)

    def _radiance(self, x_px: Any, y_px: Any, shot: np.ndarray, cells: int, parts: int) -> Any:
        """Mean radiance of cells about places of the image, at one shot."""
        rays = self.rays.at(x_px, y_px, *[opaque_float(v) for v in shot])
        radiance = self._along(rays, cells, parts)
        return radiance if self.vignetting is None else radiance * self.vignetting.at(x_px, y_px, rays)

    def _along(self, rays: Rays, cells: int, parts: int) -> Any:
        """Mean radiance of the cells whose middles the rays pass through."""
        import drjit as dr

        stage = self.stage
        hit, rays = self._hit(rays)

        # Where the cell's edges meet the panel's plane: the change of the hit point by one cell in x and in y.
        depth = hit.t / dr.norm(rays.direction)
        slope = dr.dot(rays.direction, hit.n)

        def footprint(by: Any) -> Any:
            shift = (by - rays.direction * (dr.dot(by, hit.n) / slope)) * (depth / cells)
            return mitsuba().Vector2f(
                dr.dot(shift, hit.dp_du) / dr.squared_norm(hit.dp_du),
                dr.dot(shift, hit.dp_dv) / dr.squared_norm(hit.dp_dv),
            )

        hit.duv_dx, hit.duv_dy = footprint(rays.by_x), footprint(rays.by_y)
        shines = stage.is_lamp(hit)
        faces = hit.is_valid() & (slope < 0) & ~shines
        towards = -dr.normalize(rays.direction)
        shaded = shade(stage, self.lookup, self.sources, hit, towards, faces, parts)
        emitted = dr.select(shines, hit.emitter(stage.scene).eval(hit, shines)[0], 0)
        radiance = dr.select(faces, shaded, emitted)
        return radiance if self.bodies is None else self._with_bodies(self.bodies, hit, slope < 0, radiance)

    def _with_bodies(self, bodies: MeshLookup, hit: Any, front: Any, radiance: Any) -> Any:
        """The radiance of hits, with that of meshes where they are on one."""
        mi = mitsuba()
        import drjit as dr

        on_mesh, shaded, albedo = bodies.radiance(hit, front)
        frame = mi.Frame3f(dr.select(front, hit.n, -hit.n))
        for source in self.sources:
            up = mi.Vector3f(0, 0, 1)
            matt, _, _ = light_from(source, self.stage.scene, self.stage.materials, hit.p, frame, up, on_mesh)
            shaded += albedo * matt / dr.pi
        return dr.select(on_mesh, shaded, radiance)

    def _hit(self, rays: Rays) -> tuple[Any, Rays]:
        """What the rays meet first, and the rays in the frame in which that rests."""
        import drjit as dr

        if self.target is None:
            return _first(self.stage, self.stage.scene, rays), rays
        # Light takes no time: to meet what has moved is to meet it at rest with a ray that moved the other way.
        turned = [self.target.turn_back(v, rays.time) for v in (rays.direction, rays.by_x, rays.by_y)]
        moved = Rays(self.target.rest(rays.origin, rays.time), turned[0], turned[1], turned[2], rays.time, rays.cosine)
        # On a GPU a kernel traces in one scene alone, so what is met in each is computed before the next is asked.
        still = _first(self.stage, self.stage.still, rays)
        dr.eval(still)
        moving = _first(self.stage, self.stage.moving, moved)
        dr.eval(moving)
        nearer = moving.t < still.t
        chosen = [
            dr.select(nearer, a, b)
            for a, b in (
                (moved.origin, rays.origin),
                (moved.direction, rays.direction),
                (moved.by_x, rays.by_x),
                (moved.by_y, rays.by_y),
            )
        ]
        return dr.select(nearer, moving, still), Rays(
            chosen[0], chosen[1], chosen[2], chosen[3], rays.time, rays.cosine
        )


def _first(stage: Stage, scene: Any, rays: Rays) -> Any:
    mi = mitsuba()
    import drjit as dr

    ray = mi.Ray3f(rays.origin, rays.direction / dr.norm(rays.direction))
    flags = mi.RayFlags.Minimal | mi.RayFlags.UV | mi.RayFlags.dPdUV
    hit = scene.ray_intersect(ray, ray_flags=flags, coherent=True)
    if stage.texture.bent:
        hit = stage.texture.bent.refine(hit, ray, stage.texture.panel(hit), stage.is_panel(hit))
    return hit
