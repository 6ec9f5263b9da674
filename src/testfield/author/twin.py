"""The twin of a measured job: a scene whose camera, stations, targets, light and sensor are as they were measured."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from testfield.author.twin_compare import Measured, residuals_of
from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.target_spec import TargetSpec
from testfield.errors import TestfieldError
from testfield.measure.seen import Seen
from testfield.reconstruct.points import Points
from testfield.scene.frames import facing
from testfield.sensor.expose import Sensor
from testfield.targets.field_file import FieldFile

PITCH_UM, F_NUMBER, TIME_MS, WAVELENGTH_NM, EFFICIENCY = 3.45, 8.0, 10.0, 550.0, 0.5
"""What no image tells, and what cancels: light is made such that the electrons are those seen."""
WHITE, LEAST_BLACK, MOST_WALL = 0.85, 0.005, 0.9
CYLINDER_SPREAD = 0.298
"""Standard deviation of the heights of a shallow cylinder over its rise."""
FLAT_SHARE = 0.03
"""A target belongs to the field's plane that is this near to it, in the field's extent."""
RING_REACH = 1.7
"""Half the side of a ring code's card in diameters of its dot, for rings as usual (1:2:3)."""


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
    seen: Seen,
    field_folder: Path,
) -> Twin:
    """The twin of what `testfield measure` found, in the frame of its result, mm.

    Raises `TestfieldError` where several cameras measured, or targets that scenes do not have.
    """
    if calibration.more_cameras:
        raise TestfieldError("of several cameras no twin is written yet", name, "measure each camera alone")
    notes: list[str] = []
    if target.kind == "circles":
        boards: dict[str, Any] = _grid(calibration, points, observations, field, target, notes)
        normal, offset, extent = _plane_of_grid(boards["boards"][0])
    elif target.kind == "ring":
        boards, (normal, offset, extent) = _rings(calibration, points, observations, target, notes)
        boards |= {"code_bits": target.bits, "code_radii": field.target.radii}
        if field.target.codes:
            own = field_folder / field.target.codes
            boards["code_table"] = str(own.resolve()) if own.is_file() else field.target.codes
    else:
        raise TestfieldError(f"targets of kind '{target.kind}' have no twin yet", name, "rings and circle grids have")
    scene: dict[str, Any] = {
        "name": name,
        "description": "Twin of a measured job: camera, stations, targets, light and noise as photographs showed them.",
        "u_print_scale_ppm": 0.0,
        "volume": {"size_mm": [max(extent, 1.0)] * 3},
        "camera": _camera(calibration, seen, notes),
        **_light(seen, normal, offset, extent, calibration),
        **boards,
        "stations": [
            {
                "generator": "pose",
                "name": station,
                "position_mm": _plain(calibration.stations.origin_mm[k]),
                "rotation_deg": _plain(Rotation.from_matrix(calibration.stations.R[k]).as_rotvec(degrees=True)),
            }
            for k, station in enumerate(calibration.station_names)
        ],
    }
    return Twin(scene, tuple(notes))


def _camera(calibration: Calibration, seen: Seen, notes: list[str]) -> dict[str, Any]:
    inner = calibration.interior.without_modes
    middle = ((inner.width_px - 1) / 2, (inner.height_px - 1) / 2)
    given = dict(zip(inner.names[4:], (float(v) for v in inner.coefficients), strict=True))
    camera: dict[str, Any] = {
        "width_px": inner.width_px,
        "height_px": inner.height_px,
        "pixel_pitch_um": PITCH_UM,
        "focal_length_mm": float(inner.fx) * PITCH_UM / 1000,
        "aspect": float(inner.fy / inner.fx),
        "principal_point_offset_px": [float(inner.cx) - middle[0], float(inner.cy) - middle[1]],
        "lens": inner.model,
        **{key: value for key, value in given.items() if value},
        "f_number": F_NUMBER,
        "psf_sigma_px": float(min(seen.blur_px, 5.0)),
    }
    if calibration.misfit.get("rms_px"):
        camera["residual_field"] = {"rms_px": float(min(calibration.misfit["rms_px"], 5.0))}
        notes.append("what the lens model did not follow is a smooth field of the same size, but drawn anew")
    return camera


def _light(seen: Seen, normal: np.ndarray, offset: float, extent: float, calibration: Calibration) -> dict[str, Any]:
    """Even light in which white is as bright as it was, black as dark, and a wall behind a flat field as the images."""
    bright, dark = max(seen.ink_dn, seen.ground_dn), min(seen.ink_dn, seen.ground_dn)
    full_well_e = seen.full_dn * seen.gain_e_per_dn
    sensor = Sensor(
        PITCH_UM, F_NUMBER, TIME_MS, WAVELENGTH_NM, EFFICIENCY, full_well_e, 0.0, seen.gain_e_per_dn, 0.0, seen.bits
    )
    ambient = bright * seen.gain_e_per_dn / (WHITE * sensor.electrons_per_radiance)
    room: dict[str, Any] = {"ambient_w_m2_sr": float(ambient)}
    if (calibration.stations.origin_mm @ normal > offset).all():
        wall = float(np.clip(WHITE * seen.elsewhere_dn / bright, 0.02, MOST_WALL))
        behind = normal * (offset - 0.06 * extent)
        room["surfaces"] = [
            {
                "name": "behind",
                "size_mm": [20 * extent] * 2,
                "position_mm": _plain(behind),
                "normal": _plain(normal),
                "albedo": wall,
            }
        ]
    black = float(np.clip(WHITE * dark / bright, LEAST_BLACK, WHITE * 0.98))
    return {
        "paint": {"white": WHITE, "black": black, "white_on_black": seen.white_on_black},
        "exposure": {"time_ms": TIME_MS},
        "sensor": {
            "bits": int(max(seen.bits, 8)),
            "quantum_efficiency": EFFICIENCY,
            "wavelength_nm": WAVELENGTH_NM,
            "full_well_e": float(full_well_e),
            "read_noise_e": float(seen.read_noise_e),
            "gain_e_per_dn": float(seen.gain_e_per_dn),
            "black_level_dn": 0.0,
        },
        "room": room,
    }


def _grid(
    calibration: Calibration,
    points: Points,
    observations: Observations,
    field: FieldFile,
    target: TargetSpec,
    notes: list[str],
) -> dict[str, Any]:
    """The board of a grid of circles, its first circle in the origin, columns along x and rows along y."""
    assert field.grid and field.target.diameter_mm
    pitch = field.grid.spacing_mm
    columns, rows = max(target.columns, target.rows), min(target.columns, target.rows)
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
        "print_sigma_mm": _print_sigma(calibration, points, observations),
    }
    if unflat:
        board["bow_mm"] = unflat / CYLINDER_SPREAD
        notes.append(f"heights of {unflat:.2g} mm above the sheet are those of one steady bend, the same in all images")
    return {"boards": [board]}


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


def _rings(
    calibration: Calibration, points: Points, observations: Observations, target: TargetSpec, notes: list[str]
) -> tuple[dict[str, Any], tuple[np.ndarray, float, float]]:
    """Every measured code on a card of its own; the one farthest from all others on a board, which scenes need."""
    coded = np.flatnonzero(points.code > 0)
    if len(coded) < 2:
        raise TestfieldError("fewer than two codes were measured", "points", "a twin needs them")
    if len(coded) < len(points):
        notes.append(f"{len(points) - len(coded)} dots without a code are left out: scenes have them on boards only")
    xyz, code = points.xyz_mm[coded], points.code[coded]
    origin = calibration.stations.origin_mm
    middle = np.median(xyz, axis=0)
    normal = np.linalg.svd(xyz - xyz.mean(axis=0))[2][2]
    normal = normal * (np.sign(normal @ (np.median(origin, axis=0) - middle)) or 1.0)
    offset = float(np.median(xyz @ normal))
    extent = float(np.linalg.norm(np.ptp(xyz, axis=0)))
    diameter = _diameters(calibration, points, coded, observations)
    gaps = np.linalg.norm(xyz[:, None] - xyz[None], axis=2) + np.diag(np.full(len(xyz), np.inf))
    lone = int(gaps.min(axis=1).argmax())
    targets, board = [], {}
    for k in range(len(coded)):
        flat = abs(float(xyz[k] @ normal) - offset) < FLAT_SHARE * extent
        to = origin - xyz[k]
        towards = normal if flat else (to / np.linalg.norm(to, axis=1, keepdims=True)).mean(axis=0)
        d = float(diameter[k])
        if k != lone:
            targets.append(
                {
                    "code": int(code[k]),
                    "position_mm": _plain(xyz[k]),
                    "normal": _plain(towards / np.linalg.norm(towards)),
                    "diameter_mm": d,
                }
            )
            continue
        side = 2 * (RING_REACH + 0.6) * d
        board = {
            "name": "A",
            "size_mm": [side, side],
            "thickness_mm": max(0.1 * d, 1e-3),
            "position_mm": _plain(xyz[k]),
            "normal": _plain(towards / np.linalg.norm(towards)),
            "print_sigma_mm": 0.0,
            # A board has a dot, too: this one is a speck that no camera sees.
            "extension_zone": {
                "columns": 1,
                "rows": 1,
                "pitch_mm": d,
                "diameter_mm": 0.01 * d,
                "centre_mm": [(RING_REACH + 0.3) * d, 0],
            },
            "recognition_zone": {"columns": 1, "rows": 1, "pitch_mm": d, "diameter_mm": d, "codes": [int(code[k])]},
        }
    return {"boards": [board], "check_targets": targets}, (normal, offset, extent)


def _diameters(calibration: Calibration, points: Points, coded: np.ndarray, observations: Observations) -> np.ndarray:
    """(k,) diameter in mm of each coded dot: the median over images of its longer axis at its distance."""
    names = {name: k for k, name in enumerate(calibration.station_names)}
    seen = observations.take((observations.status == MEASURED) & (observations.point >= 0))
    station = np.array([names.get(name, -1) for name in seen.stations], int)[seen.station]
    found: dict[int, list[float]] = {}
    for k in range(len(seen)):
        if station[k] < 0 or not np.isfinite(seen.moments_px2[k]).all():
            continue
        R, t = calibration.stations.R[station[k]], calibration.stations.t_mm[station[k]]
        place = R @ points.xyz_mm[seen.point[k]] + t
        axis_px = 4 * float(np.sqrt(np.linalg.eigvalsh(seen.moments_px2[k])[1]))
        # Off the axis a circle's image is longer by its distance over its depth.
        found.setdefault(int(seen.point[k]), []).append(axis_px * float(place[2]) / float(calibration.interior.fx))
    usual = float(np.median(np.concatenate([np.array(v) for v in found.values()])))
    return np.array([np.median(found.get(int(p), [usual])) for p in coded])


def _plain(vector: np.ndarray) -> list[float]:
    return [float(v) for v in vector]
