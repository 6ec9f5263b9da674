"""The twin of a measured job: a scene whose camera, stations, targets, light and sensor are as they were measured."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from testfield.author.twin_boards import pattern_boards
from testfield.author.twin_camera import cameras, light
from testfield.author.twin_compare import Measured, residuals_of
from testfield.author.twin_rings import rings
from testfield.author.twin_shape import shape_of
from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.detect.target_spec import TargetSpec
from testfield.errors import TestfieldError
from testfield.measure.patterns import Pattern
from testfield.measure.seen import Seen
from testfield.reconstruct.points import Points
from testfield.scene.frames import facing
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.field_file import FieldFile
from testfield.targets.marks import ring_radii

CYLINDER_SPREAD = 0.298
"""Standard deviation of the heights of a shallow cylinder over its rise."""


@dataclass(frozen=True)
class Twin:
    """A scene as plain tables, and what it could not take over, in sentences."""

    scene: dict[str, Any]
    notes: tuple[str, ...]


def twin_of(
    name: str,
    calibration: Calibration,
    points: Points,
    observations: Observations,
    field: FieldFile,
    target: TargetSpec,
    patterns: tuple[Pattern, ...],
    seen: tuple[Seen, ...],
    field_folder: Path,
    hold: tuple[str, ...] = (),
) -> Twin:
    """The twin of what `testfield measure` found, in the frame of its result, mm; `seen` by each of its cameras.

    Raises `TestfieldError` for targets that scenes do not have.
    """
    notes: list[str] = []
    boards: dict[str, Any]
    if patterns:
        calibration, boards, (normal, offset, extent) = pattern_boards(calibration, observations, patterns, notes, hold)
    elif target.kind == "circles":
        calibration, boards = _grid(calibration, points, observations, field, target, notes, hold)
        normal, offset, extent = _plane_of_grid(boards["boards"][0])
    elif target.kind == "ring":
        radii = ring_radii(field.target.radii)
        boards, (normal, offset, extent) = rings(calibration, points, observations, radii, notes)
        boards |= {"code_bits": target.bits, "code_radii": field.target.radii}
        if field.target.codes:
            own = field_folder / field.target.codes
            boards["code_table"] = str(own.resolve()) if own.is_file() else field.target.codes
    else:
        raise TestfieldError(f"targets of kind '{target.kind}' have no twin yet", name, "rings and boards have")
    several = bool(calibration.more_cameras)
    scene: dict[str, Any] = {
        "name": name,
        "description": "Twin of a measured job: camera, stations, targets, light and noise as photographs showed them.",
        "u_print_scale_ppm": 0.0,
        "volume": {"size_mm": [max(extent, 1.0)] * 3},
        **cameras(calibration, seen, notes),
        **light(seen[0], normal, offset, extent, calibration, notes),
        **boards,
        "stations": [
            {
                "generator": "pose",
                "name": station,
                "position_mm": _plain(calibration.stations.origin_mm[k]),
                "rotation_deg": _plain(Rotation.from_matrix(calibration.stations.R[k]).as_rotvec(degrees=True)),
                **({"camera": calibration.camera_names[calibration.image_camera[k]]} if several else {}),
            }
            for k, station in enumerate(calibration.station_names)
        ],
    }
    return Twin(scene, tuple(notes))


def _grid(
    calibration: Calibration,
    points: Points,
    observations: Observations,
    field: FieldFile,
    target: TargetSpec,
    notes: list[str],
    hold: tuple[str, ...],
) -> tuple[Calibration, dict[str, Any]]:
    """The board of a grid of circles, its first circle in the origin, columns along x and rows along y; with it the
    camera and the stations, where the grid's own shape was found that belong to it."""
    assert field.grid and field.target.diameter_mm
    pitch = field.grid.spacing_mm
    columns, rows = max(target.columns, target.rows), min(target.columns, target.rows)
    k = np.arange(columns * rows)
    nominal = pitch * np.column_stack([k % columns, k // columns, 0 * k]).astype(float)
    shape = shape_of(calibration, observations, nominal, hold)
    calibration = shape.calibration if shape else calibration
    centre = np.array([(columns - 1) * pitch / 2, (rows - 1) * pitch / 2, 0.0])
    normal = np.array([0, 0, np.sign(np.median(calibration.stations.origin_mm[:, 2])) or 1.0])
    x = facing(normal)[:, 0]
    y = facing(normal)[:, 1]
    spin = np.degrees(np.arctan2(y[0], x[0]))
    unflat = float(calibration.misfit.get("unflat_mm", 0.0))
    board: dict[str, Any] = {
        "name": "grid",
        "size_mm": [(columns + 1) * pitch, (rows + 1) * pitch],
        "position_mm": _plain(centre),
        "normal": _plain(normal),
        "spin_deg": float(-spin if normal[2] > 0 else spin),
        "pattern": {
            "kind": "circles",
            "columns": columns,
            "rows": rows,
            "pitch_mm": pitch,
            "diameter_mm": field.target.diameter_mm,
        },
    }
    if shape:
        R = facing(normal, np.radians(board["spin_deg"]))
        here = BoardPattern("circles", columns, rows, pitch, 1.0).points_mm @ R.T[:2] + centre
        board["marks_off_mm"] = [_plain(one) for one in (shape.off_mm @ R)[cKDTree(nominal).query(here)[1]]]
        board["print_sigma_mm"] = 0.0
        spread = shape.off_mm.std(axis=0)
        in_plane = np.hypot(spread[0], spread[1]) / np.sqrt(2)
        notes.append(
            f"the sheet's marks lie off their places by {spread[0]:.2g} mm along rows, {spread[1]:.2g} mm along "
            f"columns and {spread[2]:.2g} mm in height (standard deviations, the same in all images, known to "
            f"{np.linalg.norm(shape.u_mm) / np.sqrt(3):.2g} mm): the twin has each of them; to measure with such a "
            f"sheet, say u_mm = {in_plane:.2g} and u_flat_mm = {spread[2]:.2g} in [grid]"
        )
        notes.append(
            f"with that taken out an image coordinate scatters by {shape.scatter_px:.2g} px; what noise does not "
            "explain of it (JPEG, sharpening, resampling, light that changes across a mark) the twin has not"
        )
        return calibration, {"boards": [board]}
    board["print_sigma_mm"] = _print_sigma(calibration, points, observations)
    if unflat:
        board["bow_mm"] = unflat / CYLINDER_SPREAD
        notes.append(f"heights of {unflat:.2g} mm above the sheet are those of one steady bend, the same in all images")
    return calibration, {"boards": [board]}


def _print_sigma(calibration: Calibration, points: Points, observations: Observations) -> float:
    """By how much marks lie off their places in mm: the part of the residuals that is the same in all images."""
    rows, residual = residuals_of(Measured(calibration, points, observations))
    names = {name: k for k, name in enumerate(calibration.station_names)}
    point, by_mark, depth = observations.point[rows], [], []
    for mark in np.unique(point[point >= 0]):
        own = point == mark
        if own.sum() > 2:
            by_mark.append(residual[own])
    for row in rows:
        depth.append(abs(calibration.stations.t_mm[names[observations.stations[observations.station[row]]]][2]))
    if not by_mark:
        return 0.0
    within = float(np.mean([one.var(axis=0, ddof=1).mean() for one in by_mark]))
    between = float(np.mean([(one.mean(axis=0) ** 2).mean() - within / len(one) for one in by_mark]))
    return float(np.sqrt(max(between, 0.0)) * np.median(depth) / calibration.interior.fx)


def _plane_of_grid(board: dict[str, Any]) -> tuple[np.ndarray, float, float]:
    normal = np.array(board["normal"], float)
    return normal, float(normal @ np.array(board["position_mm"])), float(max(board["size_mm"]))


def _plain(vector: np.ndarray) -> list[float]:
    return [float(v) for v in vector]
