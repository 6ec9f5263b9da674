"""The world as a Mitsuba scene, built once and used by every view."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.render.bent import BentPanels, bent_mesh
from testfield.render.pattern import PatternTables, pattern_texture_class
from testfield.render.variant import mitsuba
from testfield.scene.world import TrueMesh, World


@dataclass(frozen=True)
class Stage:
    """`scene` the Mitsuba scene; `texture` the pattern all panels share, which also tells a hit's panel and holds the
    exact surfaces of bent ones; `mesh_numbers` Dr.Jit's numbers of the meshes' shapes; `still` and `moving` the same
    scene in two parts where the target moves during the exposure."""

    world: World
    scene: Any
    texture: Any
    mesh_numbers: tuple[int, ...] = ()
    still: Any = None
    moving: Any = None


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
    for k, mesh in enumerate(world.meshes):
        parts[f"mesh{k:05d}"] = _mesh(mesh)
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
    bodies = tuple(numbers[f"mesh{k:05d}"] for k in range(len(world.meshes)))
    if not world.motion.target.moves:
        return Stage(world, scene, texture, bodies)
    # Lamps and the room's surfaces stand still; all else carries marks, or moves with what does.
    room = {f"panel{k:05d}" for k in np.flatnonzero(world.panels.of_room)}
    groups: dict[bool, dict[str, Any]] = {True: {}, False: {}}
    for shape in scene.shapes():
        groups[not shape.is_emitter() and shape.id() not in room][shape.id()] = shape
    emitters = {"ambient": parts["ambient"]} if "ambient" in parts else {}
    still, moving = (
        mi.load_dict({"type": "scene", **shapes}, optimize=False) for shapes in (groups[False] | emitters, groups[True])
    )
    return Stage(world, scene, texture, bodies, still, moving)


def _mesh(mesh: TrueMesh) -> Any:
    """A mesh of flat faces; one that is not closed is seen from both sides."""
    mi = mitsuba()
    matt = {"type": "diffuse", "reflectance": {"type": "uniform", "value": mesh.albedo}}
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(matt if mesh.closed else {"type": "twosided", "bsdf": matt})
    shape = mi.Mesh(mesh.name, len(mesh.vertices_mm), len(mesh.faces), props=properties)
    data = mi.traverse(shape)
    data["vertex_positions"] = mi.Float(mesh.vertices_mm.astype(np.float32).ravel())
    data["faces"] = mi.UInt32(mesh.faces.astype(np.uint32).ravel())
    data.update()
    return shape


def _to_world(poses: Poses, index: int, size_mm: np.ndarray) -> Any:
    matrix = np.eye(4)
    matrix[:3, :3] = poses.R[index] * np.array([size_mm[0] / 2, size_mm[1] / 2, 1.0])
    matrix[:3, 3] = poses.t_mm[index]
    return mitsuba().ScalarTransform4f(matrix)
