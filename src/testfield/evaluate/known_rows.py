"""The two rows whose figures are known beforehand: the truth as estimate, which has no error, and the same broken by
known amounts. They are scored like any recipe's results, centres, camera, boards and points."""

from dataclasses import replace
from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import Poses
from testfield.chain.run import Run
from testfield.detect.observations import MEASURED, Observations
from testfield.evaluate.compared_columns import centre_columns
from testfield.evaluate.measured import flat
from testfield.evaluate.metrics import CENTRE, CORNER, POINTS
from testfield.reconstruct.points import Points
from testfield.scene.world import BAR, CHECK, World
from testfield.score.camera import score_boards, true_in_datum
from testfield.score.detection import EXPECTED_PX, score_detection
from testfield.score.points import score_lengths, score_points, world_scale
from testfield.score.scorecard import plain
from testfield.score.several import score_cameras

TRUTH, BROKEN = "the truth itself", "broken on purpose"
SHIFT_PX = 0.5
"""By which the broken one's centres are off in x: what half a pixel's mistake in conventions does."""
STRETCH = 1e-2
"""Part by which its principal distances, its boards' scale and its points are too large."""
SHIFT_MM = 1.0
"""By which its boards are off in x, all but the first, which is the datum."""
KNOWN = "known."
"""What a column begins with that says what another one must hold."""
BOARDS, SCALE = "boards.pose_rms_mm", "lengths.scale_error_ppm"
ZERO = 1e-9
"""An error in px or mm is none below this; one in ppm below a thousand times this."""
ROUNDING = 1e-6
"""Part by which a planted error may come out otherwise."""
WITHIN = {CORNER.key: 0.5}
"""The same where more than rounding decides: a turn of the camera takes a part of what a wrong distance does."""


def known_row(run: Run, kind: str) -> dict[str, Any]:
    """The row of `TRUTH` or `BROKEN` of a run's scene: the scorecard by its paths, the centres' errors, and under
    `KNOWN` what the figures must be."""
    broken = kind == BROKEN
    world, cameras = run.world, run.truth.cameras or {"": run.world}
    seen, calibration = true_observations(run, broken), true_calibration(run, broken)
    points = true_points(world, calibration, broken)
    score = score_detection(world, run.views, seen)
    of_points = score_points(world, calibration, points)
    card = {
        "detection": score.card(),
        "calibration": {"method": kind} | score_cameras(cameras, calibration),
        "boards": score_boards(world, calibration),
        "points": {"method": kind} | of_points.card(),
        "lengths": score_lengths(world, calibration, points),
    }
    row = flat(plain(card)) | centre_columns(score, run.views)
    middle = of_points.true_mm.mean(axis=0) if len(of_points.code) > 2 else 0.0  # fewer are not fitted
    spread = of_points.true_mm - middle
    corner = max(
        float(np.linalg.norm(one.interior.corners_px - one.interior.parameters[2:4], axis=1).max())
        for one in cameras.values()
    )
    planted = {
        CENTRE.key: SHIFT_PX / np.sqrt(2),
        CORNER.key: STRETCH * corner,
        BOARDS: SHIFT_MM if len(calibration.board_names) > 1 else 0.0,
        SCALE: 1e6 * STRETCH * world_scale(world) if calibration.board_names else None,
        POINTS.key: STRETCH * float(np.sqrt((spread**2).mean())) if len(spread) else None,
    }
    must_be = {key: value if broken else 0.0 for key, value in planted.items() if value is not None and key in row}
    return row | {KNOWN + key: value for key, value in must_be.items()}


def as_known(key: str, found: float, known: float) -> bool:
    """Whether a figure came out as it had to."""
    if known == 0:
        return bool(abs(found) < (1e3 if key.endswith("_ppm") else 1.0) * ZERO)
    return bool(abs(found - known) <= WITHIN.get(key, ROUNDING) * known)


def true_observations(run: Run, broken: bool = False) -> Observations:
    """What a detector without any error would find of all expected targets; where broken, half a pixel to the right."""
    views, marks = run.views, run.world.marks
    station, mark = np.nonzero((views.visible == 1) & (views.diameter_px >= EXPECTED_PX))
    n, size = len(mark), views.diameter_px[station, mark] / 4
    return Observations(
        stations=run.stations,
        station=station,
        xy_px=views.disc_px[station, mark] + [SHIFT_PX * broken, 0.0],
        cov_px2=np.tile(np.eye(2), (n, 1, 1)),
        moments_px2=size[:, None, None] ** 2 * np.eye(2),
        code=marks.code[mark],
        board=marks.board[mark],
        point=marks.point[mark],
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
    )


def true_calibration(run: Run, broken: bool = False) -> Calibration:
    """The true cameras, exterior orientations and boards in the frame of the first board, or of the world where there
    is none; where broken, with other principal distances, boards and scale."""
    world, cameras = run.world, run.truth.cameras
    names = tuple(board.name for board in world.field.boards)
    datum, boards = true_in_datum(world, names)
    interiors = [one.interior for one in (cameras or {"": world}).values()]
    if broken:
        longer = [np.where(np.arange(len(one.parameters)) < 2, 1 + STRETCH, 1.0) for one in interiors]
        interiors = [one.with_parameters(one.parameters * by) for one, by in zip(interiors, longer, strict=True)]
        shift = np.where(np.arange(len(names))[:, None] > 0, [SHIFT_MM, 0.0, 0.0], 0.0)
        boards = Poses(boards.R, boards.t_mm + shift.reshape(boards.t_mm.shape))
    stations = len(world.station_name)
    found = Calibration(
        method=BROKEN if broken else TRUTH,
        interior=interiors[0],
        station_names=world.station_name,
        stations=world.camera_from_world.after(datum[np.zeros(stations, int)]),
        board_names=names,
        boards=boards,
        scale=(1 + STRETCH * broken) * world_scale(world) if names else 1.0,
        covariance=np.zeros((0, 0)),
        labels=(),
        sigma0=1.0,
        freedom=0,
        reprojection_rms_px=0.0,
        used=0,
    )
    if len(interiors) == 1:
        return found
    of_image = run.truth.by_cameras(true_observations(run)).cameras
    number = [list(cameras).index(name) for name in of_image]
    return replace(
        found, more_cameras=tuple(interiors[1:]), camera_names=tuple(cameras), image_camera=np.array(number, int)
    )


def true_points(world: World, calibration: Calibration, broken: bool = False) -> Points:
    """The true places of all coded targets that belong to no board, in the calibration's frame; where broken, too far
    apart."""
    datum, _ = true_in_datum(world, calibration.board_names)
    here = np.flatnonzero(np.isin(world.marks.role, [CHECK, BAR]) & (world.marks.code > 0))
    xyz = datum.inverse()[np.zeros(len(here), int)].apply(world.mark_world_mm[here])
    n = len(here)
    return Points(
        method=calibration.method,
        code=world.marks.code[here],
        xyz_mm=xyz * (1 + STRETCH * broken),
        cov_xyz_mm2=np.full((3 * n, 3 * n), np.nan),
        rays=np.zeros(n, int),
        residual_rms_px=np.full(n, np.nan),
        rejected=np.zeros(n, int),
    )
