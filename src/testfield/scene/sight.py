"""Rays and meshes: whether one stands in a line of sight, and how high a surface is above a plane."""

from functools import lru_cache
from typing import Any

import numpy as np

from testfield.scene.world import TrueMesh

SHORT_OF = 1e-5
"""Sight ends this part of its length before the point: rays are in single precision."""


def hidden_by_meshes(eye_mm: np.ndarray, points_mm: np.ndarray, meshes: tuple[TrueMesh, ...]) -> np.ndarray:
    """(n,) whether a mesh stands between the eye (3,) and each point (n, 3)."""
    if not meshes or len(points_mm) == 0:
        return np.zeros(len(points_mm), bool)
    origin = np.tile(eye_mm.astype(np.float32), (len(points_mm), 1))
    way = (points_mm - eye_mm).astype(np.float32)
    length = np.full(len(points_mm), 1 - SHORT_OF, np.float32)
    return _tree(meshes).run(origin, way, dists=length, query="OCCLUDED") == 0


def heights(mesh: TrueMesh, points_mm: np.ndarray, normals: np.ndarray, reach_mm: float) -> np.ndarray:
    """(n,) how far a mesh's surface lies above points (n, 3) along unit normals (n, 3); NaN beyond `reach_mm`."""
    if len(points_mm) == 0:
        return np.zeros(0)
    origin = (points_mm + reach_mm * normals).astype(np.float32)
    way = (-2 * reach_mm * normals).astype(np.float32)
    part = _tree((mesh,)).run(origin, way, dists=np.ones(len(origin), np.float32), query="DISTANCE").astype(float)
    return np.where(part < 1, reach_mm * (1 - 2 * part), np.nan)


@lru_cache(maxsize=4)
def _tree(meshes: tuple[TrueMesh, ...]) -> Any:
    """Embree's search tree over all faces."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    tree = EmbreeScene()
    for mesh in meshes:
        TriangleMesh(tree, mesh.vertices_mm.astype(np.float32), mesh.faces.astype(np.int32))
    return tree


def first_hits(origin_mm: np.ndarray, ways: np.ndarray, meshes: tuple[TrueMesh, ...]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) number of the face, counted through all meshes, that rays from places (n, 3) along ways (n, 3) meet first,
    -1 where they meet none; and (n,) how far along the way it is."""
    found = _tree(meshes).run(
        np.ascontiguousarray(origin_mm, np.float32), np.ascontiguousarray(ways, np.float32), query="INTERSECT", output=1
    )
    first = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
    mesh, face = np.asarray(found["geomID"], int), np.asarray(found["primID"], int)
    met = (mesh >= 0) & (mesh < len(meshes)) & (face >= 0)
    number = np.where(met, face + first[np.where(met, mesh, 0)], -1)
    return number, np.where(met, np.asarray(found["tfar"], float), np.inf)
