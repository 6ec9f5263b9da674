"""Figures by which recipes are compared: of each, less is better."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """A figure of which less is better: its `key` in a row, `title`, `unit`, and that unit over the row's.

    `floor` tells whether what the images themselves may err can be held against it.
    """

    key: str
    title: str
    unit: str
    scale: float = 1.0
    floor: bool = True


CENTRE = Metric("detection.centre_rms_px", "centre error, rms", "px")
COMMON = Metric("common.centre_rms_px", "centre error where all found, rms", "px")
MISSED = Metric("detection.missed", "targets missed", "", floor=False)
CORNER = Metric("calibration.corner_error_px", "interior orientation, worst corner", "px")
POINTS = Metric("points.rmse_mm", "check points, RMSE", "um", 1000.0)
METRICS = (CENTRE, COMMON, MISSED, CORNER, POINTS)
MATTERS = {"px": 0.001, "um": 1.0, "": 0.5}
"""Differences that matter by unit, where nobody names others."""
