"""Simple bodies that templates begin with, as meshes in millimetres: a wing, a dish, a car, a tube."""

from collections.abc import Callable

import numpy as np
import trimesh

Grid = np.ndarray
"""Points of a surface by row and column, with shape (n, m, 3)."""


def wing(span_mm: float = 5000, root_mm: float = 1500, tip_mm: float = 800, thickness: float = 0.12) -> trimesh.Trimesh:
    """A tapered half wing: span along x, chord along z from the trailing edge up, thickness along y.

    Sections are NACA 00xx, half thickness 5 t (0.2969 sqrt(c) - 0.1260 c - 0.3516 c^2 + 0.2843 c^3 - 0.1036 c^4) of the
    chord (NACA report 460; the last coefficient closes the trailing edge).
    """
    turn = np.linspace(0, 2 * np.pi, 61)[:-1]
    c = (1 + np.cos(turn)) / 2
    half = 5 * thickness * (0.2969 * np.sqrt(c) - 0.1260 * c - 0.3516 * c**2 + 0.2843 * c**3 - 0.1036 * c**4)
    section = np.stack([np.zeros_like(c), np.sign(np.sin(turn)) * half, 1 - c], axis=-1)
    along = np.linspace(0, 1, 41)
    chord = root_mm + (tip_mm - root_mm) * along
    rows = chord[:, None, None] * section
    rows[:, :, 0] = (along * span_mm - span_mm / 2)[:, None]
    return _closed(rows)


def dish(diameter_mm: float = 5000, focal_mm: float = 2000) -> trimesh.Trimesh:
    """The front of a paraboloid z = r^2 / (4 f), its axis along z and its vertex at the origin."""
    radius = np.linspace(0, diameter_mm / 2, 31)[1:]
    turn = np.linspace(0, 2 * np.pi, 97)[:-1]
    x, y = radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)
    rows = np.stack([x, y, (x**2 + y**2) / (4 * focal_mm)], axis=-1)
    mesh = _mesh(rows, first=np.zeros(3))
    if mesh.face_normals[:, 2].sum() < 0:
        mesh.invert()
    return mesh


def car(length_mm: float = 4400, width_mm: float = 1800, height_mm: float = 1250) -> trimesh.Trimesh:
    """A smooth body along x: superellipses of exponent 4 whose height follows bonnet, roof and boot."""
    along = np.linspace(-1, 1, 61)
    end = np.sqrt(np.clip(1 - np.abs(along) ** 6, 0.02, None))
    tall = height_mm * end * (0.55 + 0.45 / (1 + np.exp(-12 * (0.45 - np.abs(along + 0.05)))))
    turn = np.linspace(0, 2 * np.pi, 49)[:-1]
    y = np.sign(np.cos(turn)) * np.sqrt(np.abs(np.cos(turn)))
    z = np.sign(np.sin(turn)) * np.sqrt(np.abs(np.sin(turn)))
    rows = np.empty((len(along), len(turn), 3))
    rows[:, :, 0] = (along * length_mm / 2)[:, None]
    rows[:, :, 1] = (end * width_mm / 2)[:, None] * y
    rows[:, :, 2] = (tall / 2)[:, None] * (1 + z)
    return _closed(rows)


def tube(diameter_mm: float = 3000, length_mm: float = 6000) -> trimesh.Trimesh:
    """The inside of a cylinder along y, open at both ends."""
    turn = np.linspace(0, 2 * np.pi, 97)[:-1]
    along = np.linspace(-length_mm / 2, length_mm / 2, 41)
    rows = np.empty((len(along), len(turn), 3))
    rows[:, :, 0] = diameter_mm / 2 * np.cos(turn)
    rows[:, :, 1] = along[:, None]
    rows[:, :, 2] = diameter_mm / 2 * np.sin(turn)
    mesh = _mesh(rows)
    inwards = -mesh.triangles_center * [1, 0, 1]
    if np.sum(mesh.face_normals * inwards) < 0:
        mesh.invert()
    return mesh


BODIES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "wing.stl": wing,
    "dish.stl": dish,
    "car.stl": car,
    "tube.stl": tube,
}
"""By the names of the files that templates name."""


def _mesh(rows: Grid, first: np.ndarray | None = None, last: np.ndarray | None = None) -> trimesh.Trimesh:
    """Rows of points that close upon themselves, and a point in the middle of the first and last where one is given."""
    n, m, _ = rows.shape
    here = np.arange(n * m).reshape(n, m)
    after = np.roll(here, -1, axis=1)
    a, b, c, d = here[:-1].ravel(), after[:-1].ravel(), here[1:].ravel(), after[1:].ravel()
    faces = [np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]
    points = [rows.reshape(-1, 3)]
    for middle, ring, turned in ((first, 0, True), (last, -1, False)):
        if middle is not None:
            number = np.full(m, sum(len(p) for p in points))
            pair = (after[ring], here[ring]) if turned else (here[ring], after[ring])
            faces.append(np.stack([number, *pair], axis=-1))
            points.append(middle[None])
    return trimesh.Trimesh(np.concatenate(points), np.concatenate(faces), process=False)


def _closed(rows: Grid) -> trimesh.Trimesh:
    mesh = _mesh(rows, rows[0].mean(axis=0), rows[-1].mean(axis=0))
    if mesh.volume < 0:
        mesh.invert()
    return mesh
