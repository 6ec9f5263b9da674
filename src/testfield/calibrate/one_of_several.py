"""One of several calibrated cameras, as if it had been alone."""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration


def of_camera(calibration: Calibration, camera: int) -> Calibration:
    """The calibration of one camera, by its number: its interior orientation, images and residuals.

    The covariance is that of all cameras together, so whatever is asked of it keeps its correlations; the unknowns of
    the camera asked for have the names that they would have alone. Boards, points and notes are those of all.
    """
    if not calibration.more_cameras:
        return calibration
    prefix = f"camera:{calibration.camera_names[camera]}."
    images = np.flatnonzero(calibration.camera_of_image == camera)
    residuals = calibration.residual_camera == camera
    return replace(
        calibration,
        interior=calibration.interiors[camera],
        more_cameras=(),
        camera_names=(),
        image_camera=np.zeros(0, int),
        residual_camera=np.zeros(0, int),
        station_names=tuple(calibration.station_names[k] for k in images),
        stations=calibration.stations[images],
        labels=tuple(label.removeprefix(prefix) for label in calibration.labels),
        residual_at_px=calibration.residual_at_px[residuals],
        residual_px=calibration.residual_px[residuals],
    )
