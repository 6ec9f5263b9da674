"""What the sheets say, drawn anew from their uncertainty: a mark elsewhere on its board, a bar longer than certified.

A sheet stays as it is and the world moves: pixels are shifted by what the drawn marks would look like. So boards out of
plane, which a sheet cannot say, are drawn too.
"""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.project import project
from testfield.camera.several import by_camera
from testfield.detect.observations import MEASURED, Observations
from testfield.seeds import normals, normals_of_marks
from testfield.targets.field import Field


def draw_certificates(
    observations: Observations, calibration: Calibration, field: Field, seed: int
) -> tuple[Observations, Field]:
    """Observations of boards whose marks and common scale were drawn, and the sheet with bars' lengths drawn.

    Each board's and each bar's draws are its own, by name, so that another on the sheet changes none of them.
    """
    scale = 1 + field.u_scale * normals(seed, "scale", 1)[0, 0]
    stations = {name: k for k, name in enumerate(calibration.station_names)}
    place = np.array([stations.get(name, -1) for name in observations.stations], int)[observations.station]
    xy = observations.xy_px.copy()
    for b, sheet in enumerate(field.boards):
        n = len(sheet.marks)
        off = normals(seed, f"board/{sheet.name}", n, 3) * [sheet.u_xy_mm, sheet.u_xy_mm, sheet.u_z_mm]
        if sheet.name not in calibration.board_names:
            continue
        rows = np.flatnonzero((observations.board == b) & (place >= 0) & np.isfinite(xy).all(axis=1))
        board = calibration.boards[np.full(len(rows), calibration.board_names.index(sheet.name))]
        poses = calibration.stations[place[rows]]
        local = calibration.scale * np.column_stack([sheet.marks.xy_mm, np.zeros(n)])
        moved = scale * (local + calibration.scale * off)
        camera = calibration.camera_of_image[place[rows]]
        before, after = (
            by_camera(project, calibration.interiors, camera, poses, board.apply(at[observations.point[rows]]))
            for at in (local, moved)
        )
        xy[rows] += after - before
    bars = tuple(
        replace(bar, length_mm=bar.length_mm + bar.u_length_mm * float(normals(seed, f"bar/{bar.name}", 1)[0, 0]))
        for bar in field.scale_bars
    )
    return replace(observations, xy_px=xy), replace(field, scale_bars=bars)


def draw_pixels(observations: Observations, field: Field, seed: int) -> Observations:
    """Observations with noise of their own covariance added once more to all that was measured."""
    o = observations
    z = normals_of_marks(
        seed, o.stations, tuple(board.name for board in field.boards), o.station, o.board, o.point, o.code
    )
    good = (observations.status == MEASURED) & np.isfinite(observations.cov_px2).all(axis=(1, 2))
    root = np.linalg.cholesky(np.where(good[:, None, None], observations.cov_px2, np.eye(2)))
    noise = np.where(good[:, None], np.einsum("nij,nj->ni", root, z), 0)
    return replace(observations, xy_px=observations.xy_px + noise)
