"""The world as a Mitsuba scene, built once and used by every view."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.render.bent import BentPanels, bent_mesh
from testfield.render.materials import Materials
from testfield.render.paint import luminous_texture_class, paint_class
from testfield.render.pattern import PatternTables, pattern_texture_class
from testfield.render.points import MM2_A_M2, flash_class, flash_sources
from testfield.render.variant import mitsuba
from testfield.scene.world import LUMINOUS, TrueMesh, World


@dataclass(frozen=True)
class Stage:
    """`scene` the Mitsuba scene; `texture` the pattern all panels share, which also tells a hit's panel and holds the
    exact surfaces of bent ones; `materials` what is printed with; `panel_shape` tells of each shape's number whether it
    is a panel; `mesh_numbers` Dr.Jit's numbers of the meshes' shapes; `still` and `moving` the same scene in two parts
    where the target moves during the exposure; `flash_at` the station whose flash is part of the scene."""

    world: World
    scene: Any
    texture: Any
    materials: Materials
    panel_shape: Any
    mesh_numbers: tuple[int, ...] = ()
    still: Any = None
    moving: Any = None
    flash_at: int | None = None

    def is_panel(self, hit: Any) -> Any:
        """Whether hits lie on a panel, and not on a lamp or a mesh."""
        import drjit as dr

        number: Any = dr.reinterpret_array(mitsuba().UInt32, hit.shape)
        return hit.is_valid() & (dr.gather(mitsuba().UInt32, self.panel_shape, number, hit.is_valid()) == 1)

    def is_lamp(self, hit: Any) -> Any:
        """Whether hits or misses meet a light and no panel; luminous ink is a panel's."""
        emitter = hit.emitter(self.scene)
        lamp = emitter != None  # noqa: E711 (a device pointer)
        if self.materials.luminous_radiance:
            lamp &= ~self.is_panel(hit)
        return lamp


def build_stage(world: World, flash_at: int | None = None) -> Stage:
    """Build the Mitsuba scene of a world. The camera's flash is part of it only at the station `flash_at`."""
    mi = mitsuba()
    import drjit as dr

    pattern_texture_class()
    texture = mi.load_dict({"type": "testfield_pattern"})
    materials = Materials(world)
    if materials.special:
        paint_class()
        paint = mi.load_dict({"type": "testfield_paint"})
        paint.texture, paint.materials = texture, materials
    else:
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
    if world.luminous_radiance:
        luminous_texture_class()
        glow = mi.load_dict({"type": "testfield_luminous"})
        glow.texture, glow.materials = texture, materials
        for k in np.flatnonzero(world.panels.carry(LUMINOUS)).tolist():
            parts[f"panel{k:05d}"]["emitter"] = {"type": "area", "radiance": glow}
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
    if world.sky is not None:
        # Mitsuba's picture has its zenith along +y, and so turned upright its middle along -y.
        turn = mi.ScalarTransform4f().rotate([0, 0, 1], 180 + float(np.degrees(world.sky.azimuth_rad)))
        parts["sky"] = {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.repeat(world.sky.radiance[..., None], 3, axis=2)),
            "to_world": turn @ mi.ScalarTransform4f().rotate([1, 0, 0], 90),
        }
    for k, point in enumerate(world.point_lights):
        parts[f"point{k}"] = {
            "type": "point",
            "position": [float(v) for v in point.position_mm],
            "intensity": {"type": "uniform", "value": point.intensity_w_sr * MM2_A_M2},
        }
    if flash_at is not None and world.flash is not None:
        flash_class()
        flash = mi.load_dict({"type": "testfield_flash"})
        flash.sources = flash_sources(world, flash_at)
        parts["flash"] = flash
    # optimize=True would merge all panels into one shape, and a hit could no longer tell its panel.
    scene = mi.load_dict(parts, optimize=False)

    # Dr.Jit numbers shapes in an order of its own; this table leads from its number to the panel's.
    def number(shape: Any) -> int:
        index: Any = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
        return int(index[0])

    numbers = {shape.id(): number(shape) for shape in scene.shapes()}
    table, is_panel = np.zeros((2, max(numbers.values()) + 1), np.uint32)
    for k in range(len(world.panels)):
        table[numbers[f"panel{k:05d}"]], is_panel[numbers[f"panel{k:05d}"]] = k, 1
    texture.panel_of_shape = mi.UInt32(table)
    texture.tables = PatternTables(
        world.panels, world.marks, world.field.bits, world.dirt, world.prints, world.field.codes
    )
    if world.panels.bent.any():
        texture.bent = BentPanels(world.panels)
    bodies = tuple(numbers[f"mesh{k:05d}"] for k in range(len(world.meshes)))
    stage = Stage(
        world=world,
        scene=scene,
        texture=texture,
        materials=materials,
        panel_shape=mi.UInt32(is_panel),
        mesh_numbers=bodies,
        flash_at=flash_at,
    )
    if not world.motion.target.moves:
        return stage
    # Lamps and the room's surfaces stand still; all else carries marks, or moves with what does.
    room = {f"panel{k:05d}" for k in np.flatnonzero(world.panels.of_room)}
    groups: dict[bool, dict[str, Any]] = {True: {}, False: {}}
    for shape in scene.shapes():
        groups[not shape.id().startswith("light") and shape.id() not in room][shape.id()] = shape
    around = {name: parts[name] for name in ("ambient", "sky") if name in parts}
    robust = {name: value for name, value in parts.items() if name == "embree_use_robust_intersections"}
    still, moving = (
        mi.load_dict({"type": "scene", **robust, **shapes}, optimize=False)
        for shapes in (groups[False] | around, groups[True])
    )
    return replace(stage, still=still, moving=moving)


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
