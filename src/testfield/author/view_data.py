"""What the 3-D page of a scene shows: its surfaces, targets and stations in the world frame, and what is predicted."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testfield.author.view_images import Drawings, drawings_of
from testfield.author.view_prints import PanelPrints, panel_prints
from testfield.author.view_surfaces import Surfaces, surfaces_of
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import directions
from testfield.errors import TestfieldError
from testfield.plan.job import Job
from testfield.plan.predict import Prediction, predict_scene, widest_deg
from testfield.targets.field import TIME

FRUSTUM = 0.12
"""Length of a frustum as a part of the distance to what its station sees."""
WIDEST = 3.0
"""A corner's ray is drawn no further across the optical axis than this many times along it."""


@dataclass(frozen=True)
class Stations:
    """S images: `name` and `camera` (empty where there is one) of each, projection centres `eye_mm` (S, 3), unit
    optical axes `axis` (S, 3), `corners_mm` (S, 4, 3) the ends of the frusta, `reach_mm` (S,) the median distance to
    what is seen, `size_px` (S, 2) width and height of the images."""

    name: tuple[str, ...]
    camera: tuple[str, ...]
    eye_mm: np.ndarray
    axis: np.ndarray
    corners_mm: np.ndarray
    reach_mm: np.ndarray
    size_px: np.ndarray


@dataclass(frozen=True)
class Actual:
    """A finished run beside its prediction, of the targets (t,): `error_mm` (t, 3) measured less true in the world
    frame, NaN where a target was not measured, and `axes_mm` (t, 3, 3) of the ellipsoids that the run states.
    `method` measured them; `fitted` whether a rigid fit came before, as a free network needs."""

    error_mm: np.ndarray
    axes_mm: np.ndarray
    method: str
    fitted: bool


@dataclass(frozen=True)
class ViewData:
    """All that the page draws, in mm in the world frame.

    `rays` and `angle_deg` (m,) of the world's marks: how many images see each, and the widest angle between two of
    their rays, 0 with fewer than two. `target` (t,) the marks that are free-standing coded targets; `axes_mm`
    (t, 3, 3) has the half-axes of their predicted standard error ellipsoids as columns, so that the covariance is
    `axes @ axes.T`; NaN where nothing is predicted. `notes` say what a reader should know.
    """

    job: Job
    stations: Stations
    surfaces: Surfaces
    prints: PanelPrints
    drawings: Drawings
    rays: np.ndarray
    angle_deg: np.ndarray
    target: np.ndarray
    axes_mm: np.ndarray
    notes: tuple[str, ...]
    actual: Actual | None = None

    @cached_property
    def target_names(self) -> tuple[str, ...]:
        """Codes of the targets as people say them."""
        codes = self.job.world.marks.code[self.target].tolist()
        return tuple(f"{c % TIME} at time {c // TIME}" if c > TIME else str(c) for c in codes)

    @property
    def u_mm(self) -> np.ndarray:
        """(t,) predicted standard uncertainties of the targets, roots of the three axes' squares."""
        return np.sqrt((self.axes_mm**2).sum(axis=(1, 2)))


def view_data(job: Job) -> ViewData:
    """What is to be shown of a scene. Where its network cannot be predicted the notes say why, and the rest is shown.

    Raises `TestfieldError` where there is neither a station nor a mark.
    """
    world, rows = job.world, job.expected
    if not len(world.marks) or not len(job.images):
        what = "no target and no board" if not len(world.marks) else "no station"
        raise TestfieldError(f"there is nothing to see: {what}", job.source, "enter boards, targets and stations")
    count = len(world.marks)
    eye = job.poses.origin_mm
    ray = eye[rows.station] - world.mark_world_mm[rows.mark]
    target = np.flatnonzero((world.marks.board < 0) & (world.marks.code > 0))
    notes: list[str] = []
    try:
        axes = _predicted(predict_scene(job), target, notes)
    except TestfieldError as error:
        axes = np.full((len(target), 3, 3), np.nan)
        notes.append(f"no uncertainty is predicted: {error.sentence()}")
    surfaces, left_out = surfaces_of(world)
    drawings, thinned = drawings_of(job, interiors_of(job))
    return ViewData(
        job=job,
        stations=_stations(job),
        surfaces=surfaces,
        prints=panel_prints(world),
        drawings=drawings,
        rays=np.bincount(rows.mark, minlength=count),
        angle_deg=widest_deg(ray, rows.mark, count),
        target=target,
        axes_mm=axes,
        notes=(*notes, *left_out, *thinned),
    )


def _predicted(found: Prediction, target: np.ndarray, notes: list[str]) -> np.ndarray:
    """(t, 3, 3) half-axes of the targets' ellipsoids, turned into the world frame."""
    notes += found.notes
    place = {int(code): k for k, code in enumerate(found.code)}
    row = np.array([place.get(int(code), -1) for code in found.job.world.marks.code[target]], int)
    axes = np.full((len(target), 3, 3), np.nan)
    axes[row >= 0] = found.planned.datum.R[0] @ half_axes(found.blocks[row[row >= 0]])
    return axes


def half_axes(covariance: np.ndarray) -> np.ndarray:
    """(n, 3, 3) half-axes of the standard error ellipsoids of covariances (n, 3, 3), as columns, shortest first."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0))[:, None, :])


def interiors_of(job: Job) -> tuple[Interior, ...]:
    """The true interior orientation of every image."""
    if not job.several:
        return (job.world.interior,) * len(job.images)
    return tuple(
        world.interior for part, world in zip(job.parts, job.worlds, strict=True) for _ in range(len(part.images))
    )


def _stations(job: Job) -> Stations:
    poses, rows = job.poses, job.expected
    eye, interiors = poses.origin_mm, interiors_of(job)
    distance = np.linalg.norm(eye[rows.station] - job.world.mark_world_mm[rows.mark], axis=1)
    usual = float(np.median(distance)) if len(distance) else 1000.0
    reach = np.full(len(eye), usual)
    for s in np.unique(rows.station):
        reach[s] = np.median(distance[rows.station == s])
    corners = np.stack([_frustum(one, poses[k : k + 1], FRUSTUM * reach[k]) for k, one in enumerate(interiors)])
    cameras = tuple(plan.camera for part in job.parts for plan in part.images)
    return Stations(
        name=job.images,
        camera=cameras if job.several else ("",) * len(eye),
        eye_mm=eye,
        axis=poses.R[:, 2],
        corners_mm=corners,
        reach_mm=reach,
        size_px=np.array([[one.width_px, one.height_px] for one in interiors]),
    )


def _frustum(interior: Interior, pose: Poses, length_mm: float) -> np.ndarray:
    """(4, 3) where the rays of an image's corners end; those outside the lens' domain are the nearest inside it."""
    middle = (np.array([interior.width_px, interior.height_px]) - 1) / 2
    found = np.zeros((4, 3))
    for k, corner in enumerate(interior.corners_px):
        line = middle + np.linspace(1, 0, 33)[:, None] * (corner - middle)
        ray = directions(interior, line)
        good = np.isfinite(ray).all(axis=1)
        good &= ray[:, 2] * WIDEST > np.hypot(ray[:, 0], ray[:, 1])
        found[k] = ray[np.argmax(good)] if good.any() else [0, 0, 1]
    found *= (length_mm / found[:, 2])[:, None]
    return np.asarray(found @ pose.R[0] + pose.origin_mm[0])
