"""The fast renderer: exact edges under known light.

Each pixel is divided into n x n cells. One ray a cell finds the panel it falls on; the marks' coverage of the cell's
footprint is integrated in closed form, and the panel's irradiance, computed once a world, shades it. The optics'
blur and the pixel's area are one weighting of the cells. There is no Monte Carlo noise.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import erf

from testfield.camera.images import Radiance
from testfield.render.camera_plugin import CameraRays, opaque_float
from testfield.render.irradiance import Irradiance, IrradianceSum
from testfield.render.points import Sources, flash_sources, room_sources
from testfield.render.shade import shade
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba

CELLS_A_PASS = 6_000_000
PARTS = 2
"""A cell's footprint is divided into this many parts each way where it meets a mark."""


def render_fast(
    stage: Stage,
    light: Irradiance,
    station: int,
    cells: int,
    progress: Callable[[float], None] = lambda _: None,
    bounce: Irradiance | None = None,
) -> Radiance:
    """Radiance image of one station, noise-free.

    `cells` along each side of a pixel, more where a narrow point spread needs it; `progress` is told the
    fraction done since the last call. `bounce` is the flash's indirect light (`bounce.py`). What a coat reflects of
    lamps and surroundings is not part of it: `view.py` adds that.
    """
    world = stage.world
    width, height = world.interior.width_px, world.interior.height_px
    if world.psf_sigma_px > 0:
        cells = max(cells, int(np.ceil(1 / world.psf_sigma_px)))
    weights, margin = pixel_weights(cells, world.psf_sigma_px)
    lookup = IrradianceSum([light] if bounce is None else [light, bounce])
    rays = CameraRays(world.interior, world.camera_from_world, station)
    sources = [s for s in (room_sources(world), flash_sources(world, station)) if s is not None]
    columns = (width + 2 * margin) * cells
    strip = max(1, CELLS_A_PASS // (columns * cells) - 2 * margin)
    strips = -(-height // strip)
    strip = -(-height // strips)
    values = np.empty((height, width), np.float32)
    for top in range(0, height, strip):
        rows = (strip + 2 * margin) * cells
        fine = _shade(stage, lookup, sources, rays, rows, columns, cells, top - margin, -margin)
        image = _weigh(fine, weights, cells, strip, width)
        values[top : top + strip] = image[: height - top]
        progress(1 / strips)
    return Radiance(world.station_name[station], values)


def _shade(
    stage: Stage,
    lookup: IrradianceSum,
    sources: list[Sources],
    rays: CameraRays,
    rows: int,
    columns: int,
    cells: int,
    top: int,
    left: int,
) -> np.ndarray:
    """(rows, columns) mean radiance of each cell; the first cell is the corner of pixel (left, top)."""
    mi = mitsuba()
    import drjit as dr

    index = dr.arange(mi.UInt32, rows * columns)
    row, column = index // columns, index % columns
    x_px = (mi.Float(column) + 0.5) / cells - 0.5 + opaque_float(left)
    y_px = (mi.Float(row) + 0.5) / cells - 0.5 + opaque_float(top)
    direction, by_x, by_y = rays.direction(x_px, y_px)
    length = dr.norm(direction)
    ray = mi.Ray3f(rays.origin, direction / length)
    hit = stage.scene.ray_intersect(
        ray, ray_flags=mi.RayFlags.Minimal | mi.RayFlags.UV | mi.RayFlags.dPdUV, coherent=True
    )

    # Where the cell's edges meet the panel's plane: the change of the hit point by one cell in x and in y.
    depth = hit.t / length
    slope = dr.dot(direction, hit.n)

    def footprint(by: Any) -> Any:
        shift = (by - direction * (dr.dot(by, hit.n) / slope)) * (depth / cells)
        return mi.Vector2f(
            dr.dot(shift, hit.dp_du) / dr.squared_norm(hit.dp_du),
            dr.dot(shift, hit.dp_dv) / dr.squared_norm(hit.dp_dv),
        )

    hit.duv_dx, hit.duv_dy = footprint(by_x), footprint(by_y)
    shines = stage.is_lamp(hit)
    faces = hit.is_valid() & (slope < 0) & ~shines
    shaded = shade(stage, lookup, sources, hit, -direction / length, faces, PARTS)
    emitted = dr.select(shines, hit.emitter(stage.scene).eval(hit, shines)[0], 0)
    radiance = dr.select(faces, shaded, emitted)
    dr.eval(radiance)
    return np.asarray(radiance).reshape(rows, columns)


def pixel_weights(cells: int, psf_sigma_px: float) -> tuple[np.ndarray, int]:
    """Weights of a row of cells in one pixel, and how many pixels they reach beyond it on either side.

    The pixel's box convolved with the optics' Gaussian, integrated over each cell. Averaging over a cell and
    integrating the weight over it each widen the whole by a box of variance (1 / cells)^2 / 12, which is taken off the
    Gaussian's. The cells must not be wider than the Gaussian's sigma.
    """
    if psf_sigma_px == 0:
        return np.full(cells, 1 / cells), 0
    sigma = np.sqrt(psf_sigma_px**2 - 1 / (6 * cells**2))
    margin = int(np.ceil(4.5 * psf_sigma_px))
    edges = np.arange(cells * (2 * margin + 1) + 1) / cells - margin - 0.5

    def twice_integrated(x: np.ndarray) -> np.ndarray:  # of the Gaussian
        return x * (1 + erf(x / (sigma * np.sqrt(2)))) / 2 + sigma * np.exp(-((x / sigma) ** 2) / 2) / np.sqrt(
            2 * np.pi
        )

    weights = np.diff(twice_integrated(edges + 0.5) - twice_integrated(edges - 0.5))
    return weights / weights.sum(), margin


def _weigh(fine: np.ndarray, weights: np.ndarray, cells: int, rows: int, columns: int) -> np.ndarray:
    """(rows, columns) pixels from cells: the same weights along rows and along columns."""
    across = np.zeros((fine.shape[0], columns), np.float32)
    for k, weight in enumerate(weights.astype(np.float32)):
        across += weight * fine[:, k : k + columns * cells : cells]
    image = np.zeros((rows, columns), np.float32)
    for k, weight in enumerate(weights.astype(np.float32)):
        image += weight * across[k : k + rows * cells : cells]
    return image
