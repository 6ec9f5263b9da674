"""From the adjustment of a free network to what is handed on, with everything a reader should doubt."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.adjust.datum import open_motions
from testfield.adjust.factor import Factor
from testfield.adjust.network import Network
from testfield.adjust.weakness import weak_unknowns
from testfield.calibrate.calibration import Calibration, point_label
from testfield.calibrate.certificates import Tested
from testfield.calibrate.finish import by_images, several
from testfield.calibrate.misclosure import U_DIAMETER
from testfield.calibrate.quality import residual_test
from testfield.calibrate.rejections import lost_images, of_ties
from testfield.calibrate.self_job import FreeNetwork, Job
from testfield.calibrate.settled import NOT_CONVERGED
from testfield.calibrate.ties import LEAST_COMMON, LEAST_RAYS, Ties, point_name
from testfield.camera.interior import MODE
from testfield.camera.pose import Poses


def doubts_of(job: Job, adjustment: Adjustment) -> list[str]:
    """Sentences on what an adjustment leaves weak."""
    notes = []
    if not adjustment.converged:
        notes.append(f"{NOT_CONVERGED} after {adjustment.steps} steps")
    labels = job.labels
    normal = adjustment.equations.reduced(0.0)[0]
    inverse = Factor(normal, labels, open_motions(adjustment.network)[0]).inverse()
    own = [k for k, label in enumerate(labels) if not label.startswith(MODE)]
    notes += weak_unknowns(inverse[np.ix_(own, own)], [labels[k] for k in own])
    rays = np.bincount(adjustment.network.point, minlength=len(job.ties.code))
    two = np.flatnonzero(rays == LEAST_RAYS)
    if len(two):
        notes.append(f"{len(two)} of {int((rays > 0).sum())} points are seen in two images only: hardly controlled")
    return notes


def result_of(job: Job, adjustment: Adjustment, notes: tuple[str, ...], misfit: float, held: Tested) -> FreeNetwork:
    """The result of an adjusted job: all standard deviations of the observations `misfit` times what was claimed."""
    network, ties = adjustment.network, job.ties
    labels = replace(job, network=network).labels
    index = np.arange(len(labels) - 3 * len(network.kept_points))
    seen = network.seen_points
    size2 = (adjustment.residual_px**2).sum(axis=1)
    rays = np.bincount(network.point, minlength=len(ties.code))
    rms = np.sqrt(np.bincount(network.point, weights=size2, minlength=len(ties.code)) / np.maximum(rays, 1))
    turned_down = {int(c): 0 for c in ties.code}
    for record in job.rejected:
        turned_down[record["code"]] = turned_down.get(record["code"], 0) + 1
    cov, named = by_images(
        adjustment.covariance[np.ix_(index, index)], tuple(labels[: len(index)]), network, ties.stations
    )
    calibration = Calibration(
        method="self",
        interior=network.interior,
        station_names=ties.stations,
        stations=network.camera_from_datum(),
        board_names=(),
        boards=Poses.identity(0),
        scale=1.0,
        covariance=cov + by_scale(network, ties, named, job.scale_from),
        labels=named,
        sigma0=adjustment.sigma0 * misfit,
        freedom=adjustment.freedom,
        reprojection_rms_px=float(np.sqrt(size2.mean())),
        used=len(network.xy_px),
        rejected=job.rejected,
        residual_at_px=network.xy_px,
        residual_px=adjustment.residual_px,
        graph=(),
        notes=notes,
        test=residual_test(adjustment),
        certificates=held.records,
        failures=(*job.failures, *held.failures, *lost_images(job.shared, ties.stations, 2 * LEAST_COMMON)),
        **several(network, job.imaging),
    )
    own = [label for code in ties.code[seen] for label in (f"{point_name(int(code))}.{axis}" for axis in "xyz")]
    ends = {code: bar.name for bar in job.certified.bars for code in bar.codes}
    calibration = of_ties(calibration, network.image, ties.code[network.point], ends)
    return FreeNetwork(
        calibration=calibration,
        code=ties.code[seen],
        xyz_mm=network.point_mm[seen],
        cov_xyz_mm2=adjustment.cov.points(seen) + by_scale(network, ties, own, job.scale_from),
        rays=rays[seen],
        residual_rms_px=rms[seen],
        rejected=np.array([turned_down[int(c)] for c in ties.code[seen]], int),
        scale_from=job.scale_from,
        job=job,
        adjustment=adjustment,
        begin=job,
    )


def by_scale(network: Network, ties: Ties, labels: Sequence[str], scale_from: str) -> np.ndarray:
    """What the uncertainty of a scale by the dots' diameters adds to the covariance of the unknowns named: all places
    move away from the origin together. Nothing where the scale is from something else."""
    if scale_from != "diameters":
        return np.zeros((len(labels), len(labels)))
    moved: dict[str, float] = dict.fromkeys(labels, 0.0)
    for name, t in zip(ties.stations, network.camera_from_datum().t_mm, strict=True):
        moved |= {f"station:{name}.t{axis}": value for axis, value in zip("xyz", t.tolist(), strict=True)}
    for code, xyz in zip(ties.code, network.point_mm, strict=True):
        for name in (point_name(int(code)), point_label(int(code))):
            moved |= {f"{name}.{axis}": value for axis, value in zip("xyz", xyz.tolist(), strict=True)}
    column = U_DIAMETER * np.array([moved[label] for label in labels])
    return np.outer(column, column)
