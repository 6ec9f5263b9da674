"""Bent panels for the renderers: a mesh that rays find, and the exact cylinder that the fast renderer measures on.

The mesh is cut along lines parallel to the bending axis, which lie wholly on the cylinder. Both renderers move each hit
along its ray from the mesh, which is `PROXY_MM` beside the true surface at most, to the cylinder itself before they ask
what is printed there: no target's edge depends on the mesh, only the board's own outline does.
"""

from typing import Any

import numpy as np

from testfield.render.device_maths import columns, vector_of
from testfield.render.variant import mitsuba
from testfield.scene.bend import extent_mm
from testfield.scene.world import Panels

PROXY_MM = 2e-3
MOST_STRIPS = 1024
SLIMMEST = 4.0
"""Pieces of a strip are at most this many times longer than wide: hits on slivers lose their digits."""
NEWTON_STEPS = 3


def strips(size_mm: np.ndarray, curvature_per_mm: float, axis_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Paper coordinates (n, 2) of a sheet's vertices and triangles (m, 3) of strips along the bending axis."""
    along = np.array([np.cos(axis_rad), np.sin(axis_rad)])
    across = np.array([-along[1], along[0]])
    half = extent_mm((size_mm[0], size_mm[1]), axis_rad) / 2
    width_mm = np.sqrt(8 * PROXY_MM / abs(curvature_per_mm))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size_mm / 2
    # A cut through every corner, so that each strip's ends are straight.
    count = int(np.clip(np.ceil(2 * half / width_mm), 2, MOST_STRIPS))
    s = np.unique(np.concatenate([np.linspace(-half, half, count + 1), np.clip(corners @ across, -half, half)]))
    s = s[np.concatenate([[True], np.diff(s) > 1e-9 * half])]
    # On the line at s, w runs between the two sides of the sheet that it meets.
    low, high = np.full(len(s), -np.inf), np.full(len(s), np.inf)
    for axis in (0, 1):
        if abs(along[axis]) > 1e-9:
            ends = (np.array([[-0.5], [0.5]]) * size_mm[axis] - s * across[axis]) / along[axis]
            low, high = np.maximum(low, ends.min(axis=0)), np.minimum(high, ends.max(axis=0))
    low = np.minimum(low, high)
    pieces = int(np.clip(np.ceil((high - low).max() * count / (2 * half * SLIMMEST)), 1, MOST_STRIPS))
    w = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, pieces + 1)
    xy = (w[..., None] * along + (s[:, None] * across)[:, None, :]).reshape(-1, 2)
    row = pieces + 1
    k = (row * np.arange(len(s) - 1)[:, None] + np.arange(pieces)).ravel()
    # With w along the axis and s across it counter-clockwise, these turn counter-clockwise seen from the front.
    faces = np.concatenate([np.column_stack([k, k + 1, k + row + 1]), np.column_stack([k, k + row + 1, k + row])])
    a, b, c = (xy[faces[:, j]] for j in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return xy, faces[area > 1e-9 * area.max()]


def bent_mesh(panels: Panels, k: int, name: str, paint: Any) -> Any:
    """A Mitsuba mesh of bent panel k, its texture coordinates those of the flat paper."""
    mi = mitsuba()
    size = panels.size_mm[k]
    xy, faces = strips(size, float(panels.curvature_per_mm[k]), float(panels.bend_axis_rad[k]))
    points, frames = panels.place(np.full(len(xy), k), xy)
    properties = mi.Properties()
    properties["mesh_bsdf"] = paint
    properties.set_id(name)
    mesh = mi.Mesh(name, len(xy), len(faces), properties, has_vertex_normals=True, has_vertex_texcoords=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ascontiguousarray(points, np.float32).ravel()
    parameters["vertex_normals"] = np.ascontiguousarray(frames[:, :, 2], np.float32).ravel()
    parameters["vertex_texcoords"] = np.ascontiguousarray(xy / size + 0.5, np.float32).ravel()
    parameters["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    parameters.update()
    return mesh


class BentPanels:
    """The bent panels' exact surfaces, in tables on the device by panel."""

    def __init__(self, panels: Panels):
        mi = mitsuba()
        axis = panels.bend_axis_rad
        R = panels.world_from_panel.R
        self.curvature = mi.Float(panels.curvature_per_mm.astype(np.float32))
        # Directions in the world along the bending axis, across it, and out of the middle of the panel.
        directions = (
            np.cos(axis)[:, None] * R[:, :, 0] + np.sin(axis)[:, None] * R[:, :, 1],
            -np.sin(axis)[:, None] * R[:, :, 0] + np.cos(axis)[:, None] * R[:, :, 1],
            R[:, :, 2],
        )
        self.directions = [columns(d) for d in directions]
        self.middle = columns(panels.world_from_panel.t_mm)
        self.turn = columns(np.column_stack([np.cos(axis), np.sin(axis)]))
        self.size = columns(panels.size_mm)

    def refine(self, hit: Any, ray: Any, panel: Any, active: Any) -> Any:
        """The hit with t, uv, n, dp_du and dp_dv of the cylinder where `active` and its panel is bent."""
        mi = mitsuba()
        import drjit as dr

        curvature = dr.gather(mi.Float, self.curvature, panel, active)
        active = active & (curvature != 0)
        k = dr.select(active, curvature, 1)

        along, across, out = (vector_of(table, panel, active) for table in self.directions)
        # From the hit on the mesh, near the middle of the panel, so that few digits are lost.
        start = (ray.o - vector_of(self.middle, panel, active)) + hit.t * ray.d
        q, z, dq, dz = dr.dot(start, across), dr.dot(start, out), dr.dot(ray.d, across), dr.dot(ray.d, out)
        step = mi.Float(0)
        for _ in range(NEWTON_STEPS):
            at_q, at_z = q + step * dq, z + step * dz
            value = k * (at_q * at_q + at_z * at_z) + 2 * at_z
            slope = 2 * (k * (at_q * dq + at_z * dz) + dz)
            # A ray that grazes the surface stays where the mesh has it.
            step -= dr.select(dr.abs(slope) > 1e-3, value / slope, 0)
        q, z, w = q + step * dq, z + step * dz, dr.dot(start, along) + step * dr.dot(ray.d, along)
        angle = dr.atan2(k * q, 1 + k * z)
        s = angle / k
        sine, cosine = dr.sin(angle), dr.cos(angle)
        cos_axis, sin_axis = (dr.gather(mi.Float, column, panel, active) for column in self.turn)
        width, height = (dr.gather(mi.Float, column, panel, active) for column in self.size)
        on_arc = cosine * across - sine * out
        uv = mi.Point2f((cos_axis * w - sin_axis * s) / width + 0.5, (sin_axis * w + cos_axis * s) / height + 0.5)
        hit.t = dr.select(active, hit.t + step, hit.t)
        hit.uv = dr.select(active, uv, hit.uv)
        hit.n = dr.select(active, mi.Normal3f(sine * across + cosine * out), hit.n)
        hit.dp_du = dr.select(active, width * (cos_axis * along - sin_axis * on_arc), hit.dp_du)
        hit.dp_dv = dr.select(active, height * (sin_axis * along + cos_axis * on_arc), hit.dp_dv)
        return hit
