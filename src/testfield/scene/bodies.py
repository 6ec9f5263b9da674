"""The bodies of a mesh: faces that hang together, wound alike and so that they face away from what is solid.

Exporters leave bodies of one file wound as they please, so each is asked for itself. A closed body that lies within
another closed one of the same file is a cavity of it, and faces into the void; one within a cavity is solid again. So a
point is in the material where it is within an odd number of closed bodies.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

LEAST_FACES = 4
SAMPLED = 12
"""Places of a body that must all lie within another one, lest bodies that cross are taken for cavities."""


def facing_outwards(vertices_mm: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, bool]:
    """Faces (f, 3) of a mesh with vertices (v, 3), wound so that closed bodies face outwards; whether all are closed.

    A body is closed where every edge joins two of its faces.
    """
    faces = faces.copy()
    bodies = _bodies(faces)
    closed = []
    for here in bodies:
        faces[here], whole = _wound_alike(faces[here]) if len(here) >= LEAST_FACES else (faces[here], False)
        if whole:
            closed.append(here)
    corners = vertices_mm[faces]
    low, high = (np.array([f(corners[here], axis=(0, 1)) for here in closed]).reshape(-1, 3) for f in (np.min, np.max))
    for k, here in enumerate(closed):
        around = np.flatnonzero((low <= low[k]).all(axis=1) & (high >= high[k]).all(axis=1))
        holders = sum(j != k and _within(corners[here], corners[closed[j]]) for j in around.tolist())
        if (_volume(corners[here]) < 0) != (holders % 2 == 1):
            faces[here] = faces[here][:, ::-1]
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return faces, len(closed) == len(bodies)


def solid_angles(corners_mm: np.ndarray, point_mm: np.ndarray) -> float:
    """Half of the solid angle that triangles (f, 3, 3) fill around a point: 2 pi within a closed body.

    By Van Oosterom and Strackee (1983).
    """
    a, b, c = np.moveaxis(corners_mm - point_mm, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    products = [np.einsum("ni,ni->n", v, w) * length for v, w, length in ((a, b, lc), (b, c, la), (c, a, lb))]
    return float(np.arctan2(volume, la * lb * lc + sum(products)).sum())


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all edges (3f,) the face, a number shared by equal ones, and whether they lead to the larger vertex."""
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    return np.repeat(np.arange(len(faces)), 3), number.reshape(-1), ends[:, 0] < ends[:, 1]


def _pairs(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces a and b (p,) that share an edge with no third one, and whether both walk it the same way."""
    face, number, up = _edges(faces)
    order = np.argsort(number, kind="stable")
    count = np.bincount(number)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])[count == 2]
    one, two = order[start], order[start + 1]
    return face[one], face[two], up[one] == up[two]


def _bodies(faces: np.ndarray) -> list[np.ndarray]:
    """The faces of each body. Bodies that touch along an edge remain two."""
    a, b, _ = _pairs(faces)
    joined = coo_array((np.ones(len(a)), (a, b)), shape=(len(faces), len(faces)))
    number = connected_components(joined, directed=False)[1]
    order = np.argsort(number, kind="stable")
    return np.split(order, np.cumsum(np.bincount(number))[:-1])


def _wound_alike(faces: np.ndarray) -> tuple[np.ndarray, bool]:
    """The faces of one body, neighbours wound alike, and whether it is closed."""
    a, b, same = _pairs(faces)
    if same.any():
        joined = coo_array((np.ones(len(a)), (a, b)), shape=(len(faces), len(faces))).tocsr()
        order, before = breadth_first_order(joined, 0, directed=False)
        opposed = {(int(i), int(j)): bool(s) for i, j, s in zip(a, b, same, strict=True)}
        turned = np.zeros(len(faces), bool)
        for i in order[1:]:
            j = int(before[i])
            turned[i] = turned[j] ^ opposed.get((int(i), j), opposed.get((j, int(i)), False))
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
        same = _pairs(faces)[2]
    twice = np.bincount(_edges(faces)[1]) == 2
    return faces, bool(twice.all() and not same.any())


def _volume(corners: np.ndarray) -> float:
    """Signed volume within triangles (f, 3, 3)."""
    a, b, c = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6)


def _within(body: np.ndarray, holder: np.ndarray) -> bool:
    """Whether a body's triangles (f, 3, 3) lie within those of a closed one."""
    places = body.mean(axis=1)[:: max(len(body) // SAMPLED, 1)]
    return all(abs(solid_angles(holder, place)) > np.pi for place in places)
