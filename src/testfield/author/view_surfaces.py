"""The surfaces of a world as the 3-D page draws them: panels, lamps, and meshes of a size that a browser holds."""

from dataclasses import dataclass

import numpy as np

from testfield.scene.world import TrueMesh, World

BENT = 13
"""Points along each side of a bent panel."""
MOST_FACES = 60_000
"""Of all meshes together: a browser without a graphics card draws no more at 30 frames a second."""


@dataclass(frozen=True)
class Surfaces:
    """Panels by number: `flat` (p,) at `flat_mm` (p, 4, 3), corners left bottom, right bottom, left top, right top;
    `bent` (q,) at `bent_mm` (q, BENT, BENT, 3), rows upwards; their `size_mm` (n, 2), `ground` and `ink` (n,) diffuse
    reflectance, `of_room` (n,). `lamps_mm` (k, 4, 3) as flat panels. `meshes` as drawn."""

    flat: np.ndarray
    flat_mm: np.ndarray
    bent: np.ndarray
    bent_mm: np.ndarray
    size_mm: np.ndarray
    ground: np.ndarray
    ink: np.ndarray
    of_room: np.ndarray
    lamps_mm: np.ndarray
    meshes: tuple[TrueMesh, ...]


def surfaces_of(world: World) -> tuple[Surfaces, list[str]]:
    """The surfaces of a world, and notes on what was made coarser."""
    panels = world.panels
    flat, bent = np.flatnonzero(~panels.bent), np.flatnonzero(panels.bent)
    lamps = [
        _lattice(2) * lamp.size_mm @ lamp.world_from_light.R[0, :, :2].T + lamp.world_from_light.t_mm[0]
        for lamp in world.lights
    ]
    meshes, notes = _coarser(world.meshes)
    return Surfaces(
        flat=flat,
        flat_mm=_places(world, flat, 2).reshape(-1, 4, 3),
        bent=bent,
        bent_mm=_places(world, bent, BENT).reshape(-1, BENT, BENT, 3),
        size_mm=panels.size_mm,
        ground=panels.ground_albedo,
        ink=panels.ink_albedo,
        of_room=panels.of_room,
        lamps_mm=np.array(lamps).reshape(-1, 4, 3),
        meshes=meshes,
    ), notes


def _lattice(n: int) -> np.ndarray:
    """(n^2, 2) places from -1/2 to 1/2, rows of x upwards."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
    return np.column_stack([u.ravel(), v.ravel()])


def _places(world: World, some: np.ndarray, n: int) -> np.ndarray:
    xy = _lattice(n) * world.panels.size_mm[some, None]
    return world.panels.place(np.repeat(some, n * n), xy.reshape(-1, 2))[0]


def _coarser(meshes: tuple[TrueMesh, ...]) -> tuple[tuple[TrueMesh, ...], list[str]]:
    """Meshes of `MOST_FACES` together at most: corners within a cell become one, their mean, and faces that vanish are
    left out (vertex clustering, Rossignac and Borrel 1993)."""
    whole = sum(len(mesh.faces) for mesh in meshes)
    if whole <= MOST_FACES:
        return meshes, []
    found = []
    for mesh in meshes:
        share = MOST_FACES * len(mesh.faces) / whole
        area = 0.5 * np.linalg.norm(np.cross(*np.diff(mesh.corners_mm, axis=1).transpose(1, 0, 2)), axis=1).sum()
        cell = np.sqrt(2 * area / share)
        while len((one := _clustered(mesh, cell)).faces) > share:
            cell *= 1.2
        found.append(one)
    drawn = sum(len(mesh.faces) for mesh in found)
    return tuple(found), [f"meshes are drawn with {drawn:,} of {whole:,} triangles; all else is computed with all"]


def _clustered(mesh: TrueMesh, cell_mm: float) -> TrueMesh:
    key = np.floor(mesh.vertices_mm / cell_mm).astype(int)
    _, where, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    where = where.ravel()
    mean = np.column_stack([np.bincount(where, mesh.vertices_mm[:, k]) for k in range(3)]) / count[:, None]
    faces = where[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return TrueMesh(mesh.name, mean, faces, mesh.albedo, mesh.closed)
