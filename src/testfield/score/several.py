"""Several cameras against the truth: each one's interior orientation, and the relative orientation of rigs."""

from typing import Any

import numpy as np

from testfield.calibrate.calibration import AXES, Calibration
from testfield.calibrate.one_of_several import of_camera
from testfield.camera.pose import rotation, rotation_vector
from testfield.scene.camera_parts import RigPart
from testfield.scene.parts import relative_poses
from testfield.scene.world import World
from testfield.score.camera import score_camera
from testfield.statistics.consistency import nees

OF_ONE = (
    "corner_error_px",
    "corner_errors_px",
    "interior_error",
    "interior_u",
    "interior_anees",
    "imaging_error_px",
    "imaging_u_px",
    "imaging_anees",
)
"""Figures that belong to one camera."""


def score_cameras(cameras: dict[str, World], calibration: Calibration) -> dict[str, Any]:
    """As `score_camera`, and under `cameras` the figures of each of several; those in front are of the worst camera at
    its corners. `cameras` are the worlds as they see them, by name."""
    if not calibration.more_cameras:
        return score_camera(next(iter(cameras.values())), calibration)
    each = {
        name: score_camera(cameras[name], of_camera(calibration, k)) for k, name in enumerate(calibration.camera_names)
    }
    worst = max(each.values(), key=lambda card: card["corner_error_px"])
    return worst | {"cameras": {name: {key: card[key] for key in OF_ONE} for name, card in each.items()}}


def score_rigs(rigs: tuple[RigPart, ...], calibration: Calibration) -> list[dict[str, Any]]:
    """Relative orientations against the true ones, those of every camera beside its rig's first: errors in mm and mrad,
    their stated uncertainties (root of the axes' sum of squares) and the NEES per degree of freedom of all six."""
    true = {(rig.name, one.camera): relative_poses(rig)[k : k + 1] for rig in rigs for k, one in enumerate(rig.cameras)}
    found = []
    for one in calibration.rigs:
        pose = true[one["rig"], one["camera"]]
        R = rotation(np.array(one["turn_rad"]))
        error = np.concatenate([rotation_vector((R @ pose.R[0].T)[None])[0], np.array(one["t_mm"]) - pose.t_mm[0]])
        unknowns = [f"member:{one['rig']}/{one['camera']}.{axis}" for axis in AXES]
        stated = calibration.states(unknowns)
        index = calibration.index(unknowns) if stated else np.zeros(0, int)
        cov = calibration.covariance[np.ix_(index, index)] if stated else np.full((6, 6), np.nan)
        u = np.sqrt(np.diag(cov))
        found.append(
            {
                "rig": one["rig"],
                "camera": one["camera"],
                "rotation_error_mrad": float(1e3 * np.linalg.norm(error[:3])),
                "u_rotation_mrad": float(1e3 * np.linalg.norm(u[:3])),
                "translation_error_mm": float(np.linalg.norm(error[3:])),
                "u_translation_mm": float(np.linalg.norm(u[3:])),
                "anees": nees(error, cov),
            }
        )
    return found
