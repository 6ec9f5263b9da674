"""How well a target anywhere in the volume would be known: slices through what is measured."""

from dataclasses import dataclass

import numpy as np

from testfield.plan.points import by_all
from testfield.plan.predict import Prediction, rays_at
from testfield.simulate.expected import Expected

CELLS = 22
"""Places along the longer side of a slice."""
MARGIN = 0.08
MOST_IMAGES = 60
"""Of more images these many, evenly chosen, make the map, with the noise lowered to make up for the others."""


@dataclass(frozen=True)
class Slice:
    """Places on a plane square to world axis `across` (0 to 2) at `at_mm`: coordinates `u_axis_mm` (c,) along axis
    `axes[0]` and `v_axis_mm` (r,) along `axes[1]`; `u_mm` (r, c) standard uncertainty, root of the axes' sum, NaN where
    fewer than two stations see a target; `weak` (r, c, 2) the longest half-axis of the error ellipsoid on the plane, in
    mm; `rays` (r, c)."""

    across: int
    at_mm: float
    axes: tuple[int, int]
    u_axis_mm: np.ndarray
    v_axis_mm: np.ndarray
    u_mm: np.ndarray
    weak: np.ndarray
    rays: np.ndarray


def slices_of(found: Prediction) -> list[Slice]:
    """Plan and elevation through the middle of everything that is measured."""
    targets = found.job.world.mark_world_mm
    low, high = targets.min(axis=0), targets.max(axis=0)
    pad = MARGIN * float((high - low).max())
    return [_slice(found, across, axes, low - pad, high + pad) for across, axes in ((2, (0, 1)), (1, (0, 2)))]


def _slice(found: Prediction, across: int, axes: tuple[int, int], low: np.ndarray, high: np.ndarray) -> Slice:
    longest = max(high[axes[0]] - low[axes[0]], high[axes[1]] - low[axes[1]])
    along = [
        np.linspace(low[a], high[a], max(6, round(CELLS * float(high[a] - low[a]) / float(longest)))) for a in axes
    ]
    u, v = np.meshgrid(*along)
    at_mm = float((low[across] + high[across]) / 2)
    places = np.full((u.size, 3), at_mm)
    places[:, axes[0]], places[:, axes[1]] = u.ravel(), v.ravel()
    covariance, rays = covariance_at(found, places)
    # The covariance is of the datum frame; the map is drawn in the world's.
    R = found.planned.datum.R[0]
    world = R @ covariance @ R.T
    flat = world[:, axes][:, :, axes]
    good = np.isfinite(flat).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(np.where(good[:, None, None], flat, np.eye(2)))
    weak = np.where(good[:, None], vectors[:, :, 1] * np.sqrt(values[:, 1:]), np.nan)
    size = np.sqrt(np.einsum("nii->n", covariance))
    shape = u.shape
    return Slice(
        across, at_mm, axes, along[0], along[1], size.reshape(shape), weak.reshape(*shape, 2), rays.reshape(shape)
    )


def covariance_at(found: Prediction, places_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, 3) covariance in the datum frame of a target at each of these places (n, 3) in the world, turned to the
    middle of the stations, NaN where fewer than two images show it; and its rays (n,)."""
    job, plan = found.job, found.planned
    loose = [d for d in job.field.loose.values()] or job.world.marks.diameter_mm.tolist()
    toward = job.poses.origin_mm.mean(axis=0) - places_mm
    normal = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    seen, begin = [], 0
    for expecting, world in zip(job.expecting, job.worlds, strict=True):
        virtual = expecting.elsewhere(places_mm, normal, float(np.median(loose)))
        # A proposal's world has stations that the parts' own do not.
        poses = job.world.camera_from_world if not job.several else world.camera_from_world
        own = virtual.at(poses)
        seen.append(Expected(**(vars(own) | {"station": own.station + begin})))
        begin += len(poses)
    rows = Expected.join(seen)
    number = np.full(len(job.images), -1)
    number[plan.images] = np.arange(len(plan.images))
    rows = rows.take(number[rows.station] >= 0)
    image = number[rows.station]
    factor = 1.0
    if len(plan.images) > MOST_IMAGES:
        chosen = np.isin(image, np.linspace(0, len(plan.images) - 1, MOST_IMAGES).astype(int))
        rows, image = rows.take(chosen), image[chosen]
        factor = MOST_IMAGES / len(plan.images)
    count = np.bincount(rows.mark, minlength=len(places_mm))
    _, stood = np.unique(job.poses.origin_mm.round(6), axis=0, return_inverse=True)
    pairs = np.unique(np.column_stack([rows.mark, stood.ravel()[rows.station]]), axis=0)
    met = np.bincount(pairs[:, 0], minlength=len(places_mm)) >= 2
    answer = np.full((len(places_mm), 3, 3), np.nan)
    if met.any():
        use = met[rows.mark]
        place = np.cumsum(met) - 1
        rays = rays_at(
            plan,
            found.labels,
            plan.datum.inverse()[np.zeros(int(met.sum()), int)].apply(places_mm[met]),
            place[rows.mark[use]],
            image[use],
            factor * rows.cov_px2[use],
        )
        answer[met] = by_all(rays, found.shared).blocks()
    return answer, np.round(count / factor).astype(int)
