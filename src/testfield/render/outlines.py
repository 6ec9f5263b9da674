"""Outlines of everything in the world: wherever the light that comes from a surface may have a step.

On panels: their borders, the edges of marks, prints and dirt. In space: the borders of lamps, the edges of meshes, the
lines where surfaces cut each other, and the lines of a bent panel behind which it hides itself.
"""

from dataclasses import dataclass

import numpy as np
import trimesh

from testfield.camera.pose import Poses
from testfield.scene import bend
from testfield.scene.world import Panels, TrueMesh, World

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
FLAT_COSINE = 1 - 1e-9
"""Faces of a mesh whose normals differ by less are one face: no edge is seen between them."""
LATTICE = 17
"""Points each way on a bent panel that tell whether it may cut another surface."""


@dataclass(frozen=True)
class Curves:
    """Point t in [0, 1] of curve i is `start` + t `step` + `radius` (cos 2 pi t, sin 2 pi t) in mm on paper `panel`."""

    panels: Panels
    panel: np.ndarray
    start: np.ndarray
    step: np.ndarray
    radius: np.ndarray

    def __len__(self) -> int:
        return len(self.panel)

    def at(self, index: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(n, 3) points in the world of curves (n,) at t (n,)."""
        turn = 2 * np.pi * t
        xy = self.start[index] + t[:, None] * self.step[index]
        xy += self.radius[index, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        k = self.panel[index]
        xyz = bend.to_space(xy, self.panels.curvature_per_mm[k], self.panels.bend_axis_rad[k])
        return self.panels.world_from_panel[k].apply(xyz)


@dataclass(frozen=True)
class Lines:
    """Point t in [0, 1] of line i is `start` + t `step`, both (n, 3) in mm in the world."""

    start: np.ndarray
    step: np.ndarray

    def __len__(self) -> int:
        return len(self.start)

    def at(self, index: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(n, 3) points of lines (n,) at t (n,)."""
        return self.start[index] + t[:, None] * self.step[index]


def borders(world: World) -> Curves:
    """The borders of all panels."""
    every = np.arange(len(world.panels))
    return Curves(world.panels, *_rectangles(every, np.zeros((len(every), 2)), world.panels.size_mm))


def prints(world: World, seen: np.ndarray) -> Curves:
    """What is printed on the panels that may be `seen` (panels,) from their front, and their dirt."""
    parts, marks = [], world.marks
    shown = np.flatnonzero(seen[marks.panel] & ~marks.corner)
    ringed = shown[marks.code[shown] > 0]
    radius = marks.diameter_mm / 2
    inner, outer = marks.radii.inner * radius, marks.radii.outer * radius
    for which, reach in ((shown, radius), (ringed, inner), (ringed, outer)):
        parts.append(_circles(marks.panel[which], marks.xy_mm[which], reach[which]))
    parts.append(_spokes(world, ringed, inner, outer))
    for print_ in world.prints:
        if seen[print_.panel]:
            parts.append(_steps(print_.panel, print_.cells.x_mm, print_.cells.y_mm, print_.cells.black))
            if print_.discs is not None:
                where = np.full(len(print_.discs.radius_mm), print_.panel)
                parts.append(_circles(where, print_.discs.xy_mm, print_.discs.radius_mm))
    spots = np.flatnonzero(seen[world.dirt.panel]) if len(world.dirt) else np.zeros(0, int)
    parts.append(_circles(world.dirt.panel[spots], world.dirt.xy_mm[spots], world.dirt.radius_mm[spots]))
    panel, start, step, reach = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Curves(world.panels, panel, start, step, reach)


Part = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Columns of `Curves`."""


def _rectangles(panel: np.ndarray, middle: np.ndarray, size: np.ndarray) -> Part:
    corners = middle[:, None] + size[:, None] * CORNERS
    start, step = corners.reshape(-1, 2), (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2)
    return np.repeat(panel, 4), start, step, np.zeros(len(start))


def _circles(panel: np.ndarray, middle: np.ndarray, radius: np.ndarray) -> Part:
    return panel, middle, np.zeros_like(middle), radius


def _spokes(world: World, ringed: np.ndarray, inner: np.ndarray, outer: np.ndarray) -> Part:
    """The lines between all segments of rings, whether their neighbours differ or not."""
    bits = world.field.bits
    turn = 2 * np.pi * np.arange(bits) / bits
    way = np.column_stack([np.cos(turn), np.sin(turn)])
    mark = np.repeat(ringed, bits)
    way = np.tile(way, (len(ringed), 1))
    start = world.marks.xy_mm[mark] + inner[mark, None] * way
    return world.marks.panel[mark], start, (outer - inner)[mark, None] * way, np.zeros(len(mark))


def _steps(panel: int, x: np.ndarray, y: np.ndarray, black: np.ndarray) -> Part:
    """The edges between black cells and white ones, white being around them all."""
    cells = np.pad(black, 1)
    row, line = np.nonzero(cells[1:-1, 1:] != cells[1:-1, :-1])
    upright = np.column_stack([x[line], y[row]]), np.column_stack([0 * x[line], y[row + 1] - y[row]])
    line, column = np.nonzero(cells[1:, 1:-1] != cells[:-1, 1:-1])
    level = np.column_stack([x[column], y[line]]), np.column_stack([x[column + 1] - x[column], 0 * y[line]])
    start, step = (np.concatenate(pair) for pair in zip(upright, level, strict=True))
    return np.full(len(start), panel), start, step, np.zeros(len(start))


def lines_in_space(world: World, eye_mm: np.ndarray) -> Lines:
    """Borders of lamps, edges of meshes, where flat surfaces cut each other and meshes cut them, and the lines along
    which a bent panel turns away from `eye_mm` (3,)."""
    flat = np.flatnonzero(~world.panels.bent)
    lamps = [light.world_from_light for light in world.lights]
    poses = [world.panels.world_from_panel[flat], *lamps]
    plane = Poses(np.concatenate([p.R for p in poses]), np.concatenate([p.t_mm for p in poses]))
    size = np.array([*world.panels.size_mm[flat], *[light.size_mm for light in world.lights]]).reshape(-1, 2)
    parts = [_cuts(plane, size), *[_borders(light.world_from_light, light.size_mm) for light in world.lights]]
    for mesh in world.meshes:
        parts += [_edges(mesh), *_slices(mesh, plane, size)]
    parts += [_turning(world.panels, k, eye_mm) for k in np.flatnonzero(world.panels.bent).tolist()]
    ends = np.concatenate(parts)
    return Lines(ends[:, 0], ends[:, 1] - ends[:, 0])


def _borders(pose: Poses, size: tuple[float, float]) -> np.ndarray:
    corners = np.column_stack([CORNERS * size, np.zeros(4)]) @ pose.R[0].T + pose.t_mm[0]
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _cuts(plane: Poses, size: np.ndarray) -> np.ndarray:
    """(n, 2, 3) ends of the lines in which rectangles cut each other."""
    n, reach = len(size), np.hypot(*size.T) / 2
    i, j = np.triu_indices(n, 1)
    near = np.linalg.norm(plane.t_mm[i] - plane.t_mm[j], axis=1) < reach[i] + reach[j]
    i, j = i[near], j[near]
    normal = plane.R[:, :, 2]
    along = np.cross(normal[i], normal[j])
    square = (along * along).sum(axis=1)
    crossing = square > 1e-18
    i, j, along, square = i[crossing], j[crossing], along[crossing], square[crossing]
    # The point of both planes that is nearest to the first rectangle's middle.
    off = np.einsum("ni,ni->n", normal[j], plane.t_mm[j] - plane.t_mm[i])
    point = plane.t_mm[i] + (off / square)[:, None] * np.cross(along, normal[i])
    low, high = np.full(len(i), -np.inf), np.full(len(i), np.inf)
    for k in (i, j):
        for axis in (0, 1):
            side = plane.R[k, :, axis]
            at, slope = ((v * side).sum(axis=1) for v in (point - plane.t_mm[k], along))
            half = size[k, axis] / 2
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.sort([(-half - at) / slope, (half - at) / slope], axis=0)
            level = np.abs(slope) < 1e-15
            inside = np.abs(at) <= half
            low = np.maximum(low, np.where(level, np.where(inside, -np.inf, np.inf), ends[0]))
            high = np.minimum(high, np.where(level, np.where(inside, np.inf, -np.inf), ends[1]))
    met = low < high
    return point[met, None] + np.stack([low[met], high[met]], axis=1)[..., None] * along[met, None]


def _edges(mesh: TrueMesh) -> np.ndarray:
    """(n, 2, 3) ends of the edges where faces meet at an angle, or where there is one face alone."""
    body = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    inverse, count = np.unique(body.edges_sorted, axis=0, return_counts=True)
    alone = inverse[count == 1]
    normals = mesh.normals
    a, b = body.face_adjacency.T
    bent = np.einsum("ni,ni->n", normals[a], normals[b]) < FLAT_COSINE
    return mesh.vertices_mm[np.concatenate([alone, body.face_adjacency_edges[bent]])]


def _slices(mesh: TrueMesh, plane: Poses, size: np.ndarray) -> list[np.ndarray]:
    """Where a mesh cuts the planes of rectangles that come near it."""
    middle, reach = mesh.sphere
    near = np.linalg.norm(plane.t_mm - middle, axis=1) < reach + np.hypot(*size.T) / 2
    body = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    cut = [
        trimesh.intersections.mesh_plane(body, plane.R[k, :, 2], plane.t_mm[k]) for k in np.flatnonzero(near).tolist()
    ]
    return [lines.reshape(-1, 2, 3) for lines in cut]


def _turning(panels: Panels, k: int, eye_mm: np.ndarray) -> np.ndarray:
    """(n, 2, 3) ends of the lines at which a bent panel's front turns away: they lie along its bending axis."""
    curvature, axis = float(panels.curvature_per_mm[k]), float(panels.bend_axis_rad[k])
    eye = panels.world_from_panel.inverse()[np.array([k])].apply(eye_mm[None])[0]
    across, along = np.array([-np.sin(axis), np.cos(axis)]), np.array([np.cos(axis), np.sin(axis)])
    # From the cylinder's axis, at depth 1 / curvature behind the middle, the eye's tangents touch at +- acos(r / d).
    q, z = eye[:2] @ across, eye[2] + 1 / curvature
    distance = np.hypot(q, z)
    radius = abs(1 / curvature)
    if distance <= radius:
        return np.zeros((0, 2, 3))
    middle, half = np.arctan2(q, z) if curvature > 0 else np.arctan2(-q, -z), np.arccos(radius / distance)
    s = np.array([middle - half, middle + half]) / curvature
    reach = np.hypot(*panels.size_mm[k]) / 2
    ends = s[:, None, None] * across + np.array([-reach, reach])[None, :, None] * along
    xyz = bend.to_space(ends.reshape(-1, 2), np.full(4, curvature), np.full(4, axis))
    return panels.world_from_panel[np.full(4, k)].apply(xyz).reshape(2, 2, 3)


def lattice_mm(panels: Panels, k: int) -> np.ndarray:
    """(LATTICE^2, 3) points all over panel k, edges included, row by row."""
    at = np.linspace(-0.5, 0.5, LATTICE)
    lattice = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    return panels.place(np.full(len(lattice), k), lattice * panels.size_mm[k])[0]


def cut_panels(world: World) -> np.ndarray:
    """(n,) indices of bent panels that may cut another surface: what they show of their crossing is not outlined."""
    panels = world.panels
    reach = np.hypot(*panels.size_mm.T) / 2
    cut = []
    for k in np.flatnonzero(panels.bent).tolist():
        points = lattice_mm(panels, k)
        pitch = panels.size_mm[k].max() / (LATTICE - 1)
        near = np.linalg.norm(panels.world_from_panel.t_mm - panels.world_from_panel.t_mm[k], axis=1) < reach + reach[k]
        for other in np.flatnonzero(near & (np.arange(len(panels)) != k)):
            pose = panels.world_from_panel.inverse()[np.full(len(points), other)]
            curve = panels.curvature_per_mm[other], panels.bend_axis_rad[other]
            paper = bend.to_paper(pose.apply(points), *(np.full(len(points), value) for value in curve))
            above = np.all(np.abs(paper[:, :2]) < panels.size_mm[other] / 2 + pitch, axis=1)
            heights = paper[:, 2].reshape(LATTICE, LATTICE)
            # Between the lattice's points heights leave a straight line by no more than an eighth of this.
            bow = max(np.abs(np.diff(heights, 2, axis=axis)).max() for axis in (0, 1))
            heights = paper[above, 2]
            if above.any() and not (np.all(heights > bow) or np.all(heights < -bow)):
                cut.append(k)
                break
        else:
            spheres = [mesh.sphere for mesh in world.meshes]
            if any(np.linalg.norm(middle - panels.world_from_panel.t_mm[k]) < r + reach[k] for middle, r in spheres):
                cut.append(k)
    return np.array(cut, int)
