"""A scene becomes a world: generators run, errors of manufacture are drawn, everything gets its place."""

from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.errors import TestfieldError
from testfield.scene import generators
from testfield.scene.assembly import Assembly, marks_of, panels_of
from testfield.scene.bend import curvature_of, extent_mm
from testfield.scene.board_parts import BoardPart, ExtensionZone, RecognitionZone
from testfield.scene.codes import codes_of
from testfield.scene.frames import along, facing
from testfield.scene.meshes import load_meshes
from testfield.scene.nominal import nominal_board, with_certified_poses
from testfield.scene.room_parts import AreaLightPart, PointLightPart
from testfield.scene.schema import SceneFile
from testfield.scene.sky import sky_of
from testfield.scene.stickers import stickers
from testfield.scene.target_parts import CheckOnBoard
from testfield.scene.true_camera import flash, true_interior, true_motion, true_optics
from testfield.scene.wavy import UNDER_PIECES_MM, marks_off, pieces
from testfield.scene.world import (
    BAR,
    BOARD,
    CHECK,
    MATT,
    AreaLight,
    Dirt,
    Gloss,
    PointLight,
    Print,
    Retro,
    World,
)
from testfield.seeds import Plane, generator, normals
from testfield.targets.camera_sheet import DEFAULT_CAMERA, CameraSheet
from testfield.targets.field import Field, ScaleBar
from testfield.targets.marks import ring_radii

CARD_MARGIN = 0.3
"""By how much a card's half width exceeds the quiet zone, in dot radii."""
BAR_THICKNESS_MM, CARD_THICKNESS_MM = 20.0, 2.0


def build_world(scene: SceneFile, workshop: int | None = None) -> World:
    """The world of a scene. Raises `TestfieldError` for what the schema alone cannot see, naming the field.

    What the sheets know with an uncertainty only (prints, lengths of bars, certified poses) is drawn by the seed
    `workshop` where it is given: the same scene from another workshop.
    """
    seed, made = scene.seed, scene.seed if workshop is None else workshop
    scale_error = 1e-6 * scene.u_print_scale_ppm * normals(made, "print_scale", 1)[0, 0]
    parts, radii, codes = Assembly(scene), ring_radii(scene.code_radii), codes_of(scene)
    bits = scene.code_bits if codes is None else codes.bits

    boards, board_R, board_t, keep_clear = [], [], [], []
    spots: list[tuple] = []
    for k, board in enumerate(scene.boards):
        try:
            R, t = (
                facing(np.array(board.normal), np.radians(board.spin_deg)),
                np.array(board.position_mm, float),
            )
        except ValueError as error:
            raise TestfieldError(str(error), f"boards[{k}].normal") from error
        nominal = nominal_board(board, bits, k)
        axis_rad = np.radians(board.bow_axis_deg)
        curvature = curvature_of(board.bow_mm, extent_mm(board.size_mm, axis_rad))
        if curvature * board.thickness_mm >= 1:
            raise TestfieldError(
                f"value {board.bow_mm}: the board is thicker than its radius of bending",
                f"boards[{k}].bow_mm",
                "lower bow_mm or thickness_mm",
            )
        corners = nominal.has_corners
        off_mm = marks_off(board, len(nominal.marks), k)
        size = (1 + scale_error) * (1 + 1e-6 * board.scale_error_ppm)
        true_xy = nominal.marks.xy_mm * size + nominal.u_xy_mm * _misprints(board, len(nominal.marks), made)
        true_xy = true_xy + off_mm[:, :2]
        wavy = pieces(true_xy, off_mm[:, 2], board.size_mm) if off_mm[:, 2].any() else []
        lowest = min((piece.lowest_mm - UNDER_PIECES_MM for piece in wavy), default=0.0)
        panel = parts.panel(
            board.name,
            R,
            t + lowest * R[:, 2],
            board.size_mm,
            board.thickness_mm,
            board.ink,
            curvature,
            axis_rad,
            corners,
        )
        if nominal.pattern is not None and corners:
            discs = nominal.pattern.discs
            scaled = None if discs is None else discs.scaled(size)
            parts.prints.append(Print(panel, nominal.pattern.cells.scaled(size), scaled))
        for i, xy in enumerate(true_xy):
            on, at = panel, xy
            if wavy:
                on = parts.sticker(f"{board.name} {i}", *wavy[i].placed(R, t), wavy[i].size_mm, board.ink)
                at = wavy[i].mark_mm
            parts.mark(on, at, nominal.marks.diameter_mm[i], int(nominal.marks.code[i]), BOARD, k, i, corners)
        for number, check in enumerate(scene.check_targets):
            if isinstance(check, CheckOnBoard) and check.board == board.name:
                if corners:
                    raise TestfieldError(
                        f"'{board.name}' is a board of squares or tags, on which no target is stuck",
                        f"check_targets[{number}].board",
                        "choose another board, or a card of its own",
                    )
                parts.mark(panel, np.array(check.xy_mm), check.diameter_mm, check.code, CHECK)
            elif isinstance(check, CheckOnBoard) and check.board not in {b.name for b in scene.boards}:
                raise TestfieldError(f"no board is called '{check.board}'", f"check_targets[{number}].board")
        if board.dirt:
            free = np.maximum(np.array(board.size_mm) - board.dirt.diameter_mm, 0) / 2
            rng = generator(seed, f"dirt/{board.name}/{board.dirt.seed}")
            for xy in rng.uniform(-free, free, (board.dirt.count, 2)):
                spots.append((panel, xy, board.dirt.diameter_mm / 2, board.dirt.albedo))
        boards.append(nominal)
        board_R.append(R)
        board_t.append(t)
        keep_clear.append((t, float(np.hypot(*board.size_mm)) * 0.4))

    if scene.certified_poses is not None:
        boards = with_certified_poses(scene, made, boards, Poses(np.array(board_R), np.array(board_t)))

    bars, loose = [], {}
    for k, bar in enumerate(scene.scale_bars):
        try:
            R = along(np.array(bar.direction), np.array(bar.normal))
        except ValueError as error:
            raise TestfieldError(
                f"{error}, or direction and normal are parallel", f"scale_bars[{k}].direction"
            ) from error
        half = (radii.quiet + CARD_MARGIN) * bar.diameter_mm / 2
        panel = parts.panel(
            bar.name,
            R,
            np.array(bar.position_mm, float),
            (bar.length_mm + 2 * half, 2 * half),
            BAR_THICKNESS_MM,
        )
        true_length = bar.length_mm + bar.u_length_mm * normals(made, f"bar/{bar.name}", 1)[0, 0]
        for code, side in zip(bar.codes, (-0.5, 0.5), strict=True):
            parts.mark(panel, np.array([side * true_length, 0]), bar.diameter_mm, code, BAR)
            loose[code] = bar.diameter_mm
        bars.append(ScaleBar(bar.name, bar.role, bar.codes, bar.length_mm, bar.u_length_mm, bool(bar.moves)))
        keep_clear.append((np.array(bar.position_mm), 60.0))

    on_lines, lines = generators.line_cards(scene.measuring_lines, made)
    for code, position, normal, diameter in [*generators.check_cards(scene.check_targets, seed, keep_clear), *on_lines]:
        side = (radii.quiet + CARD_MARGIN) * diameter
        panel = parts.panel(f"check {code}", facing(normal), position, (side, side), CARD_THICKNESS_MM)
        parts.mark(panel, np.zeros(2), diameter, code, CHECK)
    meshes = load_meshes(scene)
    for code, position, normal, diameter in stickers(scene.check_targets, seed, meshes, radii.quiet + CARD_MARGIN):
        side = (radii.quiet + CARD_MARGIN) * diameter
        panel = parts.sticker(f"check {code}", facing(normal), position, (side, side))
        parts.mark(panel, np.zeros(2), diameter, code, CHECK)
    loose |= {code: d for _, _, d, code, role, *_ in parts.marks if role == CHECK}

    carried = len(parts.panels)
    for k, surface in enumerate(scene.room.surfaces):
        try:
            R = facing(np.array(surface.normal))
        except ValueError as error:
            raise TestfieldError(str(error), f"room.surfaces[{k}].normal") from error
        parts.panels.append(
            (
                surface.name,
                R,
                np.array(surface.position_mm, float),
                surface.size_mm,
                surface.albedo,
                surface.albedo,
                0.0,
                0.0,
                MATT,
            )
        )

    lights = tuple(
        AreaLight(
            Poses(facing(np.array(lamp.normal))[None], np.array([lamp.position_mm], float)),
            lamp.size_mm,
            lamp.radiance_w_m2_sr,
        )
        for lamp in scene.room.lights
        if isinstance(lamp, AreaLightPart)
    )
    points = tuple(
        PointLight(np.array(lamp.position_mm, float), lamp.intensity_w_sr)
        for lamp in scene.room.lights
        if isinstance(lamp, PointLightPart)
    )
    sky = None if scene.room.environment is None else sky_of(scene.room.environment, "room.environment", scene.folder)
    names, station_R, station_t = generators.stations(scene.stations, seed)
    field = Field(
        bits,
        tuple(boards),
        tuple(bars),
        loose,
        scene.paint.white_on_black,
        1e-6 * scene.u_print_scale_ppm,
        scene.code_radii,
        measuring_lines=tuple(lines),
        cameras=(CameraSheet(DEFAULT_CAMERA, scene.camera.width_px, scene.camera.height_px, scene.camera.lens),),
        codes=codes,
    )
    return World(
        name=scene.name,
        seed=seed,
        field_diagonal_mm=float(np.linalg.norm(scene.volume.size_mm)),
        panels=panels_of(parts, carried),
        marks=marks_of(parts, radii),
        world_from_board=Poses(np.array(board_R), np.array(board_t)),
        station_name=tuple(names),
        camera_from_world=Poses(station_R, station_t),
        interior=true_interior(scene),
        psf_sigma_px=scene.camera.psf_sigma_px,
        lights=lights,
        ambient_radiance=scene.room.ambient_w_m2_sr if sky is None else 0.0,
        field=field,
        meshes=meshes,
        optics=true_optics(scene),
        motion=true_motion(scene),
        dirt=Dirt(*(np.array(column) for column in zip(*spots, strict=True))) if spots else Dirt(),
        point_lights=points,
        sky=sky,
        flash=flash(scene),
        **_materials(scene),
        prints=tuple(parts.prints),
    )


def _misprints(board: BoardPart, marks: int, made: int) -> np.ndarray:
    """(marks, 2) standard normal deviates of a board's marks, of each zone by row and column: a zone that has one more
    of either, or a target more, leaves the others where they were."""
    if board.pattern is not None:
        return normals(made, f"print/{board.name}/pattern", marks, 2)
    zones: dict[str, RecognitionZone | ExtensionZone]
    zones = {"coded": board.recognition_zone, "dots": board.extension_zone}
    return np.concatenate(
        [
            normals(made, f"print/{board.name}/{name}/listed", zone.count, 2)
            if zone.places_mm is not None
            else Plane(made, f"print/{board.name}/{name}").normals(range(zone.rows), 2 * zone.columns).reshape(-1, 2)
            for name, zone in zones.items()
        ]
    )


def _materials(scene: SceneFile) -> dict[str, Any]:
    """What the inks in use are like; what no board uses is not part of the world."""
    paint, used = scene.paint, {scene.paint.ink, *(board.ink for board in scene.boards)}
    found: dict[str, Any] = {}
    if "retro" in used:
        entrance, observation = np.radians([paint.retro.half_entrance_deg, paint.retro.half_observation_deg]).tolist()
        shift_mm = paint.retro.shift_um_at_40_deg / 1000 / np.sin(np.radians(40))
        found["retro"] = Retro(paint.retro.coefficient_cd_lx_m2, entrance, observation, float(shift_mm))
    if "gloss" in used:
        found["gloss"] = Gloss(paint.gloss.roughness, paint.gloss.reflectance)
    if "luminous" in used:
        found["luminous_radiance"] = paint.luminous.radiance_w_m2_sr
    return found
