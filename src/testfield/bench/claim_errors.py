"""Errors of one measurement against the truth, by groups of unknowns that are claimed together."""

import numpy as np

from testfield.bench.claim_figures import Errors
from testfield.calibrate.calibration import AXES, Calibration
from testfield.camera.pose import rotation, rotation_vector
from testfield.reconstruct.points import Points
from testfield.scene.camera_parts import RigPart
from testfield.scene.parts import relative_poses
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.points import score_points

GROUPS = ("camera", "relative_orientation", "boards", "check_points")


def errors_of(
    world: World,
    cameras: dict[str, World],
    rigs: tuple[RigPart, ...],
    calibration: Calibration,
    points: Points,
) -> dict[str, Errors]:
    """Errors of the interior orientation of all cameras, the relative orientations of rigs (where some were
    determined), board poses and check points in the datum frame, by group.

    `cameras` are the worlds as each camera sees them, by name.
    """
    found = {
        "camera": _cameras(cameras, calibration),
        "boards": _boards(world, calibration),
        "check_points": _points(world, calibration, points),
    }
    return found | ({"relative_orientation": _rigs(rigs, calibration)} if calibration.rigs else {})


def _of(errors: list[np.ndarray], names: list[str], calibration: Calibration, size: int) -> Errors:
    index = calibration.index(names)
    return Errors(np.concatenate([np.zeros(0), *errors]), calibration.covariance[np.ix_(index, index)], size)


def _cameras(cameras: dict[str, World], calibration: Calibration) -> Errors:
    """One part a camera; where cameras have different numbers of unknowns, all are one part."""
    worlds = list(cameras.values())
    if calibration.more_cameras:
        worlds = [cameras[name] for name in calibration.camera_names]
    errors, names, sizes = [], [], set()
    for k, (world, interior) in enumerate(zip(worlds, calibration.interiors, strict=True)):
        own = interior.without_modes
        labels = calibration.interior_unknowns(k)[: len(own.names)]
        # Parameters can only be compared between equal models.
        alike = interior.model == world.interior.model
        free = [n for n, label in enumerate(labels) if alike and label in calibration.labels]
        errors.append((own.parameters - world.interior.parameters)[free] if free else np.zeros(0))
        names += [labels[n] for n in free]
        sizes.add(len(free))
    return _of(errors, names, calibration, max(sizes.pop() if len(sizes) == 1 else len(names), 1))


def _rigs(rigs: tuple[RigPart, ...], calibration: Calibration) -> Errors:
    true = {(rig.name, one.camera): relative_poses(rig)[k : k + 1] for rig in rigs for k, one in enumerate(rig.cameras)}
    errors, names = [], []
    for one in calibration.rigs:
        pose = true[one["rig"], one["camera"]]
        turn = rotation_vector((rotation(np.array(one["turn_rad"])) @ pose.R[0].T)[None])[0]
        errors += [turn, np.array(one["t_mm"]) - pose.t_mm[0]]
        names += [f"member:{one['rig']}/{one['camera']}.{axis}" for axis in AXES]
    return _of(errors, names, calibration, 6)


def _boards(world: World, calibration: Calibration) -> Errors:
    _, true = true_in_datum(world, calibration.board_names)
    errors, names = [], []
    for b, name in enumerate(calibration.board_names[1:], start=1):
        turn = rotation_vector((calibration.boards.R[b] @ true.R[b].T)[None])[0]
        errors += [turn, calibration.boards.t_mm[b] - true.t_mm[b]]
        names += [f"board:{name}.{axis}" for axis in AXES]
    return _of(errors, names, calibration, 6)


def _points(world: World, calibration: Calibration, points: Points) -> Errors:
    score = score_points(world, calibration, points)
    return Errors(score.error_mm.ravel(), score.cov_mm2, 3)
