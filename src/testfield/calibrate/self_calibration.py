"""Self-calibration: no boards, only numbered points and a scale bar; the free network with the lens in it."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Camera
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.certificates import attached, doubtful_scale, tested, without_certificates
from testfield.calibrate.certified import Certified, in_datum
from testfield.calibrate.finish import by_images, with_points
from testfield.calibrate.homography import image_middle
from testfield.calibrate.imaging import Imaging, imaging_of
from testfield.calibrate.lens_misfit import with_lens_misfit, without_lens_misfit
from testfield.calibrate.loose_network import loose_network
from testfield.calibrate.misfit import (
    NO_MISFIT,
    Misfit,
    Names,
    misfit_of,
    scatter_note,
    widened,
    widened_by_images,
)
from testfield.calibrate.self_cameras import (
    as_one_camera,
    camera_of,
    first_cameras,
    fronts_only,
    standing,
    standing_still,
)
from testfield.calibrate.self_job import FreeNetwork, Job
from testfield.calibrate.self_lens import free_what_is_determined
from testfield.calibrate.self_result import by_scale, doubts_of, result_of
from testfield.calibrate.self_settle import compact, of_images, settle
from testfield.calibrate.self_start import SQUARE, start_from_nothing
from testfield.calibrate.settle import MISFIT_ROUNDS
from testfield.calibrate.ties import LEAST_COMMON, Ties, coded_ties, largest_group
from testfield.camera.interior import check_held
from testfield.camera.pose import Poses
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.camera_sheet import CameraSheet
from testfield.targets.field import Field


@register("calibrators", "self")
def self_calibration(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    cameras: tuple[CameraSheet, ...] = (),
    rigs: str = "constrained",
) -> Calibration:
    """No boards: coded targets seen from many places, a control bar for the scale.

    Of the field's sheet only the bars' lengths and the dots' diameters are used. Loose targets that are no bar's ends
    are left to reconstruction wherever the other codes suffice, so that what is claimed of them is true.
    """
    imaging = imaging_of(observations, cameras, field.rigs, rigs) if cameras else None
    observations, said = fronts_only(observations, field, imaging, image_middle(width_px, height_px))
    diameter = dict(field.loose)
    tied = {c for bar in field.scale_bars if bar.role == "control" for c in bar.codes}
    for board in field.boards:
        codes = board.marks.code > 0
        diameter |= dict(zip(board.marks.code[codes].tolist(), board.marks.diameter_mm[codes].tolist(), strict=True))
        tied |= set(board.marks.code[codes].tolist())
    certified = Certified(field.scale_bars, {}, diameter)
    ties, _ = coded_ties(observations, np.array(sorted(tied), int))
    enough = len(ties) and np.bincount(ties.image, minlength=len(ties.stations)).min() >= 2 * LEAST_COMMON
    ties, notes = coded_ties(observations, np.array(sorted(tied if enough else diameter), int))
    if not enough:
        notes.append("all loose targets take part in the calibration: too few other codes are in sight")
    found = free_network(ties, width_px, height_px, lens, hold, certified, notes=said + notes, imaging=imaging)
    loose = np.isin(found.code, list(field.loose))
    seen = found.adjustment.network.seen_points[loose]
    covariance, labels = with_points(found.adjustment, found.labels, seen, found.code[loose])
    covariance, labels = by_images(covariance, labels, found.adjustment.network, found.calibration.station_names)
    covariance = covariance + by_scale(found.adjustment.network, found.job.ties, labels, found.scale_from)
    return replace(
        found.calibration,
        covariance=covariance,
        labels=labels,
        point_code=found.code[loose],
        point_mm=found.xyz_mm[loose],
    )


def free_network(
    ties: Ties,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    certified: Certified | None = None,
    focal_px: float | None = None,
    empirical: bool = False,
    notes: list[str] | None = None,
    misfit: Misfit | None = None,
    imaging: Imaging | None = None,
) -> FreeNetwork:
    """Camera, stations and points from the sights of numbered points.

    `hold` names lens coefficients that are held at zero; `focal_px` is a first guess, not needed; `empirical` widens
    all covariances where observations scatter more than they claim; `misfit` as in `settle.settled`; `imaging` says
    which of several cameras took which image, of all images. Raises `TestfieldError` where no group of images is
    joined, or nothing can be oriented.
    """
    said = list(notes or [])
    check_held(hold, lens)
    if len(ties.stations) < 2 or len(ties) == 0:
        raise TestfieldError(
            f"{len(np.unique(ties.image))} image(s) show coded targets",
            "observations",
            "take images from at least three places",
        )
    group, alone = largest_group(ties)
    said += alone
    if group.sum() < 2:
        raise TestfieldError(
            f"no two images have {LEAST_COMMON} coded targets in common",
            "observations",
            "take images that overlap, with more codes in sight; where most rings are not read, look at target.kind "
            "and target.radii",
        )
    images_of = dict(zip(ties.code.tolist(), np.bincount(ties.point, minlength=len(ties.code)).tolist(), strict=True))
    ties = of_images(ties, group)
    common = np.bincount(ties.image, weights=(np.bincount(ties.point) > 1)[ties.point], minlength=len(ties.stations))
    shared = dict(zip(ties.stations, common.astype(int).tolist(), strict=True))
    alike, sizes = as_one_camera(ties, imaging, (width_px, height_px))
    start = start_from_nothing(alike, *sizes[0], lens, focal_px)
    for i in np.flatnonzero(~start.reached):
        said.append(f"image '{ties.stations[i]}' cannot be joined to the others and is left out")
    ties, poses, points = compact(ties, start.reached, start.poses, start.point_mm, start.known, said)
    cameras = tuple(
        Camera(one, np.zeros(len(one.parameters)), one.parameters, u_aspect=SQUARE)
        for one in first_cameras(start.interior, sizes, imaging)
    )
    network = loose_network(ties, cameras, camera_of(ties, imaging), poses, points)
    names = tuple(camera.name for camera in imaging.cameras) if imaging else ()
    network, _ = free_what_is_determined(network, ties.stations, hold, names)
    datum = in_datum(network, ties, certified or Certified(), images_of)
    job = Job(
        network=datum.network,
        ties=ties,
        radius_mm=datum.radius_mm,
        scale_from=datum.scale_from,
        rejected=(),
        notes=tuple(said) + datum.notes,
        certified=datum.usable,
        shared=shared,
        failures=_not_used(certified or Certified(), datum.scale_from),
        imaging=imaging,
    )
    return settled(job, hold, empirical, misfit)


def _not_used(certified: Certified, scale_from: str) -> tuple[str, ...]:
    """A sentence where a scale or a frame is certified that the result does not have."""
    control = [bar for bar in certified.bars if bar.role == "control"]
    if certified.known and scale_from != "control points":
        return ("the certified places cannot be used: the result is not in their frame",)
    if control and scale_from not in ("control points", "distances"):
        names = ", ".join(f"'{bar.name}'" for bar in control)
        return (f"the scale is not that of the certified distances: none of them can be used ({names})",)
    return ()


def settled(job: Job, hold: tuple[str, ...], empirical: bool, misfit: Misfit | None = None) -> FreeNetwork:
    """The final adjustment of a job: gross errors rejected, discs at rest, the lens asked once more.

    The images decide alone on their observations and on what the model does not follow, so that no wrong
    certificate costs any; then on the certificates.
    """
    alone = without_certificates(without_lens_misfit(job.network), job.ties, job.certified)
    first = replace(job, network=alone)
    job, adjustment = settle(first)
    network, lens_notes = free_what_is_determined(job.network, job.ties.stations, hold, job.cameras)
    bare, adjustment = settle(replace(job, network=network))
    given = misfit
    misfit, bare, adjustment = _followed(first, bare, adjustment, misfit)
    held = tested(adjustment, bare.ties, bare.certified, bare.scale_from)
    job = replace(bare, scale_from=held.scale_from)
    if held.bars or held.known:
        network, radius_mm = attached(bare.network, bare.ties, bare.radius_mm, held, bare.certified)
        job, adjustment = settle(replace(job, network=network, radius_mm=radius_mm), reject=False)
    if held.known:  # places in space may tell of the lens what images of a plane do not
        network, lens_notes = free_what_is_determined(
            without_lens_misfit(job.network), job.ties.stations, hold, job.cameras
        )
        network = with_lens_misfit(network, misfit.lens, _names(job)) if misfit.lens else network
        job, adjustment = settle(replace(job, network=network), reject=False)
    free = job
    if standing(job):
        job, adjustment = standing_still(job)
    notes = [*job.notes, *lens_notes, *held.notes, *doubts_of(job, adjustment)]
    notes += misfit.notes
    notes += doubtful_scale(adjustment.network, job.ties, held)
    factor = misfit.variance
    if empirical or misfit.found:
        adjustment, more = widened(adjustment, _names(job))
        factor *= more
    if factor > 1:
        notes.append(scatter_note(factor))
    if empirical or misfit.found:
        adjustment, misfit, said = widened_by_images(adjustment, misfit, given, empirical)
        notes = [*notes, *said]
    again = tuple(
        replace(now, u=before.u, u_aspect=before.u_aspect)
        for now, before in zip(free.network.cameras, bare.network.cameras, strict=True)
    )
    begin = replace(free, network=replace(free.network, cameras=again))
    found = result_of(replace(job, network=adjustment.network), adjustment, tuple(notes), np.sqrt(factor), held)
    return replace(found, begin=begin, calibration=replace(found.calibration, misfit=misfit.card))


def _names(job: Job) -> Names:
    return lambda network: replace(job, network=network).labels


def _followed(first: Job, job: Job, adjustment: Adjustment, given: Misfit | None) -> tuple[Misfit, Job, Adjustment]:
    """What the model does not follow, and everything settled again with it, beginning with all observations of the
    `first` job: those that the model alone had turned down may be good. Asked again, without it, where other
    observations are turned down then."""
    misfit, plain, rejected = NO_MISFIT, adjustment, len(job.rejected)
    for _ in range(MISFIT_ROUNDS):
        seen = given or misfit_of(plain, _names(job), plain.freedom)
        if not seen.found:
            break
        misfit = seen
        there = misfit.applied(plain.network, _names(job))
        job, adjustment = settle(_begun_again(first, replace(job, network=there), misfit.variance))
        if given or len(job.rejected) == rejected:
            break
        rejected = len(job.rejected)
        network = job.network
        again = replace(without_lens_misfit(network), cov_px2=network.cov_px2 / misfit.variance)
        plain = adjust(again, _names(job)(again))
    return misfit, job, adjustment


def _begun_again(first: Job, job: Job, variance: float) -> Job:
    """The `first` job at what was found since, its observations' covariances multiplied by a variance factor."""
    network, found = first.network, job.network
    stations, points = network.stations, network.point_mm.copy()
    R, t = stations.R.copy(), stations.t_mm.copy()
    place = {name: k for k, name in enumerate(first.ties.stations)}
    here = [place[name] for name in job.ties.stations]
    R[here], t[here] = found.stations.R, found.stations.t_mm
    place_of = {int(code): k for k, code in enumerate(first.ties.code)}
    points[[place_of[int(code)] for code in job.ties.code]] = found.point_mm
    return replace(
        first,
        network=replace(
            network, cameras=found.cameras, stations=Poses(R, t), point_mm=points, cov_px2=variance * network.cov_px2
        ),
    )
