"""OpenCV's calibration with the release of the object (Strobl and Hirzinger 2011) as an opponent."""

import cv2
import numpy as np

from testfield.adjust.network import HELD, Camera, Distances, Images, Network, information_of
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.edges import Edges, board_edges, left_out
from testfield.calibrate.homography import image_middle
from testfield.calibrate.opencv import (
    CRITERIA,
    FISHEYE,
    camera_of,
    coefficients_of,
    first_guess,
    flags_of,
    names_of,
    poses_of,
)
from testfield.calibrate.quality import board_quality, joints, residual_test
from testfield.calibrate.rejections import of_joints
from testfield.calibrate.rows import best_board, on_one_board, usable_rows
from testfield.calibrate.views import OWN_WORD, evaluated
from testfield.camera.pose import Poses
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field, NominalBoard

LEAST_COMMON = 8
WITHOUT_SCHUR = getattr(cv2, "CALIB_DISABLE_SCHUR_COMPLEMENT", 0)
"""OpenCV 5 releases the object only without its reduced normal equations, which earlier ones do not have."""


@register("calibrators", "opencv_ro")
def opencv_ro(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    board: str | None = None,
) -> Calibration:
    """`cv2.calibrateCameraRO`: one board whose marks are unknown but for three that hold its frame.

    The board is the one called `board`, or that of which most marks were observed. OpenCV asks that every view shows
    the same marks, so views that show few are left out, and of the others the marks they have in common are used.
    Raises `TestfieldError` where that leaves too little, and for a lens that this function of OpenCV does not have.
    """
    if names_of(lens).name == FISHEYE:
        raise TestfieldError(
            f"OpenCV releases no object with the lens '{lens}'", "measure.lens", "choose another lens, as brown"
        )
    rows, turned_down, notes = usable_rows(observations, field)
    rows, field = on_one_board(rows, field, best_board(rows, field, board))
    sheet = field.boards[0]
    edges, why, said = board_edges(rows, field, image_middle(width_px, height_px))
    turned_down, notes = turned_down + left_out(rows, field, why), notes + said
    chosen, points = _common(edges, rows)
    edges = edges.take(chosen)
    order, at = _ordered(sheet, points)
    xyz = np.column_stack([sheet.marks.xy_mm[order], np.zeros(len(order))])
    start, free = first_guess(edges, width_px, height_px, lens, hold)
    seen = [{int(rows.point[k]): k for k in here} for here in edges.rows]
    used = np.array([[view[int(point)] for point in order] for view in seen])
    found = cv2.calibrateCameraRO(
        [xyz.astype(np.float32)] * len(edges),
        [rows.xy_px[k].astype(np.float32) for k in used],
        (width_px, height_px),
        at,
        start.matrix,
        coefficients_of(start),
        criteria=CRITERIA,
        flags=flags_of(lens, hold) | cv2.CALIB_USE_INTRINSIC_GUESS | WITHOUT_SCHUR,
    )
    interior, poses = camera_of(start, found[1], found[2]), poses_of(found[3], found[4])
    new = np.reshape(found[5], (-1, 3)).astype(float)

    n, views = len(order), len(edges)
    u = np.full((n, 3), np.inf)
    u[[0, at]] = [sheet.u_xy_mm, sheet.u_xy_mm, sheet.u_z_mm]
    u[-1, 2] = sheet.u_z_mm
    network = Network(
        cameras=(Camera.of(interior, free),),
        stations=poses,
        images=Images.one_camera(views),
        boards=Poses.identity(1),
        ways=(HELD,),
        point_mm=new,
        point_board=np.zeros(n, int),
        known_mm=new,
        information=information_of(u),
        image=np.repeat(np.arange(views), n),
        point=np.tile(np.arange(n), views),
        xy_px=rows.xy_px[used.ravel()],
        cov_px2=np.tile(np.eye(2), (n * views, 1, 1)),
        offset_px=np.zeros((n * views, 2)),
        distances=Distances(),
        scale=1.0,
        u_scale=field.u_scale,
    )
    stations, boards = tuple(rows.stations[s] for s in edges.station), (sheet.name,)
    labels = network.labels(stations, boards)
    adjustment = evaluated(network, labels, int(free.sum()) + 6 * views + 3 * n - 7)
    seen_edges = joints(adjustment, stations, boards)
    notes += [f"only board '{sheet.name}' is used: {n} marks that {views} views have in common", OWN_WORD]
    calibration = Calibration(
        method="opencv_ro",
        interior=interior,
        station_names=stations,
        stations=poses,
        board_names=boards,
        boards=Poses.identity(1),
        scale=1.0,
        covariance=adjustment.covariance,
        labels=tuple(labels),
        sigma0=adjustment.sigma0,
        freedom=adjustment.freedom,
        reprojection_rms_px=float(np.sqrt((adjustment.residual_px**2).sum(axis=1).mean())),
        used=n * views,
        rejected=tuple(turned_down),
        residual_at_px=network.xy_px,
        residual_px=adjustment.residual_px,
        graph=tuple((e["station"], e["board"], e["marks"]) for e in seen_edges),
        notes=tuple(notes),
        joints=seen_edges,
        board_quality=board_quality(adjustment.covariance, tuple(labels), boards, seen_edges),
        test=residual_test(adjustment),
    )
    return of_joints(calibration)


def _common(edges: Edges, rows: Observations) -> tuple[np.ndarray, np.ndarray]:
    """(E,) which views together show the most, and the marks (k,) that all of them show."""
    order = np.argsort(-edges.marks, kind="stable")
    common, best = None, (0, 0)
    sets: list[np.ndarray] = []
    for count, e in enumerate(order, 1):
        points = rows.point[edges.rows[e]]
        common = points if common is None else np.intersect1d(common, points)
        sets.append(np.unique(common))
        if count >= 3 and len(sets[-1]) >= LEAST_COMMON and count * len(sets[-1]) > best[0]:
            best = (count * len(sets[-1]), count)
    if not best[1]:
        raise TestfieldError(
            f"no three views show {LEAST_COMMON} marks of the board in common, which the release of the object needs",
            do="show the whole board in several images",
        )
    chosen = np.zeros(len(edges), bool)
    chosen[order[: best[1]]] = True
    return chosen, sets[best[1] - 1]


def _ordered(sheet: NominalBoard, points: np.ndarray) -> tuple[np.ndarray, int]:
    """The marks in the order that makes OpenCV hold three corners: the first, that at the place returned, the last."""
    x, y = sheet.marks.xy_mm[points].T
    first, second, last = points[np.argmin(x + y)], points[np.argmax(x - y)], points[np.argmax(y - x)]
    rest = [p for p in points if p not in (first, second, last)]
    return np.array([first, second, *rest, last]), 1
