"""Check targets stuck on meshes: where each sits and which way it faces."""

import numpy as np

from testfield.errors import TestfieldError
from testfield.scene.frames import facing, unit
from testfield.scene.sight import heights
from testfield.scene.target_parts import CheckOnMesh, CheckPart
from testfield.scene.world import TrueMesh
from testfield.seeds import generator

LIFT_MM = 0.05
"""A sticker lies this far above the highest point of the surface under it."""
TRIES = 500
BULGE = 0.1
"""What is further than this part of a sticker's side from its plane does not lie under it."""
ASTRAY = 0.1
"""A point this part of a mesh's size away from it, and more than a sticker's width, is no place on the mesh."""

Place = tuple[np.ndarray, np.ndarray]


def stickers(
    parts: tuple[CheckPart, ...], seed: int, meshes: tuple[TrueMesh, ...], side_in_diameters: float
) -> list[tuple[int, np.ndarray, np.ndarray, float]]:
    """Targets on meshes: code, middle of the sticker (3,), unit normal (3,), diameter.

    A sticker is stiff: it is parallel to the face it is put on, or lies evenly on the faces that meet under it where
    these turn away from each other, and rests on the highest point under it.

    Stickers are squares of `side_in_diameters` dot diameters. Raises `TestfieldError` where no mesh has the name, where
    a point is far from its mesh, where two stickers overlap or reach over an edge, or where random ones do not find
    enough room.
    """
    found = []
    taken: dict[str, list[tuple[np.ndarray, float]]] = {mesh.name: [] for mesh in meshes}
    for number, part in enumerate(parts):
        if not isinstance(part, CheckOnMesh):
            continue
        where = f"check_targets[{number}]"
        mesh = next((mesh for mesh in meshes if mesh.name == part.mesh), None)
        if mesh is None:
            raise TestfieldError(f"no mesh is called '{part.mesh}'", f"{where}.mesh")
        side = side_in_diameters * part.diameter_mm
        if part.points_mm is not None:
            places = [
                _laid(mesh, np.array(point), side, f"{where}.points_mm[{k}]") for k, point in enumerate(part.points_mm)
            ]
            _apart(places, side, taken[mesh.name], f"{where}.points_mm")
            _supported(mesh, places, side, f"{where}.points_mm")
        else:
            places = _drawn(part, number, seed, mesh, side, taken[mesh.name])
        for k, (place, normal) in enumerate(places):
            taken[mesh.name].append((place, side))
            lift = LIFT_MM + _rise(mesh, place, normal, side)
            found.append((part.first_code + k, place + lift * normal, normal, part.diameter_mm))
    return found


def nearest(mesh: TrueMesh, points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places (n, 3) of a mesh's surface nearest to points (n, 3), and the normals (n, 3) of their faces."""
    from trimesh.triangles import closest_point

    corners, places, faces = mesh.corners_mm, np.empty(points_mm.shape), np.empty(len(points_mm), int)
    for k, point in enumerate(points_mm):
        on_faces = closest_point(corners, np.tile(point, (len(corners), 1)))
        faces[k] = np.argmin(np.linalg.norm(on_faces - point, axis=1))
        places[k] = on_faces[faces[k]]
    return places, mesh.normals[faces]


def _laid(mesh: TrueMesh, point_mm: np.ndarray, side_mm: float, where: str) -> Place:
    """Where a sticker for a point (3,) is laid, and its normal (3,). Raises `TestfieldError` for a point far away."""
    from trimesh.triangles import closest_point

    at, normals = nearest(mesh, point_mm[None])
    away, most = float(np.linalg.norm(point_mm - at[0])), max(side_mm, ASTRAY * 2 * mesh.sphere[1])
    if away > most:
        there = ", ".join(f"{value:.0f}" for value in at[0])
        raise TestfieldError(
            f"the point is {away:.0f} mm away from '{mesh.name}', where {most:.0f} mm are taken for a place on it",
            where,
            f"give a point on its surface, in the world's frame and mm; the nearest is ({there})",
        )
    if not _under_all_corners(mesh, at, normals, side_mm)[0]:
        # A curved body of few facets turns by degrees at every edge between them; across one, no facet's own plane is
        # near the surface on both sides, but the mean of theirs is. At a rim of 90 degrees that is not near it either.
        near = np.linalg.norm(closest_point(mesh.corners_mm, np.tile(at, (len(mesh.faces), 1))) - at, axis=1)
        alike = np.unique(np.round(mesh.normals[near <= side_mm / 2], 6), axis=0)
        mean = alike.mean(axis=0)
        if np.linalg.norm(mean) > 0.5:
            normals = unit(mean)[None]
    return at[0], normals[0]


def _apart(places: list[Place], side_mm: float, taken: list[tuple[np.ndarray, float]], where: str) -> None:
    there = list(taken)
    for k, (place, _) in enumerate(places):
        for other, other_side in there:
            distance, need = np.linalg.norm(place - other), (side_mm + other_side) / 2
            if distance < need:
                raise TestfieldError(
                    f"target {k + 1} is {distance:.1f} mm from another one and their stickers need {need:.1f} mm",
                    where,
                    "move them apart, or lower diameter_mm",
                )
        there.append((place, side_mm))


def _supported(mesh: TrueMesh, places: list[Place], side_mm: float, where: str) -> None:
    """Raise `TestfieldError` where a sticker reaches over the mesh's edge, or the mesh bends away below it."""
    at, normals = (np.array(column) for column in zip(*places, strict=True))
    over = ~_under_all_corners(mesh, at, normals, side_mm)
    if over.any():
        k = int(np.argmax(over))
        raise TestfieldError(
            f"the sticker of target {k + 1} is {side_mm:.0f} mm wide, and '{mesh.name}' is not under all of it",
            where,
            "move the point away from the edge, or lower diameter_mm",
        )


def _drawn(
    part: CheckOnMesh, number: int, seed: int, mesh: TrueMesh, side_mm: float, taken: list[tuple[np.ndarray, float]]
) -> list[Place]:
    """Random places, uniform over the part of the surface that faces the right way and is flat enough."""
    a, b, c = np.moveaxis(mesh.corners_mm, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if part.facing is not None:
        area = area * (mesh.normals @ unit(np.array(part.facing)) >= np.cos(np.radians(part.within_deg)))
    count = part.count or 0
    places: list[Place] = []
    far = max(part.spacing_mm, np.sqrt(2) * side_mm)
    for k in range(count if area.any() else 0):
        # Each target tries places of its own stream: where another goes moves only whom it would touch.
        rng = generator(seed, f"check_targets/{part.first_code + k}/{part.seed}")
        for _ in range(count):
            faces = rng.choice(len(area), TRIES, p=area / area.sum())
            u, v = rng.uniform(size=(2, TRIES))
            u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
            drawn = a[faces] + u[:, None] * (b - a)[faces] + v[:, None] * (c - a)[faces]
            flat = _under_all_corners(mesh, drawn, mesh.normals[faces], side_mm)
            found = _first_free(drawn[flat], mesh.normals[faces][flat], side_mm, far, taken, places)
            if found is not None:
                places.append(found)
                break
        else:
            break
    if count and len(places) == count:
        return places
    raise TestfieldError(
        f"only {len(places)} of {count} targets find a place on '{part.mesh}', flat and wide enough for stickers of "
        f"{side_mm:.0f} mm",
        f"check_targets[{number}].count",
        f"lower it, spacing_mm (stickers need {np.sqrt(2) * side_mm:.0f}) or diameter_mm, or widen within_deg",
    )


def _first_free(
    drawn: np.ndarray,
    normals: np.ndarray,
    side_mm: float,
    far_mm: float,
    taken: list[tuple[np.ndarray, float]],
    places: list[Place],
) -> Place | None:
    """The first of the drawn places that is clear of stickers `taken` and `far_mm` from the other `places`."""
    for place, normal in zip(drawn, normals, strict=True):
        # Squares at any turn do not overlap where their diagonals have room.
        free = all(np.linalg.norm(place - other) >= (side_mm + side) / np.sqrt(2) for other, side in taken)
        if free and all(np.linalg.norm(place - other) >= far_mm for other, _ in places):
            return place, normal
    return None


def _under_all_corners(mesh: TrueMesh, places: np.ndarray, normals: np.ndarray, side_mm: float) -> np.ndarray:
    """(n,) whether the surface is near all four corners of stickers at places (n, 3)."""
    corner = side_mm / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    alike, number = np.unique(normals, axis=0, return_inverse=True)
    frames = np.array([facing(normal) for normal in alike])[number.reshape(-1)]
    corners = places[:, None] + np.einsum("nij,kj->nki", frames[:, :, :2], corner)
    above = heights(mesh, corners.reshape(-1, 3), np.repeat(normals, 4, axis=0), BULGE * side_mm)
    return np.isfinite(above).reshape(-1, 4).all(axis=1)


def _rise(mesh: TrueMesh, place: np.ndarray, normal: np.ndarray, side_mm: float) -> float:
    """How far the surface under a sticker rises above its tangent plane, in mm.

    A surface of flat faces is highest at a vertex under the sticker or somewhere on the sticker's edge.
    """
    frame, reach = facing(normal), BULGE * side_mm
    local = (mesh.vertices_mm - place) @ frame
    under = np.all(np.abs(local) <= (side_mm / 2, side_mm / 2, reach), axis=1)
    step = np.linspace(-side_mm / 2, side_mm / 2, 129)
    end = np.full(len(step), side_mm / 2)
    edge = np.concatenate([np.column_stack(pair) for pair in ((step, end), (step, -end), (end, step), (-end, step))])
    along = heights(mesh, place + edge @ frame[:, :2].T, np.tile(normal, (len(edge), 1)), reach)
    return float(max(0.0, local[under, 2].max(initial=0), np.nan_to_num(along).max()))
