"""What the sheets say, drawn anew from their uncertainty: a mark elsewhere on its board, a bar longer than certified.

A sheet stays as it is and the world moves: pixels are shifted by what the drawn marks would look like. So boards out of
plane, which a sheet cannot say, are drawn too.
"""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.project import project
from testfield.detect.observations import MEASURED, Observations
from testfield.targets.field import Field


def draw_certificates(
    observations: Observations, calibration: Calibration, field: Field, rng: np.random.Generator
) -> tuple[Observations, Field]:
    """Observations of boards whose marks and common scale were drawn, and the sheet with bars' lengths drawn."""
    scale = 1 + field.u_scale * rng.standard_normal()
    stations = {name: k for k, name in enumerate(calibration.station_names)}
    place = np.array([stations.get(name, -1) for name in observations.stations], int)[observations.station]
    xy = observations.xy_px.copy()
    for b, sheet in enumerate(field.boards):
        n = len(sheet.marks)
        off = rng.standard_normal((n, 3)) * [sheet.u_xy_mm, sheet.u_xy_mm, sheet.u_z_mm]
        if sheet.name not in calibration.board_names:
            continue
        rows = np.flatnonzero((observations.board == b) & (place >= 0) & np.isfinite(xy).all(axis=1))
        board = calibration.boards[np.full(len(rows), calibration.board_names.index(sheet.name))]
        poses = calibration.stations[place[rows]]
        local = calibration.scale * np.column_stack([sheet.marks.xy_mm, np.zeros(n)])
        moved = scale * (local + calibration.scale * off)
        before, after = (
            project(calibration.interior, poses, board.apply(at[observations.point[rows]])) for at in (local, moved)
        )
        xy[rows] += after - before
    bars = tuple(
        replace(bar, length_mm=bar.length_mm + bar.u_length_mm * rng.standard_normal()) for bar in field.scale_bars
    )
    return replace(observations, xy_px=xy), replace(field, scale_bars=bars)


def draw_pixels(observations: Observations, rng: np.random.Generator) -> Observations:
    """Observations with noise of their own covariance added once more to all that was measured."""
    z = rng.standard_normal((len(observations), 2))
    good = (observations.status == MEASURED) & np.isfinite(observations.cov_px2).all(axis=(1, 2))
    root = np.linalg.cholesky(np.where(good[:, None, None], observations.cov_px2, np.eye(2)))
    noise = np.where(good[:, None], np.einsum("nij,nj->ni", root, z), 0)
    return replace(observations, xy_px=observations.xy_px + noise)
