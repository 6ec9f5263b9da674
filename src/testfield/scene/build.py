"""A scene becomes a world: generators run, errors of manufacture are drawn, everything gets its place."""

from dataclasses import replace
from typing import Any

import numpy as np

from testfield.camera.interior import Interior, parameter_names
from testfield.camera.lens import all_coefficients
from testfield.camera.motion import Motion, Twist
from testfield.camera.optics import Optics, entrance_pupil_mm
from testfield.camera.pose import Poses, rotation, rotation_vector
from testfield.errors import TestfieldError
from testfield.scene import generators
from testfield.scene.bend import curvature_of, extent_mm
from testfield.scene.board_parts import BoardPart, ExtensionZone, RecognitionZone
from testfield.scene.camera_parts import MotionPart, TargetMotionPart
from testfield.scene.fields import Ink
from testfield.scene.frames import along, facing
from testfield.scene.meshes import load_meshes
from testfield.scene.room_parts import AreaLightPart, PointLightPart
from testfield.scene.schema import SceneFile
from testfield.scene.sky import sky_of
from testfield.scene.stickers import stickers
from testfield.scene.target_parts import CheckOnBoard
from testfield.scene.world import (
    BAR,
    BOARD,
    CHECK,
    INKS,
    MATT,
    AreaLight,
    Dirt,
    Gloss,
    Panels,
    PointLight,
    Print,
    Retro,
    RingFlash,
    TrueMarks,
    World,
)
from testfield.seeds import Plane, generator, normals
from testfield.targets.camera_sheet import DEFAULT_CAMERA, CameraSheet
from testfield.targets.field import CertifiedPose, Field, NominalBoard, ScaleBar
from testfield.targets.marks import RADII, Marks, RingRadii

CARD_MARGIN = 0.3
"""By how much a card's half width exceeds the quiet zone, in dot radii."""
BAR_THICKNESS_MM, CARD_THICKNESS_MM = 20.0, 2.0


class _Assembly:
    """Panels and marks while a world is put together."""

    def __init__(self, scene: SceneFile):
        paint = scene.paint
        self.black, self.white, self.back = paint.black, paint.white, paint.back
        self.white_on_black = paint.white_on_black
        self.ink, self.retro_matt = paint.ink, paint.retro.matt
        self.panels: list[tuple] = []
        self.marks: list[tuple] = []
        self.prints: list[Print] = []

    def panel(
        self,
        name: str,
        R: np.ndarray,
        t: np.ndarray,
        size: tuple,
        thickness: float,
        made_of: Ink | None = None,
        curvature: float = 0.0,
        axis_rad: float = 0.0,
        black_on_white: bool = False,
    ) -> int:
        """A printed front and its plain back, bent alike; returns the front's index. The rest as in `sticker`."""
        front = self.sticker(name, R, t, size, made_of, curvature, axis_rad, black_on_white)
        behind = np.column_stack([-R[:, 0], R[:, 1], -R[:, 2]])
        # The back is bent about the same axis in space, so it is that much shorter (or longer) across it.
        shrink = 1 - thickness * curvature
        across = np.array([np.sin(axis_rad), np.cos(axis_rad)]) ** 2
        back_size = np.array(size) * (1 + (shrink - 1) * across)
        self.panels.append(
            (f"{name} (back)", behind, t - thickness * R[:, 2], back_size, self.back, self.back,
             -curvature / shrink, np.pi - axis_rad, MATT)
        )  # fmt: skip
        return front

    def sticker(
        self,
        name: str,
        R: np.ndarray,
        t: np.ndarray,
        size: tuple,
        made_of: Ink | None = None,
        curvature: float = 0.0,
        axis_rad: float = 0.0,
        black_on_white: bool = False,
    ) -> int:
        """A printed front alone; returns its index. `made_of` is the ink, paint.ink if None.

        `black_on_white`: whatever the scene's paint is.
        """
        white_on_black = self.white_on_black and not black_on_white
        ground, ink = (self.black, self.white) if white_on_black else (self.white, self.black)
        made_of = made_of or self.ink
        ink = self.retro_matt if made_of == "retro" else ink
        self.panels.append((name, R, t, size, ground, ink, curvature, axis_rad, INKS.index(made_of)))
        return len(self.panels) - 1

    def mark(
        self,
        panel: int,
        xy: np.ndarray,
        diameter: float,
        code: int,
        role: int,
        board: int = -1,
        point: int = -1,
        corner: bool = False,
    ) -> None:
        """One mark at its true place on a panel."""
        self.marks.append((panel, xy, diameter, code, role, board, point, corner))


def build_world(scene: SceneFile, workshop: int | None = None) -> World:
    """The world of a scene. Raises `TestfieldError` for what the schema alone cannot see, naming the field.

    What the sheets know with an uncertainty only (prints, lengths of bars, certified poses) is drawn by the seed
    `workshop` where it is given: the same scene from another workshop.
    """
    seed, made = scene.seed, scene.seed if workshop is None else workshop
    scale_error = 1e-6 * scene.u_print_scale_ppm * normals(made, "print_scale", 1)[0, 0]
    parts, radii = _Assembly(scene), RADII[scene.code_radii]

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
        nominal = nominal_board(board, scene.code_bits, k)
        axis_rad = np.radians(board.bow_axis_deg)
        curvature = curvature_of(board.bow_mm, extent_mm(board.size_mm, axis_rad))
        if curvature * board.thickness_mm >= 1:
            raise TestfieldError(
                f"value {board.bow_mm}: the board is thicker than its radius of bending", f"boards[{k}].bow_mm",
                "lower bow_mm or thickness_mm",
            )  # fmt: skip
        corners = nominal.has_corners
        size = (1 + scale_error) * (1 + 1e-6 * board.scale_error_ppm)
        panel = parts.panel(
            board.name, R, t, board.size_mm, board.thickness_mm, board.ink, curvature, axis_rad, corners
        )  # fmt: skip
        if nominal.pattern is not None and corners:
            parts.prints.append(Print(panel, nominal.pattern.cells.scaled(size)))
        true_xy = nominal.marks.xy_mm * size + nominal.u_xy_mm * _misprints(board, len(nominal.marks), made)
        for i, xy in enumerate(true_xy):
            parts.mark(panel, xy, nominal.marks.diameter_mm[i], int(nominal.marks.code[i]), BOARD, k, i, corners)
        for number, check in enumerate(scene.check_targets):
            if isinstance(check, CheckOnBoard) and check.board == board.name:
                if corners:
                    raise TestfieldError(
                        f"'{board.name}' is a board of squares or tags, on which no target is stuck",
                        f"check_targets[{number}].board", "choose another board, or a card of its own",
                    )  # fmt: skip
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
        boards = _with_certified_poses(scene, made, boards, Poses(np.array(board_R), np.array(board_t)))

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
    for code, position, normal, diameter in [
        *generators.check_cards(scene.check_targets, seed, keep_clear), *on_lines
    ]:  # fmt: skip
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
        scene.code_bits,
        tuple(boards),
        tuple(bars),
        loose,
        scene.paint.white_on_black,
        1e-6 * scene.u_print_scale_ppm,
        scene.code_radii,
        measuring_lines=tuple(lines),
        cameras=(CameraSheet(DEFAULT_CAMERA, scene.camera.width_px, scene.camera.height_px, scene.camera.lens),),
    )
    return World(
        scene.name, seed, float(np.linalg.norm(scene.volume.size_mm)), _panels(parts, carried), _marks(parts, radii),
        Poses(np.array(board_R), np.array(board_t)), tuple(names), Poses(station_R, station_t), true_interior(scene),
        scene.camera.psf_sigma_px, lights, scene.room.ambient_w_m2_sr if sky is None else 0.0, field, meshes,
        true_optics(scene), true_motion(scene),
        Dirt(*(np.array(column) for column in zip(*spots, strict=True))) if spots else Dirt(),
        points, sky, _flash(scene), **_materials(scene), prints=tuple(parts.prints),
    )  # fmt: skip


def _misprints(board: BoardPart, marks: int, made: int) -> np.ndarray:
    """(marks, 2) standard normal deviates of a board's marks, of each zone by row and column: a zone that has one more
    of either, or a target more, leaves the others where they were."""
    if board.pattern is not None:
        return normals(made, f"print/{board.name}/pattern", marks, 2)
    zones: dict[str, RecognitionZone | ExtensionZone]
    zones = {"coded": board.recognition_zone, "dots": board.extension_zone}
    return np.concatenate([
        Plane(made, f"print/{board.name}/{name}").normals(range(zone.rows), 2 * zone.columns).reshape(-1, 2)
        for name, zone in zones.items()
    ])  # fmt: skip


def _with_certified_poses(scene: SceneFile, made: int, boards: list[NominalBoard], true: Poses) -> list[NominalBoard]:
    """The sheets of the boards with what a certificate says of their poses in the frame of the first."""
    part = scene.certified_poses
    assert part is not None
    u_turn = float(np.radians(part.u_rotation_deg))
    first = Poses(np.repeat(true.R[:1], len(boards), 0), np.repeat(true.t_mm[:1], len(boards), 0))
    relative = first.inverse().after(true)
    certified = [boards[0]]
    for k, board in enumerate(boards[1:], 1):
        drawn = normals(made, f"certified_pose/{board.name}", 6)[:, 0]
        R = rotation(u_turn * drawn[:3]) @ relative.R[k]
        x, y, z = rotation_vector(R[None])[0].tolist()
        t = (relative.t_mm[k] + part.u_position_mm * drawn[3:]).tolist()
        pose = CertifiedPose((x, y, z), (t[0], t[1], t[2]), u_turn, part.u_position_mm)
        certified.append(replace(board, pose=pose))
    return certified


def _flash(scene: SceneFile) -> RingFlash | None:
    part = scene.camera.flash
    if part is None or not part.on:
        return None
    return RingFlash(part.radius_mm, part.points, part.radiant_intensity_w_sr, part.falloff_exponent)


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


def true_interior(scene: SceneFile) -> Interior:
    """The camera's true interior orientation in px."""
    camera = scene.camera
    focal = 1000 * camera.focal_length_mm / camera.pixel_pitch_um
    middle = ((camera.width_px - 1) / 2, (camera.height_px - 1) / 2)
    cx, cy = (m + offset for m, offset in zip(middle, camera.principal_point_offset_px, strict=True))
    names = parameter_names(camera.lens)
    for name in all_coefficients() - set(names):
        if getattr(camera, name, 0) != 0:
            raise TestfieldError(
                f"value {getattr(camera, name)}: the lens model '{camera.lens}' has no such coefficient",
                f"camera.{name}",
                f"its coefficients are {', '.join(names[4:])}",
            )  # fmt: skip
    values = [focal, focal * camera.aspect, cx, cy, *[getattr(camera, name) for name in names[4:]]]
    return Interior(camera.width_px, camera.height_px, np.array(values, float), camera.lens, _residual_field(scene))


def true_optics(scene: SceneFile) -> Optics:
    """What the lens does besides bending light."""
    camera = scene.camera
    airy_um = 1e-3 * scene.sensor.wavelength_nm * camera.f_number
    return Optics(
        0.0 if camera.focus_mm is None
        else entrance_pupil_mm(camera.focal_length_mm, camera.f_number, camera.focus_mm),
        camera.focus_mm or 0.0,
        airy_um / camera.pixel_pitch_um if camera.diffraction else 0.0,
        camera.vignetting,
        camera.natural_vignetting,
    )  # fmt: skip


def true_motion(scene: SceneFile) -> Motion:
    """What moves while the shutter is open."""

    def twist(part: MotionPart | None) -> Twist:
        if part is None:
            return Twist()
        x, y, z = np.radians(part.angular_velocity_deg_s).tolist()
        about = part.about_mm if isinstance(part, TargetMotionPart) else (0.0, 0.0, 0.0)
        return Twist(part.velocity_mm_s, (x, y, z), about)

    exposure = scene.exposure
    row_s = 1e-6 * exposure.row_time_us if exposure.shutter == "rolling" else 0.0
    return Motion(twist(scene.camera.motion), twist(scene.target_motion), 1e-3 * exposure.time_ms, row_s)


def _residual_field(scene: SceneFile) -> np.ndarray | None:
    """(2, d, d) Chebyshev coefficients: random, smaller at higher degree, without what pinhole parameters take up."""
    part = scene.camera.residual_field
    if part is None or part.rms_px == 0:
        return None
    order = np.add.outer(np.arange(part.degree), np.arange(part.degree))
    planes = (Plane(scene.seed, f"residual_field/{part.seed}/{axis}") for axis in "xy")
    drawn = np.array([plane.normals(range(part.degree), part.degree) for plane in planes])
    field = np.where(order < 2, 0.0, drawn / np.maximum(order, 1) ** 1.5)
    at = np.linspace(-1, 1, 41)
    values = [np.polynomial.chebyshev.chebgrid2d(at, at, c) for c in field]
    return field * part.rms_px / np.sqrt(np.mean(np.square(values).sum(axis=0)))


def nominal_board(board: BoardPart, bits: int, index: int) -> NominalBoard:
    """What the certificate of a sub-board says: coded targets first, then the plain dots; or its pattern's points."""
    if board.pattern is not None:
        printed = board.pattern.pattern
        n = len(printed.points_mm)
        marks = Marks(printed.points_mm, np.full(n, printed.free_mm), np.zeros(n, int), bits)
        u_xy_mm = 0.0 if printed.has_corners else board.print_sigma_mm
        return NominalBoard(board.name, marks, u_xy_mm, 0.0, printed, board.size_mm)
    zone = board.recognition_zone
    count = zone.columns * zone.rows
    if zone.codes is not None and zone.first_code is not None:
        raise TestfieldError(
            "both codes and first_code are given", f"boards[{index}].recognition_zone", "give one of them"
        )
    if zone.codes is None and zone.first_code is None:
        raise TestfieldError(
            "neither codes nor first_code is given", f"boards[{index}].recognition_zone", "give one of them"
        )
    if zone.codes is not None and len(zone.codes) != count:
        raise TestfieldError(
            f"{len(zone.codes)} numbers for {count} targets",
            f"boards[{index}].recognition_zone.codes",
            f"give {count}",
        )
    codes = np.array(zone.codes) if zone.codes is not None else int(zone.first_code or 0) + np.arange(count)
    coded = Marks(_grid(zone), np.full(count, zone.diameter_mm), codes, bits)
    dots_xy = _grid(board.extension_zone)
    dots = Marks(dots_xy, np.full(len(dots_xy), board.extension_zone.diameter_mm), np.zeros(len(dots_xy), int), bits)
    return NominalBoard(board.name, Marks.join([coded, dots]), board.print_sigma_mm, 0.0)


def _grid(zone: ExtensionZone | RecognitionZone) -> np.ndarray:
    x = (np.arange(zone.columns) - (zone.columns - 1) / 2) * zone.pitch_mm + zone.centre_mm[0]
    y = ((zone.rows - 1) / 2 - np.arange(zone.rows)) * zone.pitch_mm + zone.centre_mm[1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _panels(parts: _Assembly, carried: int) -> Panels:
    """All panels, the first `carried` of which belong to the target and the rest to the room."""
    name, R, t, size, *rest = zip(*parts.panels, strict=True)
    ground, ink, curvature, axis, made_of = (np.array(column) for column in rest)
    of_room = np.arange(len(name)) >= carried
    poses, kinds = Poses(np.array(R), np.array(t)), made_of if made_of.any() else None
    return Panels(name, poses, np.array(size, float), ground, ink, curvature, axis, of_room, kinds)


def _marks(parts: _Assembly, radii: RingRadii) -> TrueMarks:
    panel, xy, diameter, *rest = zip(*parts.marks, strict=True)
    code, role, board, point, corner = (np.array(v, int) for v in rest)
    return TrueMarks(
        np.array(panel), np.array(xy, float), np.array(diameter, float), code, role, board, point, radii,
        corner.astype(bool),
    )  # fmt: skip
