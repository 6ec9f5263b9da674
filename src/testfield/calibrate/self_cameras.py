"""Several cameras in a free network: begun as if they were one, then each with a lens of its own."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.calibrate.edges import front_only
from testfield.calibrate.imaging import Imaging, images_of, known_members, placed_on_rigs
from testfield.calibrate.self_job import Job
from testfield.calibrate.self_settle import settle
from testfield.calibrate.ties import Ties
from testfield.camera.interior import Interior
from testfield.detect.observations import Observations
from testfield.targets.field import Field

Size = tuple[int, int]


def fronts_only(
    observations: Observations, field: Field, imaging: Imaging | None, middle_px: np.ndarray
) -> tuple[Observations, list[str]]:
    """`front_only`, of each camera's images by themselves."""
    if imaging is None or len(imaging.cameras) == 1:
        return front_only(observations, field, middle_px)
    status = observations.status.copy()
    notes: list[str] = []
    for k, sheet in enumerate(imaging.cameras):
        own = np.flatnonzero(imaging.camera[observations.station] == k)
        middle = (np.array(sheet.size_px) - 1) / 2
        seen, said = front_only(observations.take(own), field, middle)
        status[own], notes = seen.status, notes + said
    return replace(observations, status=status), notes


def camera_of(ties: Ties, imaging: Imaging | None) -> np.ndarray:
    """(I,) the camera of each image of the ties."""
    if imaging is None:
        return np.zeros(len(ties.stations), int)
    return imaging.camera[imaging.numbers(ties.stations)]


def as_one_camera(ties: Ties, imaging: Imaging | None, size_px: Size) -> tuple[Ties, list[Size]]:
    """The sights as the first camera would have them if all had its angle of view, and the cameras' sizes in px."""
    if imaging is None:
        return ties, [size_px]
    sizes = [camera.size_px for camera in imaging.cameras]
    camera = camera_of(ties, imaging)[ties.image]
    middle = (np.array(sizes) - 1) / 2
    factor = sizes[0][0] / np.array([width for width, _ in sizes])
    xy = middle[0] + factor[camera, None] * (ties.xy_px - middle[camera])
    return replace(ties, xy_px=xy, cov_px2=factor[camera, None, None] ** 2 * ties.cov_px2), sizes


def first_cameras(found: Interior, sizes: list[Size], imaging: Imaging | None) -> list[Interior]:
    """The cameras as the one that stands for them all says."""
    if imaging is None:
        return [found]
    cameras = []
    for (width, height), sheet in zip(sizes, imaging.cameras, strict=True):
        parameters = found.parameters.copy()
        parameters[:2] *= width / sizes[0][0]
        parameters[2:4] = (width - 1) / 2, (height - 1) / 2
        cameras.append(Interior(width, height, parameters, sheet.lens))
    return cameras


def standing(job: Job) -> bool:
    """Whether some images share a place, or a rig."""
    return job.imaging is not None and (bool(job.imaging.members) or job.imaging.shares_places)


def standing_still(job: Job) -> tuple[Job, Adjustment]:
    """The job at rest with one exterior orientation for each place of a camera or a rig, instead of one for each
    image. Nothing more is rejected."""
    imaging = job.imaging
    assert imaging is not None
    here = imaging.numbers(job.ties.stations)
    network, weight = job.network, np.zeros(len(imaging.camera))
    weight[here] = np.bincount(job.ties.image, minlength=len(here))
    poses = imaging.blank()
    poses.R[here], poses.t_mm[here] = network.stations.R, network.stations.t_mm
    stations, members, _ = placed_on_rigs(imaging, poses, weight)
    places = np.unique(imaging.station[here])
    still = replace(
        network,
        stations=stations[places],
        members=members,
        images=images_of(imaging, here, places),
        known_members=known_members(imaging),
    )
    return settle(replace(job, network=still, places=tuple(imaging.places[p] for p in places)), reject=False)
