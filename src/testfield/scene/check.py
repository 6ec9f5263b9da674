"""What is wrong with a scene before any long work starts: errors stop it, warnings are told."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.project import directions
from testfield.errors import TestfieldError, gather
from testfield.scene.bend import to_paper
from testfield.scene.blur import blur_circles_px, streaks_px
from testfield.scene.board_parts import BoardPart
from testfield.scene.check_patterns import check_patterns, pattern_warnings
from testfield.scene.exposure import check_exposure
from testfield.scene.meshes import inside
from testfield.scene.parts import ScenePart
from testfield.scene.room_parts import MeshPart, SurfacePart
from testfield.scene.schema import SceneFile
from testfield.scene.target_parts import MeasuringLinePart, ScaleBarPart
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.targets.ring_code import code_words

DECODABLE_PX = 8.0
FACES_DEG = 75.0
NARROWEST_PX, NARROWEST_AIRY_PX = 0.1, 0.25
LONGEST_STREAK_PX = 200.0
LEAST_CODES, LEAST_MARKS = 2, 8
"""What an image must show of a board to tell where it is."""
BLURRED = 0.7
"""Blur circle over diameter above which a target is hardly measured."""
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
        found += _possible(part.scene, own, said) + _focused(part.scene, own, seen, said)
    _see(world, views, source)
    found += _sizes(world, views, source) + _joined(world, views, source) + _scaled(world, source)
    return list(dict.fromkeys(found + pattern_warnings(world, views, source)))


def check_scene(scene: SceneFile, world: World, views: Views, source: str) -> list[str]:
    """Warnings, one sentence each. Raises `TestfieldError` for all that makes the scene impossible."""
    unlit = _possible(scene, world, source, lambda: _see(world, views, source))
    blurred = _focused(scene, world, views, source)
    found = _sizes(world, views, source) + _joined(world, views, source) + unlit + blurred + _scaled(world, source)
    return found + pattern_warnings(world, views, source)


def _see(world: World, views: Views, source: str) -> None:
    gather(lambda: _stations_stand_free(world, source), lambda: _stations_see(world, views, source))


def _possible(scene: SceneFile, world: World, source: str, look: Callable[[], None] = lambda: None) -> list[str]:
    """Warnings on the light. Raises `TestfieldError` for all that one camera's scene cannot be; `look` comes before."""
    gather(
        lambda: _possible_optics(scene, world, source),
        lambda: _visible_paint(scene, source),
        lambda: _bendable_ink(scene, source),
        lambda: _unique_names(scene, source),
        lambda: _codes_exist_and_differ(scene, world, source),
        lambda: check_patterns(scene, world, source),
        lambda: _marks_fit(scene, world, source),
        look,
    )
    return _lit(scene, source) + check_exposure(scene, world, source)


def _possible_optics(scene: SceneFile, world: World, source: str) -> None:
    edge = world.interior.corners_px
    rim = np.concatenate([np.linspace(a, b, 20) for a, b in zip(edge, np.roll(edge, -1, axis=0), strict=True)])
    if not np.isfinite(directions(world.interior, rim)).all():
        worst = {name: getattr(scene.camera, name) for name in world.interior.names[4:] if getattr(scene.camera, name)}
        raise TestfieldError(
            f"the distortion ({', '.join(f'{k} = {v}' for k, v in worst.items())}) folds back within the image",
            f"{source}, camera", "weaken it, or lengthen focal_length_mm",
        )  # fmt: skip
    blur = scene.camera.psf_sigma_px
    if 0 < blur < NARROWEST_PX:
        raise TestfieldError(
            f"value {blur} is narrower than can be resolved",
            f"{source}, camera.psf_sigma_px",
            f"give 0, or {NARROWEST_PX} or more",
        )
    if 0 < world.optics.airy_px < NARROWEST_AIRY_PX:
        raise TestfieldError(
            f"wavelength x f-number is {world.optics.airy_px:.2f} px, finer than can be resolved",
            f"{source}, camera.diffraction", "set it to false: the pixel's own area is far larger",
        )  # fmt: skip
    if world.motion.target.moves and scene.render.mode == "path":
        raise TestfieldError(
            "render.mode = 'path' carries no moving target", f"{source}, target_motion",
            "move the camera instead (camera.motion), or set render.mode = 'fast'",
        )  # fmt: skip
    focus = scene.camera.focus_mm
    if focus is not None and focus <= scene.camera.focal_length_mm:
        raise TestfieldError(
            f"value {focus} is not in front of the lens' focal plane", f"{source}, camera.focus_mm",
            "give the distance of what is to be sharp, in mm",
        )  # fmt: skip
    v1, v2, v3 = scene.camera.vignetting
    r2 = np.linspace(0, 1, 101) ** 2
    least = float((1 + r2 * (v1 + r2 * (v2 + r2 * v3))).min())
    if least <= 0:
        raise TestfieldError(
            f"value {list(scene.camera.vignetting)} leaves less than no light ({least:.2f}) within the image",
            f"{source}, camera.vignetting", "weaken it: 1 + v1 r^2 + v2 r^4 + v3 r^6 must stay positive to r = 1",
        )  # fmt: skip
    if scene.exposure.shutter == "global" and scene.exposure.row_time_us:
        raise TestfieldError(
            "all rows of a global shutter are exposed at once", f"{source}, exposure.row_time_us",
            'leave it out, or set shutter = "rolling"',
        )  # fmt: skip
    if scene.exposure.shutter == "rolling" and not scene.exposure.row_time_us:
        raise TestfieldError(
            "a rolling shutter whose rows take no time is a global one", f"{source}, exposure.row_time_us",
            "give the time a row takes to read, as 10",
        )  # fmt: skip
    stations = range(len(world.camera_from_world))
    longest = max(float(np.nan_to_num(streaks_px(world, s)).max(initial=0)) for s in stations)
    if longest > LONGEST_STREAK_PX:
        raise TestfieldError(
            f"the motion during the exposure smears targets over {longest:.0f} px",
            f"{source}, exposure.time_ms", "shorten it, or slow the motion down",
        )  # fmt: skip


def _bendable_ink(scene: SceneFile, source: str) -> None:
    """Coats and shining ink on a bent board would show the facets of its proxy mesh, not the cylinder."""
    for k, board in enumerate(scene.boards):
        ink = board.ink or scene.paint.ink
        if board.bow_mm and ink in ("gloss", "luminous"):
            raise TestfieldError(
                f"a bent board ({board.bow_mm} mm) cannot be printed with {ink} ink", f"{source}, boards[{k}].bow_mm",
                "set it to 0, or choose matt or retro ink",
            )  # fmt: skip


def _visible_paint(scene: SceneFile, source: str) -> None:
    paint, inks = scene.paint, {scene.paint.ink, *(board.ink for board in scene.boards)}
    if paint.white <= paint.black:
        raise TestfieldError(
            f"white ({scene.paint.white}) is not brighter than black ({scene.paint.black})", f"{source}, paint.white",
            "raise it; for black marks on white set paint.white_on_black = false",
        )  # fmt: skip
    for ink in ("retro", "luminous"):
        if ink in inks and not paint.white_on_black:
            raise TestfieldError(
                f"ink '{ink}' with white_on_black = false: the ink would be the black", f"{source}, paint.ink",
                "set paint.white_on_black = true, or choose matt or gloss",
            )  # fmt: skip
    if "retro" in inks:
        returned = retro_reflectance(paint.retro.coefficient_cd_lx_m2, paint.retro.half_observation_deg)
        if paint.retro.matt + returned > 1:
            raise TestfieldError(
                f"value {paint.retro.coefficient_cd_lx_m2}: with half_observation_deg = "
                f"{paint.retro.half_observation_deg} it returns {returned:.2f} of the light, with matt = "
                f"{paint.retro.matt} more than falls on it", f"{source}, paint.retro.coefficient_cd_lx_m2", "lower one",
            )  # fmt: skip
    for what, asked in (
        ("a target that moves", scene.target_motion is not None), ("diffraction", scene.camera.diffraction),
    ):  # fmt: skip
        if "gloss" in inks and asked:
            raise TestfieldError(
                f"glossy ink cannot be rendered together with {what}", f"{source}, paint.ink",
                "choose another ink, or leave out target_motion and camera.diffraction",
            )  # fmt: skip


def retro_reflectance(coefficient: float, half_observation_deg: float) -> float:
    """Part of the light at normal entrance that the retro-reflecting lobe returns: its integral over directions."""
    return float(coefficient * np.pi * np.radians(half_observation_deg) ** 2 / np.log(2))


def _unique_names(scene: SceneFile, source: str) -> None:
    groups: dict[str, tuple[BoardPart | ScaleBarPart | MeasuringLinePart | SurfacePart | MeshPart, ...]] = {
        "boards": scene.boards,
        "scale_bars": scene.scale_bars,
        "measuring_lines": scene.measuring_lines,
        "room.surfaces": scene.room.surfaces,
        "meshes": scene.meshes,
    }
    owners: dict[str, str] = {}
    for label, parts in groups.items():
        for k, part in enumerate(parts):
            where = f"{label}[{k}]"
            if part.name in owners:
                raise TestfieldError(
                    f"'{part.name}' is also the name of {owners[part.name]}", f"{source}, {where}.name", "rename one"
                )
            owners[part.name] = where


def _codes_exist_and_differ(scene: SceneFile, world: World, source: str) -> None:
    last = len(code_words(scene.code_bits))
    owners: dict[int, str] = {}
    for code, panel in zip(world.marks.code, world.marks.panel, strict=True):
        if code == 0:
            continue
        owner = world.panels.name[panel]
        if code > last:
            raise TestfieldError(
                f"code number {code} does not exist",
                f"{source}, {owner}",
                f"{scene.code_bits}-bit codes are numbered 1 to {last}",
            )
        if code in owners:
            raise TestfieldError(
                f"code number {code} is used twice",
                f"{source}, {owners[code]} and {owner}",
                "choose another number",
            )
        owners[int(code)] = owner


def _marks_fit(scene: SceneFile, world: World, source: str) -> None:
    for k, board in enumerate(world.field.boards):
        if board.pattern is not None and (2 * board.pattern.half_mm > scene.boards[k].size_mm).any():
            need = " x ".join(f"{v:g}" for v in 2 * board.pattern.half_mm)
            raise TestfieldError(
                f"the pattern is {need} mm and reaches over the edge", f"{source}, boards[{k}].size_mm", "enlarge it"
            )
    marks = world.marks
    printed = marks.printed_radius_mm
    quiet = marks.diameter_mm / 2 * np.where(marks.code > 0, marks.radii.quiet, 1.2)
    for k in np.unique(marks.panel):
        here = np.flatnonzero((marks.panel == k) & ~marks.corner)
        if len(here) == 0:
            continue
        over = np.abs(marks.xy_mm[here]) + printed[here, None] > world.panels.size_mm[k] / 2
        if over.any():
            at = marks.xy_mm[here[np.argmax(over.any(axis=1))]]
            raise TestfieldError(
                f"a mark at ({at[0]:.1f}, {at[1]:.1f}) mm reaches over the edge", f"{source}, {world.panels.name[k]}",
                "enlarge size_mm, or move or shrink the zone",
            )  # fmt: skip
        pair = _too_close(marks.xy_mm[here], quiet[here], printed[here])
        if pair is not None:
            a, b = marks.xy_mm[here[list(pair)]]
            raise TestfieldError(
                f"marks at ({a[0]:.1f}, {a[1]:.1f}) and ({b[0]:.1f}, {b[1]:.1f}) mm are too close",
                f"{source}, {world.panels.name[k]}",
                "leave each coded target its quiet zone of 3.9 dot radii",
            )  # fmt: skip


def _too_close(xy_mm: np.ndarray, quiet_mm: np.ndarray, printed_mm: np.ndarray) -> tuple[int, int] | None:
    """Two of n marks of which one is printed into the other's quiet zone, the first such pair; None where none is."""
    if len(xy_mm) < 2:
        return None
    tree = cKDTree(xy_mm)
    # Where each mark's nearest keeps off, only so many others can be near; without this there might be all pairs.
    nearest = tree.query(xy_mm, k=2)[1]
    first = nearest[np.arange(len(xy_mm)), (nearest[:, 0] == np.arange(len(xy_mm))).astype(int)]
    for near in (np.column_stack([np.arange(len(xy_mm)), first]), None):
        pairs = tree.query_pairs((quiet_mm + printed_mm).max(), output_type="ndarray") if near is None else near
        i, j = np.sort(pairs, axis=1).T
        need = np.maximum(quiet_mm[i] + printed_mm[j], printed_mm[i] + quiet_mm[j])
        bad = np.linalg.norm(xy_mm[i] - xy_mm[j], axis=1) < need
        if bad.any():
            i, j = i[bad], j[bad]
            k = np.lexsort([j, i])[0]
            return int(i[k]), int(j[k])
    return None


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
            )  # fmt: skip
    for mesh in world.meshes:
        within = inside(mesh, eyes)
        if within.any():
            s = int(np.argmax(within))
            where = ", ".join(str(round(v)) for v in eyes[s])
            raise TestfieldError(
                f"the camera at ({where}) mm is inside the mesh '{mesh.name}'",
                f"{source}, station '{world.station_name[s]}'",
                f"move position_mm out of it, or mend the mesh's unit or place: it is {2 * mesh.sphere[1]:.4g} mm wide",
            )  # fmt: skip


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
            "no station sees any board, so nothing can be calibrated", f"{source}, boards",
            warnings[0].removeprefix(f"{source}: "),
        )  # fmt: skip
    never = np.flatnonzero(largest == 0)
    if len(never):
        warnings.append(f"{source}: {len(never)} of {len(coded)} marks are fully seen by no station")
    small = np.flatnonzero(coded & (largest > 0) & (largest < DECODABLE_PX))
    if len(small):
        k = small[np.argmin(largest[small])]
        panel = world.panels.name[world.marks.panel[k]]
        warnings.append(
            f"{source}: {len(small)} coded targets are too small to decode; code {world.marks.code[k]} on "
            f"'{panel}' is {largest[k]:.1f} px wide at best and needs {DECODABLE_PX:.0f}"
        )
    return warnings


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


def _focused(scene: SceneFile, world: World, views: Views, source: str) -> list[str]:
    """A word where most of what is seen is out of focus."""
    if not world.optics.aperture_mm:
        return []
    circle = np.array([blur_circles_px(world, s) for s in range(len(world.station_name))])
    seen = views.visible == 1
    blurred = float((circle[seen] > BLURRED * views.diameter_px[seen]).mean()) if seen.any() else 0.0
    if blurred < 0.5:
        return []
    return [
        f"{source}, camera.focus_mm = {scene.camera.focus_mm:g}: {100 * blurred:.0f} % of the marks seen are out of "
        f"focus; blur circles are {np.median(circle[seen]):.0f} px wide"
    ]


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


def _lit(scene: SceneFile, source: str) -> list[str]:
    room, flash = scene.room, scene.camera.flash
    inks = {scene.paint.ink, *(board.ink for board in scene.boards)}
    flashes = flash is not None and flash.on
    around = room.environment is not None or room.ambient_w_m2_sr > 0
    if not room.lights and not around and not flashes and "luminous" not in inks:
        raise TestfieldError(
            "the scene has no light", f"{source}, room",
            "add room.lights, ambient_w_m2_sr, an environment, or camera.flash",
        )  # fmt: skip
    if "retro" in inks and not flashes:
        return [f"{source}: retro-reflective ink is seen without camera.flash, so it is no brighter than matt ink"]
    return []
