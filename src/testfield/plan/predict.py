"""Everything that a scorecard would hold, as standard uncertainties, before any image."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Network
from testfield.adjust.reliability import NONCENTRALITY, Reliability, reliability
from testfield.calibrate.finish import by_images, with_points
from testfield.errors import TestfieldError
from testfield.plan.job import Job
from testfield.plan.network import Planned, planned
from testfield.plan.points import (
    MOST_FLOPS,
    SAMPLE,
    PointCovariance,
    Rays,
    by_all,
    by_pixels,
    flops_of,
    information_of_points,
    rays_of,
)
from testfield.scene.world import CHECK


@dataclass(frozen=True)
class Prediction:
    """A plan's figures.

    `adjustment` of the calibration at its true values; `shared` (P, P) the covariance of everything that points share,
    of unknowns `labels`, exterior orientations by image; `points` of the loose targets `code` (n,) at `xyz_mm` (n, 3)
    in the datum frame, seen in `rays` (n,) images within `angle_deg` (n,) of each other. `notes` for the reader.
    """

    planned: Planned
    adjustment: Adjustment
    shared: np.ndarray
    labels: tuple[str, ...]
    points: PointCovariance
    code: np.ndarray
    xyz_mm: np.ndarray
    rays: np.ndarray
    angle_deg: np.ndarray
    notes: tuple[str, ...]

    @property
    def job(self) -> Job:
        """What was planned."""
        return self.planned.job

    @cached_property
    def reliability(self) -> Reliability:
        """How well the calibration's observations control each other."""
        return reliability(self.adjustment)

    @cached_property
    def blocks(self) -> np.ndarray:
        """(n, 3, 3) covariance of every point, in mm^2."""
        return self.points.blocks()

    @property
    def u_mm(self) -> np.ndarray:
        """(n, 3) standard uncertainties of all coordinates."""
        return np.sqrt(np.einsum("nii->ni", self.blocks))

    @cached_property
    def is_check(self) -> np.ndarray:
        """(n,) which points are check targets."""
        marks = self.job.world.marks
        return np.isin(self.code, marks.code[(marks.role == CHECK) & (marks.board < 0)])

    def rows(self, codes: tuple[int, ...]) -> np.ndarray | None:
        """Places of codes among the points; None where one of them is not measured."""
        place = {int(code): k for k, code in enumerate(self.code)}
        found = [place.get(int(code), -1) for code in codes]
        return None if min(found) < 0 else np.array(found)

    def index(self, names: list[str]) -> np.ndarray:
        """Places of unknowns in the covariance; unknowns that are held are left out."""
        place = {label: k for k, label in enumerate(self.labels)}
        return np.array([place[name] for name in names if name in place], int)


def predict_scene(job: Job, pixel_factor: float = 1.0) -> Prediction:
    """The figures of a job. `pixel_factor` multiplies all pixels' standard uncertainties, for studies of what limits.

    Raises `TestfieldError` for a datum defect, and where the network leaves an unknown undetermined, naming it.
    """
    return predict(planned(job), pixel_factor)


def predict(plan: Planned, pixel_factor: float = 1.0) -> Prediction:
    """The figures of a planned network."""
    network = plan.calibration
    if pixel_factor != 1.0:
        network = _scaled(network, pixel_factor)
    adjustment = determined(plan, network)
    control = np.arange(plan.first, len(network.point_mm))
    codes = plan.codes[plan.control_points - plan.first]
    shared, names = with_points(adjustment, plan.labels(network), control, codes)
    shared, names = by_images(shared, names, network, plan.image_names)
    rays = _rays(plan, names, pixel_factor)
    method, notes = plan.job.scene.measure.reconstructor, list(plan.notes)
    if not len(rays.count):
        nothing = np.zeros((0, len(shared)))
        points = PointCovariance(np.zeros((0, 3, 3)), nothing, shared, "none")
    elif method == "bundle":
        shared = _posterior(shared, information_of_points(rays, len(shared)))
        points = by_pixels(rays, shared)
    elif method == "gls" and flops_of(rays, shared) <= MOST_FLOPS:
        points = by_all(rays, shared)
    else:
        points = by_pixels(rays, shared)
        notes += [_other_weights(rays, shared, points)] if method == "gls" and len(points) else []
        notes += [] if method in ("gls", "ml") else [f"reconstructor '{method}': predicted as by 'ml'"]
    if (calibrator := plan.job.scene.measure.calibrator) in ("self", "tsai", "dlt", "colmap", "opencv_ro"):
        notes.append(f"calibrator '{calibrator}': predicted as one bundle of the boards it uses")
    points, code = _with_control(points, plan, names)
    order = np.argsort(code)
    points, code = points.take(order), code[order]
    numbers = plan.points_of(code)
    return Prediction(
        planned=plan,
        adjustment=adjustment,
        shared=shared,
        labels=names,
        points=points,
        code=code,
        xyz_mm=plan.network.point_mm[numbers],
        rays=np.bincount(plan.network.point, minlength=len(plan.network.point_mm))[numbers],
        angle_deg=widest_angles(plan, numbers),
        notes=tuple(notes),
    )


def determined(plan: Planned, network: Network) -> Adjustment:
    """The network's equations at its values. Raises `TestfieldError`, with what weakens it, where it is singular."""
    from testfield.calibrate.doubts import geometric_doubts

    try:
        return adjust(network, plan.labels(network), most_steps=0)
    except TestfieldError as error:
        boards = tuple(plan.job.field.boards[b].name for b in plan.boards)
        cameras = tuple(camera.name for camera in plan.job.imaging.cameras)
        doubts = geometric_doubts(network, plan.image_names, boards, cameras)
        raise TestfieldError("; ".join([error.what, *doubts]), f"{plan.job.source}, stations", error.do) from error


def _scaled(network: Network, factor: float) -> Network:
    from dataclasses import replace

    return replace(network, cov_px2=factor**2 * network.cov_px2)


def _rays(plan: Planned, names: tuple[str, ...], pixel_factor: float) -> Rays:
    """Rays of the loose points that the calibration does not adjust itself."""
    network = plan.network
    adjusted = np.zeros(len(network.point_mm), bool)
    adjusted[plan.control_points] = True
    here = np.flatnonzero((network.point >= plan.first) & ~adjusted[network.point])
    number = np.cumsum(~adjusted[plan.first :]) - 1
    return rays_at(
        plan,
        names,
        network.point_mm[plan.first :][~adjusted[plan.first :]],
        number[network.point[here] - plan.first],
        network.image[here],
        pixel_factor**2 * network.cov_px2[here],
    )


def rays_at(
    plan: Planned,
    names: tuple[str, ...],
    xyz_mm: np.ndarray,
    point: np.ndarray,
    image: np.ndarray,
    cov_px2: np.ndarray,
) -> Rays:
    """Rays of points (n, 3) in the datum frame, of which observations `point` (m,) in `image` (m,) of the network state
    `cov_px2` (m, 2, 2); `names` are those of the shared unknowns."""
    network = plan.network
    place = {name: k for k, name in enumerate(names)}
    several, interior_at = len(network.cameras) > 1, []
    for camera, sheet in zip(network.cameras, plan.job.imaging.cameras, strict=True):
        prefix = f"camera:{sheet.name}." if several else ""
        chosen = np.flatnonzero(camera.unknown)
        interior_at.append((chosen, np.array([place[prefix + camera.interior.names[k]] for k in chosen], int)))
    return rays_of(
        xyz_mm,
        point,
        image,
        cov_px2,
        network.camera_from_datum(),
        network.images.camera,
        network.interiors,
        interior_at,
        np.array([place[f"station:{name}.rx"] for name in plan.image_names]),
    )


def _with_control(points: PointCovariance, plan: Planned, names: tuple[str, ...]) -> tuple[PointCovariance, np.ndarray]:
    """The points and, after them, those that the calibration adjusted itself; codes of all."""
    control = plan.codes[plan.control_points - plan.first]
    met = np.setdiff1d(plan.codes, control)
    place = {name: k for k, name in enumerate(names)}
    unit = np.zeros((3 * len(control), len(names)))
    at = [place[f"point:{int(code)}.{axis}"] for code in control for axis in "xyz"]
    unit[np.arange(len(unit)), np.array(at, int)] = 1
    own = np.concatenate([points.own, np.zeros((len(control), 3, 3))])
    return (
        PointCovariance(own, np.concatenate([points.by_shared, unit]), points.shared, points.weights),
        np.concatenate([met, control]).astype(int),
    )


def _posterior(prior: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Covariance after information was added to a prior that may be singular."""
    found = np.linalg.solve(np.eye(len(prior)) + prior @ information, prior)
    return 0.5 * (found + found.T)


def _other_weights(rays: Rays, shared: np.ndarray, points: PointCovariance) -> str:
    """What a sample of points says of the weights that were left out."""
    chosen = np.unique(np.linspace(0, len(points) - 1, SAMPLE).astype(int))
    row = np.concatenate([np.arange(rays.first[k], rays.first[k + 1]) for k in chosen])
    first = np.concatenate([[0], np.cumsum(rays.count[chosen])])
    part = Rays(first, rays.by_point[row], rays.by_shared[row], rays.columns[row])
    squares = [np.trace(kind(part, shared).blocks(), axis1=1, axis2=2) for kind in (by_all, by_pixels)]
    ratio = np.sqrt(squares[0] / squares[1])
    return (
        f"points are weighed by their pixels alone, for speed; by generalised least squares their uncertainties are "
        f"{np.median(ratio):.3f} of these ({len(chosen)} points sampled)"
    )


def widest_angles(plan: Planned, numbers: np.ndarray) -> np.ndarray:
    """(k,) largest angle in degrees between two rays of each point, as `widest_deg` has it."""
    network = plan.network
    ray = network.camera_from_datum().origin_mm[network.image] - network.datum_mm()[network.point]
    return widest_deg(ray, network.point, len(network.point_mm))[numbers]


def widest_deg(ray: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """(count,) largest angle in degrees between two of the rays (m, 3) of each point (m,), 0 without two: to a few
    degrees, for rays are compared with the one that is farthest from their mean."""
    ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    mean = np.column_stack([np.bincount(point, ray[:, k], count) for k in range(3)])
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    for _ in range(2):
        cosine = np.einsum("mi,mi->m", ray, mean[point])
        order = np.lexsort((cosine, point))
        first = order[np.unique(point[order], return_index=True)[1]]
        least = np.ones(count)
        least[point[first]] = cosine[first]
        mean = mean.copy()
        mean[point[first]] = ray[first]
    return np.asarray(np.degrees(np.arccos(np.clip(least, -1, 1))))


def detectable(u: float, redundancy: float = 1.0) -> float | None:
    """The smallest error that is found in 80 cases of 100 at the significance 0.001 (Baarda 1968): None without
    control."""
    return float(np.sqrt(NONCENTRALITY / redundancy) * u) if redundancy > 0.01 else None
