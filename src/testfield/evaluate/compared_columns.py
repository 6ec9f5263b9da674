"""Lists of errors that a row of a comparison holds: of centres, of the camera over the image, of points, of lengths."""

from typing import Any

import numpy as np
from scipy.spatial.distance import pdist

from testfield.calibrate.calibration import Calibration
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.score.camera import interior_difference
from testfield.score.detection import DetectionScore
from testfield.score.points import PointScore
from testfield.statistics.consistency import chi_squared

LISTS = (
    *("station", "mark", "dx_px", "dy_px", "x_px", "y_px", "centre_nees", "missed_station", "missed_mark"),
    *("camera_x_px", "camera_y_px", "camera_dx_px", "camera_dy_px"),
    *("point_code", "point_x_mm", "point_y_mm", "point_z_mm", "point_nees", "length_mm", "length_error_mm"),
)
"""All of them; of a camera the first four are the corners, the rest a grid over the image."""
GRID = (9, 7)
MOST_LENGTHS = 200


def centre_columns(score: DetectionScore, views: Views) -> dict[str, Any]:
    """Of every centre that was measured the image and mark (numbers in the order of the scene), its true place, its
    error and its squared error over the stated covariance; image and mark of all that were missed."""
    x, y = views.disc_px[score.station, score.mark].T
    station, mark = np.nonzero(score.expected & ~score.found)
    return {
        "station": score.station.tolist(),
        "mark": score.mark.tolist(),
        "dx_px": score.error_px[:, 0].tolist(),
        "dy_px": score.error_px[:, 1].tolist(),
        "x_px": x.tolist(),
        "y_px": y.tolist(),
        "centre_nees": score.nees.tolist(),
        "missed_station": station.tolist(),
        "missed_mark": mark.tolist(),
    }


def camera_columns(cameras: dict[str, World], calibration: Calibration) -> dict[str, Any]:
    """By how many px the found camera, the first of several, images the true one's rays elsewhere."""
    true = next(iter(cameras.values())).interior
    columns, rows = GRID
    inner = np.meshgrid(np.linspace(0, true.width_px - 1, columns), np.linspace(0, true.height_px - 1, rows))
    at = np.vstack([true.corners_px, np.stack(inner, -1).reshape(-1, 2)])
    off = interior_difference(true, calibration.interior, at)
    names = ("camera_x_px", "camera_y_px", "camera_dx_px", "camera_dy_px")
    return {name: values.tolist() for name, values in zip(names, np.column_stack([at, off]).T, strict=True)}


def point_columns(score: PointScore) -> dict[str, Any]:
    """Of every check point its code, its error in mm after the rigid fit, and its squared error, without the fit, over
    the stated covariance."""
    nees = [_nees(error, score.covariance(k)) for k, error in enumerate(score.error_mm)]
    named = {f"point_{axis}_mm": score.fitted_mm[:, k].tolist() for k, axis in enumerate("xyz")}
    return {"point_code": [int(code) for code in score.code]} | named | {"point_nees": nees}


def length_columns(score: PointScore) -> dict[str, Any]:
    """Distances between check points and their errors; of many a choice that is spread evenly over all lengths."""
    if len(score.true_mm) < 2:
        return {"length_mm": [], "length_error_mm": []}
    true, found = pdist(score.true_mm), pdist(score.true_mm + score.error_mm)
    order = np.argsort(true, kind="stable")
    kept = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), MOST_LENGTHS)).round().astype(int))]
    return {"length_mm": true[kept].tolist(), "length_error_mm": (found - true)[kept].tolist()}


def ground_mm(world: World, views: Views) -> float:
    """How many mm a pixel is at the targets, in the middle of all that are seen in full: what an error in an image
    becomes in space."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.broadcast_to(world.marks.diameter_mm, views.visible.shape) / (2 * views.semi_axes_px[..., 0])
    seen = (views.visible == 1) & np.isfinite(scale) & (scale > 0)
    return float(np.median(scale[seen])) if seen.any() else float("nan")


def _nees(error: np.ndarray, cov: np.ndarray) -> float:
    value, freedom = chi_squared(error, cov) if np.isfinite(cov).all() else (0.0, 0)
    return value if freedom == len(error) else float("nan")  # a column has one number of degrees of freedom
