"""The boards and cards of a job with ring codes: what lies in one plane on a plate, all else on cards of its own."""

from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.scene.frames import facing
from testfield.targets.marks import RingRadii

FLAT_SHARE = 0.03
"""A target belongs to the field's plane that is this near to it, in the field's extent."""
CARD_SHARE = 0.3
"""By how much half a code's card, or a plate's margin, exceeds its quiet zone, in dot radii."""
SAME_SIZE = 0.1
"""Relative difference of diameters up to which codes are of one size."""


def rings(
    calibration: Calibration, points: Points, observations: Observations, radii: RingRadii, notes: list[str]
) -> tuple[dict[str, Any], tuple[np.ndarray, float, float]]:
    """Boards and check targets of a scene with every measured code and dot; the plane that most of them are near:
    normal, offset and extent.

    Raises `TestfieldError` where fewer than two codes were measured.
    """
    coded = points.code > 0
    if coded.sum() < 2:
        raise TestfieldError("fewer than two codes were measured", "points", "a twin needs them")
    xyz, origin = points.xyz_mm, calibration.stations.origin_mm
    normal = np.linalg.svd(xyz - xyz.mean(axis=0))[2][2]
    normal = normal * (np.sign(normal @ (np.median(origin, axis=0) - np.median(xyz, axis=0))) or 1.0)
    offset = float(np.median(xyz @ normal))
    extent = float(np.linalg.norm(np.ptp(xyz, axis=0)))
    height = xyz @ normal - offset
    flat = np.abs(height) < FLAT_SHARE * extent
    diameter = diameters(calibration, points, observations)
    usual = float(np.median(diameter[coded]))
    quiet = radii.quiet * usual / 2
    on = flat & np.where(coded, np.abs(diameter - usual) < SAME_SIZE * usual, _clear(xyz, coded, quiet + usual / 2))
    if not (on & coded).any():
        on = _lone(xyz, coded)
    place = {"normal": normal, "offset": offset, "margin": quiet + CARD_SHARE * usual / 2}
    board = _plate(points, np.flatnonzero(on), diameter, place)
    left = np.flatnonzero(~on & ~coded)
    if len(left):
        notes.append(f"{len(left)} dots without a code are left out: they lie off the plate or within a code")
    if (on & ~coded).any():
        notes.append(
            f"{int((on & coded).sum())} codes and {int((on & ~coded).sum())} dots lie on one plate; the heights of "
            f"{float(height[on].std()):.2g} mm (standard deviation) by which they are off its plane are left out"
        )
    targets = []
    for k in np.flatnonzero(coded & ~on):
        to = origin - xyz[k]
        towards = normal if flat[k] else (to / np.linalg.norm(to, axis=1, keepdims=True)).mean(axis=0)
        targets.append(
            {
                "code": int(points.code[k]),
                "position_mm": _plain(xyz[k]),
                "normal": _plain(towards / np.linalg.norm(towards)),
                "diameter_mm": float(diameter[k]),
            }
        )
    return {"boards": [board], "check_targets": targets}, (normal, offset, extent)


def _plate(points: Points, on: np.ndarray, diameter: np.ndarray, place: dict[str, Any]) -> dict[str, Any]:
    """The board with the codes and dots `on` (k,) it. A job without dots has a speck there that no camera sees, for a
    board has a dot, too."""
    R = facing(place["normal"])
    flat = points.xyz_mm[on] @ R[:, :2]
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    xy, coded = flat - middle, points.code[on] > 0
    usual = float(np.median(diameter[on][coded]))
    dots = xy[~coded]
    of_dots = float(np.median(diameter[on][~coded])) if len(dots) else 0.01 * usual
    if not len(dots):
        dots = xy[:1] + [0.9 * place["margin"], 0]
    size = 2 * (np.abs(xy).max(axis=0) + place["margin"])
    # One target away from all others: its card lies where it was, however deep the field is.
    lone = float(np.median(points.xyz_mm[on] @ place["normal"]))
    return {
        "name": "plate",
        "size_mm": _plain(size),
        "thickness_mm": max(0.1 * usual, 1e-3),
        "position_mm": _plain(R[:, :2] @ middle + lone * place["normal"]),
        "normal": _plain(place["normal"]),
        "print_sigma_mm": 0.0,
        "extension_zone": {"diameter_mm": of_dots, "places_mm": [_plain(one) for one in dots]},
        "recognition_zone": {
            "diameter_mm": usual,
            "codes": [int(code) for code in points.code[on][coded]],
            "places_mm": [_plain(one) for one in xy[coded]],
        },
    }


def _clear(xyz: np.ndarray, coded: np.ndarray, reach_mm: float) -> np.ndarray:
    """(n,) whether points lie outside all codes but their own."""
    gaps = np.linalg.norm(xyz[:, None] - xyz[None, coded], axis=2)
    return np.asarray((gaps > reach_mm).all(axis=1))


def _lone(xyz: np.ndarray, coded: np.ndarray) -> np.ndarray:
    """(n,) the code that is farthest from all others."""
    which = np.flatnonzero(coded)
    gaps = np.linalg.norm(xyz[which][:, None] - xyz[which][None], axis=2) + np.diag(np.full(len(which), np.inf))
    return np.asarray(np.arange(len(xyz)) == which[gaps.min(axis=1).argmax()])


def diameters(calibration: Calibration, points: Points, observations: Observations) -> np.ndarray:
    """(n,) diameter in mm of each dot: the median over images of its longer axis at its distance."""
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
    return np.array([np.median(found.get(int(p), [usual])) for p in range(len(points))])


def _plain(vector: np.ndarray) -> list[float]:
    return [float(v) for v in vector]
