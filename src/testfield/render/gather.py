"""Indirect light at points: the mean radiance of what a lattice of rays around each of them meets.

In a matt world that is known from the light on the surfaces that are met, one bounce poorer, so one ray stands for all
paths that begin with it. Where coats or retro-reflecting ink throw light, paths are traced to their ends.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from testfield.render.device_maths import columns, opaque, opaque_float, vector_of
from testfield.render.fetch import fetch
from testfield.render.mesh_light import MeshLookup
from testfield.render.points import Sources, light_from
from testfield.render.stage import Stage
from testfield.render.variant import mitsuba
from testfield.scene.world import LUMINOUS

RAYS_A_PASS = 1 << 21
MAX_DEPTH = 6
"""Pieces of a path from a point on: one more than the bounces."""
GOLDEN = 2654435769
"""The golden ratio's fraction of 2^32: in whole numbers a multiple of it loses no digits."""

Radiances = Callable[[Any, int, int], Any]
"""Rays, how many they are and a seed to the radiance that arrives along them, what lamps send directly left out."""


class Places:
    """Points (n, 3) in mm with their unit `normals` and `tangents`."""

    def __init__(self, points: np.ndarray, normals: np.ndarray, tangents: np.ndarray):
        self.points, self.normals, self.tangents = points, normals, tangents

    def __len__(self) -> int:
        return len(self.points)


def gather(
    radiance: Radiances, places: Places, rays: int, seed: int, progress: Callable[[float], None] = lambda _: None
) -> np.ndarray:
    """(n,) irradiance in W/m^2 at places from `rays` each.

    Their directions are cosine-distributed on a golden-ratio lattice, the same at all points: what is left of its error
    changes little from point to point, and only a gradient moves a centre.
    """
    mi = mitsuba()
    import drjit as dr

    found = np.empty(len(places))
    batch = max(1, RAYS_A_PASS // rays)
    batches = -(-len(places) // batch)
    shift = [opaque_float(v) for v in np.random.default_rng(seed).random(2)]
    # Every batch has the same size, so that one kernel serves all; the last one wraps round.
    for k in range(batches):
        index = (np.arange(batch) + k * batch) % len(places)
        ray = dr.arange(mi.UInt32, batch * rays)
        # Rays of the same direction from neighbouring points lie side by side: they take much the same way.
        path, point = ray // opaque(batch), ray % opaque(batch)

        position, normal, tangent = (
            vector_of(columns(values[index]), point) for values in (places.points, places.normals, places.tangents)
        )
        even = (mi.Float(path) + 0.5) / opaque_float(rays)
        square = mi.Point2f(even + shift[0], mi.Float(path * GOLDEN) * 2**-32 + shift[1])
        local = mi.warp.square_to_cosine_hemisphere(square - dr.floor(square))
        bitangent = dr.cross(normal, tangent)
        direction = tangent * local.x + bitangent * local.y + normal * local.z
        arriving = radiance(mi.Ray3f(mi.Point3f(position), direction), batch * rays, seed + k)
        sums = fetch(arriving).reshape(rays, batch).sum(axis=0, dtype=np.float64)
        fresh = min(batch, len(places) - k * batch)
        found[index[:fresh]] = np.pi / rays * sums[:fresh]
        progress(1 / batches)
    return found


def path_radiances(stage: Stage) -> Radiances:
    """Radiance by Mitsuba's path integrator: unbiased, and with noise."""
    mi = mitsuba()
    import drjit as dr

    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 1000})

    def along(ray: Any, count: int, seed: int) -> Any:
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count)
        ray = mi.RayDifferential3f(ray)
        radiance, _, _ = integrator.sample(stage.scene, sampler, ray)
        hit = stage.scene.ray_intersect(ray)
        direct = dr.select(hit.is_valid() & stage.is_lamp(hit), hit.emitter(stage.scene).eval(hit)[0], 0)
        return radiance[0] - direct

    return along


def matt_radiances(stage: Stage, lookup: Any, meshes: MeshLookup | None, sources: list[Sources]) -> Radiances:
    """Radiance of matt surfaces, whose irradiance `lookup` and `meshes` know but for that of `sources` without size, of
    luminous ink, and from all around."""
    mi = mitsuba()
    import drjit as dr

    materials = stage.materials

    def along(ray: Any, count: int, seed: int) -> Any:
        flags = mi.RayFlags.Minimal | mi.RayFlags.UV | mi.RayFlags.dPdUV
        hit = stage.scene.ray_intersect(ray, ray_flags=flags, coherent=True)
        front = dr.dot(ray.d, hit.n) < 0
        emitter = hit.emitter(stage.scene)
        around = ~hit.is_valid() & (emitter != None)  # noqa: E711 (a device pointer)
        panel, seen = stage.texture.panel(hit), stage.is_panel(hit) & front
        albedo = dr.select(seen, stage.texture.reflectance(hit, 1), 0)
        radiance = albedo * dr.select(seen, lookup.at(panel, hit.uv), 0) / dr.pi
        if materials.luminous_radiance:
            ink = stage.texture.coverage(hit, (0.0, 0.0), 1)
            radiance += dr.select(seen & materials.carries(panel, LUMINOUS), ink * materials.luminous_radiance, 0)
        if meshes is not None:
            on_mesh, shaded, own = meshes.radiance(hit, front)
            radiance, albedo = dr.select(on_mesh, shaded, radiance), dr.select(on_mesh, own, albedo)
        for source in sources:
            frame, up = mi.Frame3f(dr.select(front, hit.n, -hit.n)), mi.Vector3f(0, 0, 1)
            matt, _, _ = light_from(source, stage.scene, materials, hit.p, frame, up, albedo > 0)
            radiance += albedo * matt / dr.pi
        return radiance + dr.select(around, emitter.eval(hit, around)[0], 0)

    return along
