"""The world as a Mitsuba scene, built once and used by every view."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.render.bent import BentPanels, bent_mesh
from testfield.render.pattern import PatternTables, pattern_texture_class
from testfield.render.variant import mitsuba
from testfield.scene.world import World


@dataclass(frozen=True)
class Stage:
    """`scene` the Mitsuba scene; `texture` the pattern all panels share, which also tells a hit's panel and holds the
    exact surfaces of bent ones."""

    world: World
    scene: Any
    texture: Any


def build_stage(world: World) -> Stage:
    """Build the Mitsuba scene of a world."""
    mi = mitsuba()
    import drjit as dr

    pattern_texture_class()
    texture = mi.load_dict({"type": "testfield_pattern"})
    paint = mi.load_dict({"type": "diffuse", "reflectance": texture})
    parts: dict[str, Any] = {"type": "scene"}
    if world.panels.bent.any():
        # By default rays may slip through between the triangles of a mesh.
        parts["embree_use_robust_intersections"] = True
    for k, size in enumerate(world.panels.size_mm):
        name = f"panel{k:05d}"
        if world.panels.bent[k]:
            parts[name] = bent_mesh(world.panels, k, name, paint)
            continue
        parts[name] = {
            "type": "rectangle",
            "to_world": _to_world(world.panels.world_from_panel, k, size),
            "bsdf": paint,
        }
    for k, light in enumerate(world.lights):
        parts[f"light{k}"] = {
            "type": "rectangle",
            "to_world": _to_world(light.world_from_light, 0, np.array(light.size_mm)),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
            "emitter": {"type": "area", "radiance": {"type": "uniform", "value": light.radiance}},
        }
    if world.ambient_radiance > 0:
        parts["ambient"] = {
            "type": "constant",
            "radiance": {"type": "uniform", "value": world.ambient_radiance},
        }
    # optimize=True would merge all panels into one shape, and a hit could no longer tell its panel.
    scene = mi.load_dict(parts, optimize=False)

    # Dr.Jit numbers shapes in an order of its own; this table leads from its number to the panel's.
    def number(shape: Any) -> int:
        index: Any = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
        return int(index[0])

    numbers = {shape.id(): number(shape) for shape in scene.shapes()}
    table = np.zeros(max(numbers.values()) + 1, np.uint32)
    for k in range(len(world.panels)):
        table[numbers[f"panel{k:05d}"]] = k
    texture.panel_of_shape = mi.UInt32(table)
    texture.tables = PatternTables(world.panels, world.marks, world.field.bits, world.dirt)
    if world.panels.bent.any():
        texture.bent = BentPanels(world.panels)
    return Stage(world, scene, texture)


def _to_world(poses: Poses, index: int, size_mm: np.ndarray) -> Any:
    matrix = np.eye(4)
    matrix[:3, :3] = poses.R[index] * np.array([size_mm[0] / 2, size_mm[1] / 2, 1.0])
    matrix[:3, 3] = poses.t_mm[index]
    return mitsuba().ScalarTransform4f(matrix)
