"""From an adjustment to the calibration that is handed on, with everything a reader should doubt."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.adjust.network import Layout, Network
from testfield.adjust.weakness import weak_unknowns
from testfield.calibrate.calibration import AXES, Calibration, point_label
from testfield.calibrate.edges import left_out
from testfield.calibrate.imaging import Imaging, exterior_by_network, relative_orientations
from testfield.calibrate.misfit import Misfit
from testfield.calibrate.quality import board_quality, joints, residual_test
from testfield.calibrate.rejections import of_boards
from testfield.calibrate.rows import rejection
from testfield.calibrate.settle import doubts_of_geometry, settled
from testfield.calibrate.settled import Settled
from testfield.calibrate.start import Start
from testfield.camera.interior import MODE
from testfield.detect.observations import Observations
from testfield.targets.field import Field


def calibrated(
    method: str,
    begin: Callable[[Observations, frozenset[int]], Start],
    rows: Observations,
    field: Field,
    turned_down: list[dict],
    notes: list[str],
    empirical: bool = False,
    misfit: Misfit | None = None,
) -> Calibration:
    """The calibration from the start that `begin` makes of observations without some boards of the sheet: of all at
    first, then without images that contradict the others on the whole and boards whose sheets turn out to be wrong.

    `empirical` and `misfit` as in `settle.settled`.
    """
    left_out: frozenset[int] = frozenset()
    failures: tuple[str, ...] = ()
    records: tuple[dict, ...] = ()
    while True:
        start = begin(rows, left_out)
        found = settled(start, rows, empirical, misfit)
        if found.lost is not None:
            station = rows.stations.index(start.stations[found.lost])
            here = rows.station == station
            why = "of an image that contradicts the others"
            turned_down = turned_down + [rejection(rows, field, k, None, why) for k in np.flatnonzero(here).tolist()]
            rows = rows.take(~here)
        elif found.wrong is not None:
            failures, records = (*failures, *found.failures), (*records, *found.certificates)
            wrong = [sheet.name for sheet in field.boards].index(start.boards[found.wrong])
            left_out |= {wrong}
        else:
            found = replace(found, failures=(*failures, *found.failures), certificates=(*records, *found.certificates))
            return finished(method, found, start, rows, field, turned_down, notes)


def finished(
    method: str,
    found: Settled,
    start: Start,
    rows: Observations,
    field: Field,
    turned_down: list[dict],
    notes: list[str],
) -> Calibration:
    """The calibration of a settled start; `turned_down` and `notes` are what was said before it."""
    adjustment, network = found.adjustment, found.adjustment.network
    loose = network.seen_points[network.point_board[network.seen_points] < 0]
    code_of = dict(zip(start.network.point.tolist(), rows.code[start.rows].tolist(), strict=True))
    codes = np.array([code_of[k] for k in loose.tolist()], int)
    covariance, names = with_points(adjustment, start.labels(network), loose, codes)
    edges, test = joints(adjustment, start.stations, start.boards), residual_test(found.plain or adjustment)
    doubts = doubts_of(adjustment, start, covariance, names, test, found.plain is not None)
    covariance, names = by_images(covariance, names, network, start.stations)
    records = left_out(rows, field, start.why)
    calibration = Calibration(
        method=method,
        interior=network.interior,
        station_names=start.stations,
        stations=network.camera_from_datum(),
        board_names=start.boards,
        boards=network.boards,
        scale=network.scale,
        covariance=covariance,
        labels=names,
        sigma0=adjustment.sigma0 * np.sqrt(found.widened),
        freedom=adjustment.freedom,
        reprojection_rms_px=float(np.sqrt((adjustment.residual_px**2).sum(axis=1).mean())),
        used=len(network.xy_px),
        rejected=tuple(turned_down + records + found.rejected),
        residual_at_px=network.xy_px,
        residual_px=adjustment.residual_px,
        graph=start.graph,
        notes=tuple(notes + start.notes + found.notes + doubts),
        joints=edges,
        board_quality=board_quality(covariance, names, start.boards, edges),
        test=test,
        misfit=found.misfit.card,
        point_code=codes,
        point_mm=network.point_mm[loose],
        certificates=found.certificates,
        failures=found.failures,
        **several(network, start.imaging),
    )
    return of_boards(calibration, rows.take(start.rows[found.left]), field)


def by_images(
    covariance: np.ndarray, names: tuple[str, ...], network: Network, images: tuple[str, ...]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """The covariance with the exterior orientation of every image in the place of those of stations; rig members stay.

    Where every image has a station of its own, nothing changes.
    """
    at = Layout.of(network)
    own = tuple(f"station:{image}.{axis}" for image in images for axis in AXES)
    named = (*names[: at.station], *own, *names[at.member :])
    if len(network.members) == 1 and np.array_equal(network.images.station, np.arange(len(network.stations))):
        return covariance, named
    member_end = int(at.board[0])
    by = exterior_by_network(network)
    count = len(by)
    A = np.zeros((len(names) + count - (at.member - at.station), len(names)))
    A[: at.station, : at.station] = np.eye(at.station)
    A[at.station : at.station + count, at.station : member_end] = by
    rest = len(names) - at.member
    A[at.station + count :, at.member :] = np.eye(rest)
    return A @ covariance @ A.T, named


def several(network: Network, imaging: Imaging | None) -> dict[str, Any]:
    """What a calibration of several cameras has beside that of one."""
    if imaging is None or len(network.cameras) == 1:
        return {}
    return {
        "more_cameras": network.interiors[1:],
        "camera_names": tuple(camera.name for camera in imaging.cameras),
        "image_camera": network.images.camera,
        "residual_camera": network.camera,
        "rigs": relative_orientations(imaging, network),
    }


def with_points(
    adjustment: Adjustment, labels: list[str], points: np.ndarray, codes: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Covariance of an adjustment's cameras, stations, boards and scale together with the loose `points` of `codes`,
    and the names of all these unknowns."""
    index = np.arange(len(labels) - 3 * len(adjustment.network.kept_points))
    across = adjustment.cov.across(points)[:, index]
    covariance = np.block(
        [[adjustment.covariance[np.ix_(index, index)], across.T], [across, adjustment.cov.points(points)]]
    )
    named = [f"{point_label(code)}.{axis}" for code in codes for axis in "xyz"]
    return covariance, (*labels[: len(index)], *named)


def doubts_of(
    adjustment: Adjustment, start: Start, covariance: np.ndarray, labels: tuple[str, ...], test: dict, of_model: bool
) -> list[str]:
    """Sentences on weak unknowns with the geometry to blame, on observations without control, on a failed test;
    `of_model` where that is a test of the lens model alone, and more was found from the residuals since."""
    notes = doubts_of_geometry(adjustment.network, start)
    own = [k for k, label in enumerate(labels) if not label.startswith(("point:", MODE))]
    notes += weak_unknowns(covariance[np.ix_(own, own)], [labels[k] for k in own])
    if test["uncontrolled"]:
        notes.append(
            f"{test['uncontrolled']} observation(s) are controlled by no other: their errors would show in no residual"
        )
    if np.isfinite(test["variance"]) and test["variance"] > test["high"]:
        notes.append(
            f"{'by the lens model alone ' if of_model else ''}the residuals are larger than claimed: variance factor "
            f"{test['variance']:.3g}, of true claims at most {test['high']:.3g} in 97.5 cases of 100 "
            f"({test['freedom']} degrees of freedom)"
        )
    if test["passed"] and test["contradict"] > test["contradict_at_most"]:
        notes.append(
            f"{test['contradict']} observations contradict the others at the level at which "
            f"{test['contradict_at_most']} good ones may: look for misread marks and covered targets"
        )
    return notes
