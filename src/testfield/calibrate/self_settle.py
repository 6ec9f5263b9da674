"""A free network at rest: outliers rejected one after another, discs' offsets of the network's own values."""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2 as chi_squared

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Distances
from testfield.adjust.reliability import reliability
from testfield.calibrate.loose_discs import disc_offsets
from testfield.calibrate.loose_network import loose_network
from testfield.calibrate.self_job import Job
from testfield.calibrate.ties import LEAST_COMMON, LEAST_RAYS, Ties
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError

FALSE_ALARM = 0.05
"""Chance that any good observation at all is called a gross error."""
ROUNDS = 12
SETTLED_PX = 1e-7


def settle(job: Job, reject: bool = True) -> tuple[Job, Adjustment]:
    """Adjust until nothing is rejected any more and the discs' offsets stand still."""
    job = with_offsets(job)
    for _ in range(ROUNDS):
        adjustment = adjust(job.network, job.labels)
        job = replace(job, network=adjustment.network)
        size = reliability(adjustment).test
        size = size / max(float(np.median(size)) / 1.1774, 1.0)
        limit = np.sqrt(chi_squared.ppf(1 - FALSE_ALARM / len(size), 2))
        # A bad sight drags its neighbours along: only the worst go in one round.
        bad = (size > limit) & (size > 0.5 * size.max()) & reject
        if bad.any():
            job = _without(job, bad, size)
            job = with_offsets(job)
            continue
        before = job.network.offset_px
        job = with_offsets(job)
        if np.allclose(job.network.offset_px, before, rtol=0, atol=SETTLED_PX):
            return job, adjustment
    adjustment = adjust(job.network, job.labels)
    return replace(job, network=adjustment.network), adjustment


def with_offsets(job: Job) -> Job:
    """The job with discs' offsets of its network's present values."""
    offset = disc_offsets(job.network, job.ties.moments_px2, job.radius_mm)
    return replace(job, network=replace(job.network, offset_px=offset))


def _without(job: Job, bad: np.ndarray, size: np.ndarray) -> Job:
    """The job without some sights, and without what can no longer be determined then."""
    ties = job.ties
    records = [
        {
            "station": ties.stations[ties.image[k]],
            "board": "",
            "code": int(ties.code[ties.point[k]]),
            "x_px": float(ties.xy_px[k, 0]),
            "y_px": float(ties.xy_px[k, 1]),
            "sigmas": float(size[k]),
            "why": "contradicts all others",
        }
        for k in np.flatnonzero(bad)
    ]
    said = list(job.notes)
    network, kept = job.network, ties.take(~bad)
    all_stations = np.ones(len(ties.stations), bool)
    ties, poses, points, stations, which = _reduced(kept, all_stations, network.stations, network.point_mm, said)
    number = np.full(len(network.point_mm), -1)
    number[which] = np.arange(len(which))
    ends = number[network.distances.ends]
    whole = (ends >= 0).all(axis=1)
    network = replace(
        loose_network(ties, network.cameras, network.images.camera[stations], poses, points),
        known_mm=network.known_mm[which],
        information=network.information[which],
        distances=Distances(ends[whole], network.distances.length_mm[whole], network.distances.u_mm[whole]),
    )
    return replace(
        job,
        network=network,
        ties=ties,
        radius_mm=job.radius_mm[which],
        rejected=job.rejected + tuple(records),
        notes=tuple(said),
    )


def of_images(ties: Ties, images: np.ndarray) -> Ties:
    """Ties of some images (a mask), renumbered; points keep their numbers."""
    number = np.cumsum(images) - 1
    some = ties.take(images[ties.image])
    stations = tuple(name for name, there in zip(ties.stations, images, strict=True) if there)
    return replace(some, stations=stations, image=number[some.image])


def compact(
    ties: Ties, reached: np.ndarray, poses: Poses, points: np.ndarray, known: np.ndarray, notes: list[str]
) -> tuple[Ties, Poses, np.ndarray]:
    """Sights of those images that are `reached` (I,) and points that are `known` (n,), with their poses and places, as
    far as they tell enough; what is left out is added to the notes."""
    ties = ties.take(known[ties.point])
    ties, poses, points, _, _ = _reduced(ties, reached, poses, points, notes)
    return ties, poses, points


def _reduced(
    ties: Ties, stations: np.ndarray, poses: Poses, points: np.ndarray, notes: list[str]
) -> tuple[Ties, Poses, np.ndarray, np.ndarray, np.ndarray]:
    """Only images with enough points and points with enough images, renumbered; which images and points are left."""
    keep = stations.copy()
    while True:
        use = keep[ties.image]
        rays = np.bincount(ties.point[use], minlength=len(points))
        use &= rays[ties.point] >= LEAST_RAYS
        sights = np.bincount(ties.image[use], minlength=len(keep))
        poor = keep & (sights < LEAST_COMMON - 1)
        if not poor.any():
            break
        for i in np.flatnonzero(poor):
            notes.append(f"image '{ties.stations[i]}' shows only {sights[i]} points that can be used and is left out")
        keep &= ~poor
    if keep.sum() < 2:
        raise TestfieldError(
            "fewer than two images are left that can be joined", "observations", "take images that overlap more"
        )
    ties = ties.take(use)
    left = np.unique(ties.point)
    number = np.full(len(points), -1)
    number[left] = np.arange(len(left))
    ties = replace(of_images(ties, keep), code=ties.code[left])
    ties = replace(ties, point=number[ties.point])
    return ties, poses[keep], points[left], np.flatnonzero(keep), left
