"""The boards that calibrate a camera by their print, as parts of a scene: checkerboards, ChArUco, grids of circles."""

from typing import Any

import cv2
import numpy as np

from testfield.author.twin_shape import shape_of
from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.measure.patterns import Pattern, board_pattern
from testfield.scene.frames import facing
from testfield.targets.board_pattern import BoardPattern

SCENE_KINDS = ("checkerboard", "charuco", "circles", "acircles", "hexcircles")
"""Boards of which a scene has the print, and whose edges tell the light and the blur."""
LEAST_OFF = 2.0
"""How many standard uncertainties marks must lie off their places, rms, before it is said."""


def pattern_boards(
    calibration: Calibration,
    observations: Observations,
    patterns: tuple[Pattern, ...],
    notes: list[str],
    hold: tuple[str, ...],
) -> tuple[Calibration, dict[str, Any], tuple[np.ndarray, float, float]]:
    """The camera that belongs to the boards (to their shapes, where those were found), the boards of a scene, and the
    plane of the first: normal, offset, extent.

    Raises `TestfieldError` for boards that scenes, or twins, do not have.
    """
    for one in patterns:
        if one.target.kind not in SCENE_KINDS:
            raise TestfieldError(
                f"boards of kind '{one.target.kind}' have no twin yet", one.name, f"{', '.join(SCENE_KINDS)} have"
            )
    parts, extent = [], 0.0
    single = len(calibration.board_names) == 1 and not calibration.more_cameras
    for b, one in enumerate(patterns):
        if one.name not in calibration.board_names:
            notes.append(f"'{one.name}' was not calibrated and is left out")
            continue
        shown = _as_shown(one, observations, b)
        place = calibration.board_names.index(one.name)
        R, t = calibration.boards.R[place], calibration.boards.t_mm[place]
        size = 2 * shown.half_mm + shown.pitch_mm
        part = _part(one.name, shown, R, t, size)
        if single:
            calibration = _shaped(part, shown, calibration, observations, notes, hold)
        parts.append(part)
        extent = max(extent, float(np.max(size)))
    if not parts:
        raise TestfieldError("no board was calibrated", "calibration.json", "measure again")
    normal = np.array(parts[0]["normal"])
    return calibration, {"boards": parts}, (normal, float(normal @ np.array(parts[0]["position_mm"])), extent)


def _part(name: str, shown: BoardPattern, R: np.ndarray, t: np.ndarray, size: np.ndarray) -> dict[str, Any]:
    upright = facing(R[:, 2])
    pattern: dict[str, Any] = {"kind": shown.kind, "columns": shown.columns, "rows": shown.rows}
    if shown.has_corners:
        pattern["square_mm"] = shown.pitch_mm
    else:
        pattern |= {"pitch_mm": shown.pitch_mm, "diameter_mm": shown.mark_mm}
    if shown.kind == "charuco":
        pattern |= {"marker_mm": shown.mark_mm, "dictionary": shown.names, "first_tag": shown.first_tag}
    return {
        "name": name.replace(":", "-"),
        "size_mm": size.tolist(),
        "position_mm": t.tolist(),
        "normal": R[:, 2].tolist(),
        "spin_deg": float(np.degrees(np.arctan2(R[:, 0] @ upright[:, 1], R[:, 0] @ upright[:, 0]))),
        "pattern": pattern,
    }


def _shaped(
    part: dict[str, Any],
    shown: BoardPattern,
    calibration: Calibration,
    observations: Observations,
    notes: list[str],
    hold: tuple[str, ...],
) -> Calibration:
    """The camera and the stations that belong to the board's own shape; circles get their true places in `part`, of
    corners it is said how far they are off, for their lines are printed in one piece."""
    flat = np.column_stack([shown.points_mm, np.zeros(len(shown.points_mm))])
    shape = shape_of(calibration, observations, flat, hold)
    if shape is None:
        return calibration
    off, u = np.sqrt((shape.off_mm**2).mean(axis=0)), shape.u_mm
    if (off < LEAST_OFF * u).all():
        return calibration
    said = f"{np.hypot(off[0], off[1]) / np.sqrt(2):.2g} mm in the plane and {off[2]:.2g} mm in height (rms)"
    if shown.has_corners:
        notes.append(f"corners lie off their places by {said}; left out: a scene prints squares in one flat piece")
        return calibration
    part |= {"marks_off_mm": shape.off_mm.tolist(), "print_sigma_mm": 0.0}
    notes.append(
        f"marks lie off their places by {said}, the same in all images: the twin has each of them; with that taken out "
        f"an image coordinate scatters by {shape.scatter_px:.2g} px, of which the twin has what noise explains"
    )
    return shape.calibration


def _as_shown(one: Pattern, observations: Observations, b: int) -> BoardPattern:
    """What the board shows: a ChArUco board may have its columns and rows exchanged, as its corners tell."""
    usual = board_pattern(one.target)
    if one.target.kind != "charuco" or one.target.columns == one.target.rows:
        return usual
    here = np.flatnonzero((observations.status == MEASURED) & (observations.board == b) & (observations.point >= 0))
    misfit = {}
    for turned in (False, True):
        shown, total = board_pattern(one.target, turned=turned), 0.0
        for station in np.unique(observations.station[here]):
            rows = here[observations.station[here] == station]
            if len(rows) < 8:
                continue
            H, _ = cv2.findHomography(shown.points_mm[observations.point[rows]], observations.xy_px[rows])
            if H is None:
                continue
            seen = cv2.perspectiveTransform(shown.points_mm[observations.point[rows]][None], H)[0]
            total += float(((seen - observations.xy_px[rows]) ** 2).sum())
        misfit[turned] = total
    return board_pattern(one.target, turned=True) if misfit[True] < misfit[False] else usual
