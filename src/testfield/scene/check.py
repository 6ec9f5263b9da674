"""What is wrong with a scene before any long work starts: errors stop it, warnings are told."""

from collections.abc import Callable

import numpy as np

from testfield.errors import TestfieldError, gather
from testfield.scene.bend import to_paper
from testfield.scene.check_camera import bendable_ink, focused, lit, possible_optics, visible_paint
from testfield.scene.check_marks import codes_exist_and_differ, marks_fit, unique_names
from testfield.scene.check_patterns import check_patterns, pattern_warnings
from testfield.scene.exposure import check_exposure
from testfield.scene.meshes import inside
from testfield.scene.parts import ScenePart
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.targets.field import TIME

DECODABLE_PX = 8.0
NAMED = 6
"""Panels, and codes on each, that a warning names."""
FACES_DEG = 75.0
LEAST_CODES, LEAST_MARKS = 2, 8
"""What an image must show of a board to tell where it is."""
LARGE, SMALL = 20.0, 0.02
"""A mesh's size over the measuring volume's diagonal beyond which its unit may be wrong."""


def check_parts(
    scene: SceneFile, parts: list[tuple[ScenePart, World, Views]], world: World, views: Views, source: str
) -> list[str]:
    """Warnings on a scene, one sentence each: on each of its parts, and on the world of all images."""
    if len(parts) == 1:
        return check_scene(parts[0][0].scene, world, views, source)
    found: list[str] = []
    for part, own, seen in parts:
        said = f"{source}, camera '{part.camera}'" if scene.cameras else source
        found += _possible(part.scene, own, said) + focused(part.scene, own, seen, said)
    _see(world, views, source)
    found += _sizes(world, views, source) + _joined(world, views, source) + _scaled(world, source)
    return list(dict.fromkeys(found + pattern_warnings(world, views, source)))


def check_scene(scene: SceneFile, world: World, views: Views, source: str) -> list[str]:
    """Warnings, one sentence each. Raises `TestfieldError` for all that makes the scene impossible."""
    unlit = _possible(scene, world, source, lambda: _see(world, views, source))
    blurred = focused(scene, world, views, source)
    found = _sizes(world, views, source) + _joined(world, views, source) + unlit + blurred + _scaled(world, source)
    return found + pattern_warnings(world, views, source)


def _see(world: World, views: Views, source: str) -> None:
    gather(lambda: _stations_stand_free(world, source), lambda: _stations_see(world, views, source))


def _possible(scene: SceneFile, world: World, source: str, look: Callable[[], None] = lambda: None) -> list[str]:
    """Warnings on the light. Raises `TestfieldError` for all that one camera's scene cannot be; `look` comes before."""
    gather(
        lambda: possible_optics(scene, world, source),
        lambda: visible_paint(scene, source),
        lambda: bendable_ink(scene, source),
        lambda: unique_names(scene, source),
        lambda: codes_exist_and_differ(scene, world, source),
        lambda: check_patterns(scene, world, source),
        lambda: marks_fit(scene, world, source),
        look,
    )
    return lit(scene, source) + check_exposure(scene, world, source)


def _stations_stand_free(world: World, source: str) -> None:
    eyes = world.camera_from_world.origin_mm
    pairs = {name.removesuffix(" (back)"): k for k, name in enumerate(world.panels.name) if name.endswith(" (back)")}
    stickers = set(world.marks.panel) - {k - 1 for k in pairs.values()}
    for k, name in enumerate(world.panels.name):
        if name.endswith(" (back)") or k in stickers:
            continue
        local = (eyes - world.panels.world_from_panel.t_mm[k]) @ world.panels.world_from_panel.R[k]
        curve = (
            np.full(len(local), values[k]) for values in (world.panels.curvature_per_mm, world.panels.bend_axis_rad)
        )
        local = to_paper(local, *curve)
        over = np.all(np.abs(local[:, :2]) <= world.panels.size_mm[k] / 2, axis=1)
        if name in pairs:  # a board or a card: the body between front and back
            back = world.panels.world_from_panel.t_mm[pairs[name]] - world.panels.world_from_panel.t_mm[k]
            within = over & (local[:, 2] < 50) & (local[:, 2] > -np.linalg.norm(back) - 50)
        else:  # a wall: everything behind the side that is seen
            within = over & (local[:, 2] < 50)
        if within.any():
            s = int(np.argmax(within))
            where = ", ".join(str(round(v)) for v in eyes[s])
            raise TestfieldError(
                f"the camera at ({where}) mm is inside or behind '{name}'",
                f"{source}, station '{world.station_name[s]}'",
                "move position_mm to the side that is seen",
            )
    for mesh in world.meshes:
        within = inside(mesh, eyes)
        if within.any():
            s = int(np.argmax(within))
            where = ", ".join(str(round(v)) for v in eyes[s])
            raise TestfieldError(
                f"the camera at ({where}) mm is inside the mesh '{mesh.name}'",
                f"{source}, station '{world.station_name[s]}'",
                f"move position_mm out of it, or mend the mesh's unit or place: it is {2 * mesh.sphere[1]:.4g} mm wide",
            )


def _stations_see(world: World, views: Views, source: str) -> None:
    blind = ~(views.visible == 1).any(axis=1)
    if blind.any():
        name = world.station_name[int(np.argmax(blind))]
        raise TestfieldError(
            "this station sees no target", f"{source}, station '{name}'", "turn it (look_at_mm) or move it"
        )


def _sizes(world: World, views: Views, source: str) -> list[str]:
    coded = world.marks.code > 0
    usable = (views.visible == 1) & (views.obliquity_deg < FACES_DEG)
    largest = np.where(usable, views.diameter_px, 0).max(axis=0)
    warnings = []
    for b, sheet in enumerate(world.field.boards):
        if not (largest[world.marks.board == b] > 0).any():
            warnings.append(f"{source}: board '{sheet.name}' is seen by no station{_why_unseen(world, views, b)}")
    if len(warnings) == len(world.field.boards):
        raise TestfieldError(
            "no station sees any board, so nothing can be calibrated",
            f"{source}, boards",
            warnings[0].removeprefix(f"{source}: "),
        )
    never = np.flatnonzero(largest == 0)
    if len(never):
        whole = f"{len(never)} of {len(coded)} marks are fully seen by no station"
        warnings.append(f"{source}: {whole}: {_named_marks(world, never)}")
    warnings += [f"{source}, {said}" for said in _bars_without_scale(world, usable)]
    small = np.flatnonzero(coded & (largest > 0) & (largest < DECODABLE_PX))
    if len(small):
        k = small[np.argmin(largest[small])]
        panel = world.panels.name[world.marks.panel[k]]
        warnings.append(
            f"{source}: {len(small)} coded targets are too small to decode; code {world.marks.code[k]} on "
            f"'{panel}' is {largest[k]:.1f} px wide at best and needs {DECODABLE_PX:.0f}"
        )
    return warnings


def _named_marks(world: World, marks: np.ndarray) -> str:
    """The first of some marks by their panels, as `'A' (code 3, 12 dots), 'bar' (code 101)`."""
    owners: dict[str, list[int]] = {}
    for code, panel in zip(world.marks.code[marks], world.marks.panel[marks], strict=True):
        owners.setdefault(world.panels.name[panel], []).append(int(code))
    said = []
    for name, codes in list(owners.items())[:NAMED]:
        rings = [_code(code) for code in codes if code > 0]
        dots = len(codes) - len(rings)
        parts = [f"code{'s' * (len(rings) > 1)} {', '.join(rings[:NAMED])}"] if rings else []
        parts += [f"{len(rings) - NAMED} more codes"] if len(rings) > NAMED else []
        parts += [f"{dots} dot{'s' * (dots > 1)} or corner{'s' * (dots > 1)}"] if dots else []
        said.append(f"'{name}' ({', '.join(parts)})")
    more = f" and some of {len(owners) - NAMED} more" if len(owners) > NAMED else ""
    return ", ".join(said) + more


def _code(code: int) -> str:
    return f"{code % TIME} at time {code // TIME}" if code > TIME else str(code)


def _bars_without_scale(world: World, usable: np.ndarray) -> list[str]:
    """Bars of which an end is seen whole by fewer than two stations, (s, n) `usable`: no rays meet there."""
    said: dict[str, str] = {}
    for bar in world.field.scale_bars:
        counts = [int(usable[:, world.marks.code == code].sum()) for code in bar.codes]
        if min(counts) < 2:
            ends = " and ".join(f"code {_code(code)} by {n}" for code, n in zip(bar.codes, counts, strict=True))
            use = "give scale" if bar.role == "control" else "check the scale"
            said[bar.name] = (
                f"scale bar '{bar.name}': it cannot {use}, because no two stations see each of its ends whole "
                f"({ends}); move it or add stations"
            )
    return list(said.values())


def _why_unseen(world: World, views: Views, board: int) -> str:
    """Why no station sees a board, with the field to change; nothing where it is not one of the plain reasons."""
    marks = world.marks.board == board
    depth = world.camera_from_world.R[:, 2] @ world.mark_world_mm[marks].T + world.camera_from_world.t_mm[:, 2:]
    if (views.obliquity_deg[:, marks] >= 90).all():
        return f": it faces away from all of them (boards[{board}].normal)"
    if (depth <= 0).all():
        return f": it lies behind all of them (boards[{board}].position_mm)"
    return ""


def _joined(world: World, views: Views, source: str) -> list[str]:
    if len(world.station_name) < 2:
        raise TestfieldError("one station alone measures nothing", f"{source}, stations", "add a second one")
    boards = len(world.field.boards)
    # Dirt on a few codes of a board leaves the others; how much of it is too much, detection tells.
    whole = (views.visible >= views.clean) & (views.visible > 0)
    coded = whole & (world.marks.code > 0)
    sees = np.array(
        [
            (((coded & on).sum(axis=1) >= LEAST_CODES) | (sheet.pattern is not None))
            & ((whole & on).sum(axis=1) >= LEAST_MARKS)
            for on, sheet in ((world.marks.board == b, sheet) for b, sheet in enumerate(world.field.boards))
        ]
    )
    reached, frontier = {0}, [0]
    while frontier:
        shared = sees[:, sees[frontier.pop()]].any(axis=1)
        fresh = set(np.flatnonzero(shared).tolist()) - reached
        reached |= fresh
        frontier += fresh
    apart = [world.field.boards[b].name for b in range(boards) if b not in reached]
    return [f"{source}: no chain of images joins {', '.join(apart)} to '{world.field.boards[0].name}'"] if apart else []


def _scaled(world: World, source: str) -> list[str]:
    """A word on meshes far larger or smaller than the field."""
    warnings = []
    for k, mesh in enumerate(world.meshes):
        part = 2 * mesh.sphere[1] / world.field_diagonal_mm
        if not SMALL <= part <= LARGE:
            warnings.append(
                f"{source}, meshes[{k}].unit: '{mesh.name}' is {2 * mesh.sphere[1]:.4g} mm wide, {part:.3g} times the "
                "measuring volume's diagonal; is this the unit of the file's coordinates?"
            )
    return warnings
