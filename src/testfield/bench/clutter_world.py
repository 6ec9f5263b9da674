"""Cluttered views as a world that can be rendered."""

import numpy as np

from testfield.bench.shapes import Shapes
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project_camera
from testfield.render.direct import DirectLight
from testfield.render.irradiance import Irradiance
from testfield.render.mesh_light import MeshLight
from testfield.scene.world import CHECK, Panels, TrueMarks, World
from testfield.sensor.expose import Sensor
from testfield.targets.field import Field

SENSOR = Sensor(5.0, 8.0, 8.0, 530.0, 0.6, 10_500.0, 2.3, 2.6, 64.0, 12)
WHITE_E = 6000.0
"""Electrons in a pixel of the brightest white."""
NEARER_MM = 150.0
"""A card whose centre is less than this behind another's may yet hide a part of it: cards are tilted."""


class ClutterPanels:
    """Panels as they are collected: each with its size, frame, albedos and light at its four corners."""

    def __init__(self, random: np.random.Generator):
        self.random = random
        self.rows: list[tuple] = []

    def add(self, at: np.ndarray, R: np.ndarray, size: tuple[float, float], ground: float, ink: float) -> int:
        """Add a panel of uneven light; returns its number."""
        level = self.random.uniform(0.35, 0.85)
        slope = self.random.uniform(-0.5, 0.5, 2)
        corners = level * np.array(
            [1 - slope[0] - slope[1], 1 + slope[0] - slope[1], 1 - slope[0] + slope[1], 1 + slope[0] + slope[1]]
        )
        corners = np.clip(corners, 0.15, 1.0)
        if self.random.random() < LIT_CORNER:
            corners[self.random.integers(4)] = 1.6
        self.rows.append((at, R, size, ground, ink, corners))
        return len(self.rows) - 1


LIT_CORNER = 0.15
"""Part of the panels of which a lamp lights one corner more than twice as much."""


def outline_of(row: tuple, interior: Interior) -> np.ndarray:
    """(4, 2) px corners of a panel's image."""
    at, R, size = row[:3]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(size) / 2
    return project_camera(interior, at + corners @ R[:, :2].T)


def behind(
    xy_px: np.ndarray, extent_px: np.ndarray, depth_mm: np.ndarray, panels: list[tuple], interior: Interior
) -> np.ndarray:
    """(n,) whether a circle of `extent_px` around each point touches one of the panels that are not farther away; the
    first n panels are the targets' own cards."""
    import cv2

    hidden = np.zeros(len(xy_px), bool)
    for k, row in enumerate(panels):
        polygon = outline_of(row, interior).astype(np.float32)
        middle, reach = polygon.mean(axis=0), np.ptp(polygon, axis=0).max()
        near = np.flatnonzero(
            (np.linalg.norm(xy_px - middle, axis=1) < reach + extent_px) & (row[0][2] < depth_mm + NEARER_MM)
        )
        for j in near[near != k]:
            x, y = (float(v) for v in xy_px[j])
            hidden[j] |= -cv2.pointPolygonTest(polygon[:, None], (x, y), True) < extent_px[j] + 1
    return hidden


def light_of(panels: ClutterPanels, shapes: Shapes) -> Irradiance:
    """The light on all panels: what their shapes and sizes say of the white that an image shows."""
    n = len(panels.rows)
    scale = np.pi * WHITE_E / SENSOR.electrons_per_radiance / 0.9
    values = np.concatenate([row[5] for row in panels.rows]) * scale
    nothing = DirectLight(np.ones((n, 2), int), np.full(n, 2), np.zeros(4 * n, np.float32))
    mesh, light = shapes.mesh(), np.concatenate(shapes.light) * scale
    on_shapes = MeshLight(np.ones(len(mesh.faces), int), light.astype(np.float32))
    return Irradiance(np.full((n, 2), 2), values.astype(np.float32), nothing, on_shapes)


def world_of(
    panels: ClutterPanels, marks: list, shapes: Shapes, interior: Interior, blur_px: float, field: Field
) -> World:
    """The world of panels and marks in front of one camera."""
    at, R, size, ground, ink, _ = zip(*panels.rows, strict=True)
    panel, xy, diameter, code = zip(*marks, strict=True)
    none = np.full(len(marks), -1)
    return World(
        name="clutter",
        seed=1,
        field_diagonal_mm=3000.0,
        panels=Panels(
            name=tuple(f"panel{k}" for k in range(len(at))),
            world_from_panel=Poses(np.array(R), np.array(at)),
            size_mm=np.array(size, float),
            ground_albedo=np.array(ground, float),
            ink_albedo=np.array(ink, float),
        ),
        marks=TrueMarks(
            panel=np.array(panel),
            xy_mm=np.array(xy, float),
            diameter_mm=np.array(diameter, float),
            code=np.array(code),
            role=np.full(len(marks), CHECK),
            board=none,
            point=none,
            radii=field.radii,
        ),
        world_from_board=Poses.identity(0),
        station_name=("station",),
        camera_from_world=Poses.identity(1),
        interior=interior,
        psf_sigma_px=blur_px,
        lights=(),
        ambient_radiance=0.0,
        field=field,
        meshes=(shapes.mesh(),),
    )
