"""What a calibration file says must fit together: names and labels, shapes, rotations, a covariance."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from testfield.calibrate.calibration import Calibration

NOT_A_ROTATION = 1e-6
NEGATIVE = 1e-6
"""Part of its largest eigenvalue, in units of each unknown's own, by which a covariance may be negative by rounding."""


def what_cannot_be(found: "Calibration") -> str:
    """A sentence on the first thing that contradicts another, or nothing."""
    for what, names, poses in (
        ("station", found.station_names, found.stations),
        ("board", found.board_names, found.boards),
    ):
        if len(set(names)) < len(names) or len(names) != len(poses):
            return f"{what}_names lists {len(names)} names, {len(set(names))} different ones, for {len(poses)} poses"
        off = np.abs(poses.R @ np.swapaxes(poses.R, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0)
        bad = ~((off < NOT_A_ROTATION) & (np.linalg.det(poses.R) > 0) & np.isfinite(poses.t_mm).all(axis=1))
        if bad.any():
            return f"the pose of {what} '{names[int(np.argmax(bad))]}' is no rotation with a shift"
        said = {label.partition(":")[2].rpartition(".")[0] for label in found.labels if label.startswith(f"{what}:")}
        if said - set(names):
            return f"labels names the {what} '{min(said - set(names))}', and {what}_names has {', '.join(names)}"
    unknowns = {label.partition(":")[2].rpartition(".")[0] for label in found.labels if label.startswith("station:")}
    if unknowns and set(found.station_names) - unknowns:
        return f"labels does not name the station '{min(set(found.station_names) - unknowns)}'"
    values = found.interior.parameters
    for name, value in zip(found.interior.names, values, strict=True):
        if not np.isfinite(value) or (name in ("fx", "fy") and value <= 0):
            return f"interior: {name} = {value}"
    for name in ("scale", "sigma0"):
        if not np.isfinite(getattr(found, name)) or (name == "scale" and found.scale <= 0):
            return f"{name} = {getattr(found, name)}"
    return _covariance(found.covariance, len(found.labels))


def _covariance(cov: np.ndarray, unknowns: int) -> str:
    if cov.shape != (unknowns, unknowns) and not (cov.size == 0 and unknowns == 0):
        return f"the covariance is {' x '.join(map(str, cov.shape))} and labels names {unknowns} unknowns"
    if not np.isfinite(cov).all():
        return "the covariance has numbers that are not finite"
    own = np.sqrt(np.diag(cov).clip(0)) if unknowns else np.zeros(0)
    if unknowns and (np.diag(cov) < 0).any():
        return f"the covariance says that unknown {int(np.argmin(np.diag(cov)))} has a negative variance"
    scaled = cov / np.outer(own, own).clip(np.finfo(float).tiny)
    if unknowns and np.abs(scaled - scaled.T).max() > NEGATIVE:
        return "the covariance is not symmetric"
    return ""
