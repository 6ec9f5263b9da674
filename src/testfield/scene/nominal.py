"""What the sheets say of boards: their layouts, and certified poses with their errors."""

from dataclasses import replace

import numpy as np

from testfield.camera.pose import Poses, rotation, rotation_vector
from testfield.errors import TestfieldError
from testfield.scene.board_parts import BoardPart, ExtensionZone, RecognitionZone
from testfield.scene.schema import SceneFile
from testfield.seeds import normals
from testfield.targets.field import CertifiedPose, NominalBoard
from testfield.targets.marks import Marks


def with_certified_poses(scene: SceneFile, made: int, boards: list[NominalBoard], true: Poses) -> list[NominalBoard]:
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


def nominal_board(board: BoardPart, bits: int, index: int) -> NominalBoard:
    """What the certificate of a sub-board says: coded targets first, then the plain dots; or its pattern's points."""
    if board.pattern is not None:
        printed = board.pattern.pattern
        marks = Marks(printed.points_mm, printed.diameters_mm, np.zeros(len(printed.points_mm), int), bits)
        u_xy_mm = 0.0 if printed.has_corners else board.print_sigma_mm
        return NominalBoard(board.name, marks, u_xy_mm, 0.0, printed, board.size_mm)
    zone = board.recognition_zone
    count = zone.count
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
    if zone.places_mm is not None:
        return np.array(zone.places_mm, float) + zone.centre_mm
    x = (np.arange(zone.columns) - (zone.columns - 1) / 2) * zone.pitch_mm + zone.centre_mm[0]
    y = ((zone.rows - 1) / 2 - np.arange(zone.rows)) * zone.pitch_mm + zone.centre_mm[1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
