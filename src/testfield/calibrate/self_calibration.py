"""Self-calibration: no boards, only numbered points and a scale bar; the free network with the lens in it.

What images cannot tell of the lens is named, and held to what anybody knows of a lens unseen: with that uncertainty,
not exactly, so that what is claimed of everything else is true. Which parameters those are is asked one group after
another: a group is freed when all that is free is then known better than so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2 as chi_squared

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.datum import open_motions
from testfield.adjust.network import Camera, Distances, Images, Network
from testfield.adjust.normal import Factor
from testfield.adjust.reliability import reliability
from testfield.adjust.weakness import weak_unknowns
from testfield.calibrate.calibration import Calibration, point_label
from testfield.calibrate.certificates import U_DIAMETER, Tested, attached, doubtful_scale, tested, without_certificates
from testfield.calibrate.certified import Certified, in_datum
from testfield.calibrate.edges import front_only
from testfield.calibrate.finish import with_points
from testfield.calibrate.homography import image_middle
from testfield.calibrate.lens_misfit import with_lens_misfit, without_lens_misfit
from testfield.calibrate.loose_discs import disc_offsets
from testfield.calibrate.misfit import NO_MISFIT, Misfit, Names, misfit_of, scatter_note, widened
from testfield.calibrate.quality import residual_test
from testfield.calibrate.rejections import lost_images, of_ties
from testfield.calibrate.self_start import SQUARE, loose_network, start_from_nothing
from testfield.calibrate.settle import MISFIT_ROUNDS
from testfield.calibrate.ties import LEAST_COMMON, LEAST_RAYS, Ties, coded_ties, largest_group, point_name
from testfield.camera.interior import MODE, Interior, check_held
from testfield.camera.pose import Poses
from testfield.camera.project import camera_jacobian
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field

FALSE_ALARM = 0.05
"""Chance that any good observation at all is called a gross error."""
ROUNDS = 12
SETTLED_PX = 1e-7
GUESSED = {"focal length": 0.2, "principal point": 0.015, "aspect": 1e-3, "lens": 0.002}
"""How well anybody knows a lens unseen: the focal length as a part of itself; the principal point as a part of the
image's width; fy / fx; a coefficient by what it moves at the outermost point, as a part of the image's width. What a
network tells less well than this it does not determine."""


@dataclass(frozen=True)
class FreeNetwork:
    """The result of a self-calibration.

    `calibration` with stations in the datum; points `code` (n,) (negative: dots without a code) at `xyz_mm` (n, 3) with
    joint covariance `cov_xyz_mm2` (3n, 3n), seen in `rays` (n,) images with `residual_rms_px` (n,), `rejected` (n,)
    sights turned down; `scale_from` what the scale rests on; `job` from which `settled` would begin again, without
    what is said in the end; `adjustment` itself.
    """

    calibration: Calibration
    code: np.ndarray
    xyz_mm: np.ndarray
    cov_xyz_mm2: np.ndarray
    rays: np.ndarray
    residual_rms_px: np.ndarray
    rejected: np.ndarray
    scale_from: str
    job: "Job"
    adjustment: Adjustment

    @property
    def labels(self) -> list[str]:
        """Names of the adjustment's unknowns."""
        return replace(self.job, network=self.adjustment.network).labels


@dataclass(frozen=True)
class Job:
    """What is adjusted: `network`, its `ties` in the same order, `radius_mm` (n,) of the discs (NaN: none), `stations`
    names; `rejected` records; `notes`; what is `certified`, tested or not; `shared` targets that each image had in
    common with others to begin with; `failures` that were there before anything was adjusted."""

    network: Network
    ties: Ties
    radius_mm: np.ndarray
    scale_from: str
    rejected: tuple[dict, ...]
    notes: tuple[str, ...]
    certified: Certified
    shared: dict[str, int]
    failures: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """Names of the unknowns."""
        names = tuple(point_name(int(c)) for c in self.ties.code)
        return self.network.labels(self.ties.stations, (), (), names)


@register("calibrators", "self")
def self_calibration(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """No boards: coded targets seen from many places, a control bar for the scale.

    Of the field's sheet only the bars' lengths and the dots' diameters are used. Loose targets that are no bar's ends
    are left to reconstruction wherever the other codes suffice, so that what is claimed of them is true.
    """
    observations, said = front_only(observations, field, image_middle(width_px, height_px))
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
    found = free_network(ties, width_px, height_px, lens, hold, certified, notes=said + notes)
    loose = np.isin(found.code, list(field.loose))
    seen = found.adjustment.network.seen_points[loose]
    covariance, labels = with_points(found.adjustment, found.labels, seen, found.code[loose])
    covariance = covariance + by_scale(found.adjustment.network, found.job.ties, labels, found.scale_from)
    return replace(
        found.calibration, covariance=covariance, labels=labels, point_code=found.code[loose],
        point_mm=found.xyz_mm[loose],
    )  # fmt: skip


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
) -> FreeNetwork:
    """Camera, stations and points from the sights of numbered points.

    `hold` names lens coefficients that are held at zero; `focal_px` is a first guess, not needed; `empirical` widens
    all covariances where observations scatter more than they claim; `misfit` as in `settle.settled`. Raises
    `TestfieldError` where no group of images is joined, or nothing can be oriented.
    """
    said = list(notes or [])
    interior_names = Interior(width_px, height_px, np.zeros(0), lens).names
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
            f"no two images have {LEAST_COMMON} coded targets in common", "observations",
            "take images that overlap, with more codes in sight; where most rings are not read, look at target.kind "
            "and target.radii",
        )  # fmt: skip
    images_of = dict(zip(ties.code.tolist(), np.bincount(ties.point, minlength=len(ties.code)).tolist(), strict=True))
    ties = _of_images(ties, group)
    common = np.bincount(ties.image, weights=(np.bincount(ties.point) > 1)[ties.point], minlength=len(ties.stations))
    shared = dict(zip(ties.stations, common.astype(int).tolist(), strict=True))
    start = start_from_nothing(ties, width_px, height_px, lens, focal_px)
    for i in np.flatnonzero(~start.reached):
        said.append(f"image '{ties.stations[i]}' cannot be joined to the others and is left out")
    ties, poses, points = _compact(ties, start.reached, start.poses, start.point_mm, start.known, said)
    camera = Camera(start.interior, np.zeros(len(interior_names)), start.interior.parameters, u_aspect=SQUARE)
    network = loose_network(ties, start.interior, poses, points, camera)
    network, _ = free_what_is_determined(network, ties.stations, hold)
    datum = in_datum(network, ties, certified or Certified(), images_of)
    job = Job(
        datum.network, ties, datum.radius_mm, datum.scale_from, (), tuple(said) + datum.notes, datum.usable, shared,
        _not_used(certified or Certified(), datum.scale_from),
    )  # fmt: skip
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
    job, adjustment = _settle(first)
    network, lens_notes = free_what_is_determined(job.network, job.ties.stations, hold)
    bare, adjustment = _settle(replace(job, network=network))
    misfit, bare, adjustment = _followed(first, bare, adjustment, misfit)
    held = tested(adjustment, bare.ties, bare.certified, bare.scale_from)
    job = replace(bare, scale_from=held.scale_from)
    if held.bars or held.known:
        network, radius_mm = attached(bare.network, bare.ties, bare.radius_mm, held, bare.certified)
        job, adjustment = _settle(replace(job, network=network, radius_mm=radius_mm), reject=False)
    if held.known:  # places in space may tell of the lens what images of a plane do not
        network, lens_notes = free_what_is_determined(without_lens_misfit(job.network), job.ties.stations, hold)
        network = with_lens_misfit(network, misfit.lens, _names(job)) if misfit.lens else network
        job, adjustment = _settle(replace(job, network=network), reject=False)
    notes = [*job.notes, *lens_notes, *held.notes, *_doubts(job, adjustment)]
    notes += misfit.notes
    notes += doubtful_scale(adjustment.network, job.ties, held)
    factor = misfit.variance
    if empirical or misfit.found:
        adjustment, more = widened(adjustment, _names(job))
        factor *= more
    if factor > 1:
        notes.append(scatter_note(factor))
    again = replace(job.network.cameras[0], u=bare.network.cameras[0].u, u_aspect=bare.network.cameras[0].u_aspect)
    job = replace(job, network=replace(job.network, cameras=(again,)))
    found = _result(job, adjustment, tuple(notes), np.sqrt(factor), held)
    return replace(found, calibration=replace(found.calibration, misfit=misfit.card))


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
        job, adjustment = _settle(_begun_again(first, replace(job, network=there), misfit.variance))
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
        first, network=replace(
            network, cameras=found.cameras, stations=Poses(R, t), point_mm=points, cov_px2=variance * network.cov_px2
        ),
    )  # fmt: skip


def _doubts(job: Job, adjustment: Adjustment) -> list[str]:
    notes = []
    if not adjustment.converged:
        notes.append(f"the bundle had not converged after {adjustment.steps} steps")
    labels = job.labels
    normal = adjustment.equations.reduced(0.0)[0]
    inverse = Factor(normal, labels, open_motions(adjustment.network)[0]).solve(np.eye(len(normal)))
    own = [k for k, label in enumerate(labels) if not label.startswith(MODE)]
    notes += weak_unknowns(inverse[np.ix_(own, own)], [labels[k] for k in own])
    rays = np.bincount(adjustment.network.point, minlength=len(job.ties.code))
    two = np.flatnonzero(rays == LEAST_RAYS)
    if len(two):
        notes.append(f"{len(two)} of {int((rays > 0).sum())} points are seen in two images only: hardly controlled")
    return notes


def _result(job: Job, adjustment: Adjustment, notes: tuple[str, ...], misfit: float, held: Tested) -> FreeNetwork:
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
    calibration = Calibration(
        "self", network.interior, ties.stations, network.stations, (), Poses.identity(0), 1.0,
        adjustment.covariance[np.ix_(index, index)] + by_scale(network, ties, labels[: len(index)], job.scale_from),
        tuple(labels[: len(index)]), adjustment.sigma0 * misfit,
        adjustment.freedom, float(np.sqrt(size2.mean())), len(network.xy_px), job.rejected, network.xy_px,
        adjustment.residual_px, (), notes, test=residual_test(adjustment), certificates=held.records,
        failures=(*job.failures, *held.failures, *lost_images(job.shared, ties.stations, 2 * LEAST_COMMON)),
    )  # fmt: skip
    own = [label for code in ties.code[seen] for label in (f"{point_name(int(code))}.{axis}" for axis in "xyz")]
    ends = {code: bar.name for bar in job.certified.bars for code in bar.codes}
    calibration = of_ties(calibration, network.image, ties.code[network.point], ends)
    return FreeNetwork(
        calibration, ties.code[seen], network.point_mm[seen], 
        adjustment.cov.points(seen) + by_scale(network, ties, own, job.scale_from), rays[seen], rms[seen],
        np.array([turned_down[int(c)] for c in ties.code[seen]], int), job.scale_from, job, adjustment,
    )  # fmt: skip


def by_scale(network: Network, ties: Ties, labels: Sequence[str], scale_from: str) -> np.ndarray:
    """What the uncertainty of a scale by the dots' diameters adds to the covariance of the unknowns named: all places
    move away from the origin together. Nothing where the scale is from something else."""
    if scale_from != "diameters":
        return np.zeros((len(labels), len(labels)))
    moved: dict[str, float] = dict.fromkeys(labels, 0.0)
    for name, t in zip(ties.stations, network.stations.t_mm, strict=True):
        moved |= {f"station:{name}.t{axis}": value for axis, value in zip("xyz", t.tolist(), strict=True)}
    for code, xyz in zip(ties.code, network.point_mm, strict=True):
        for name in (point_name(int(code)), point_label(int(code))):
            moved |= {f"{name}.{axis}": value for axis, value in zip("xyz", xyz.tolist(), strict=True)}
    column = U_DIAMETER * np.array([moved[label] for label in labels])
    return np.outer(column, column)


# ------------------------------------------------------------------ which parameters of the lens
def parameter_groups(interior: Interior) -> list[tuple[str, ...]]:
    """Groups of lens parameters in the order in which they are asked for; `aspect` lets fy differ from fx."""
    first = interior.names[4]
    groups: list[tuple[str, ...]] = [("fx", "fy"), (first,), ("cx", "cy")]
    rest = [name for name in interior.names[5:]]
    pairs = [tuple(n for n in rest if n[0] == "p"), *((n,) for n in rest if n[0] != "p")]
    pairs = [group for group in pairs if group]
    second = [group for group in pairs if group == ("k2",)]
    others = [group for group in pairs if group != ("k2",)]
    decentring = [g for g in others if g[0][0] == "p"]
    return groups + second + decentring + [("aspect",)] + [g for g in others if g not in decentring]


def free_what_is_determined(
    network: Network, stations: tuple[str, ...], hold: tuple[str, ...]
) -> tuple[Network, list[str]]:
    """The network with more of its lens' parameters freed, as far as the images determine them, the others but those
    in `hold` known as well as of any lens, and what is said of these.

    Robust, and with covariances that follow the scatter, so that neither a misread code nor an unfinished lens decides.
    """
    names, camera = network.interior.names, network.cameras[0]
    free, square = np.isinf(camera.u), bool(np.isfinite(camera.u_aspect))
    centre = np.where(free, network.interior.parameters, camera.known)
    limits = _of_any_lens(network)
    notes: list[str] = []
    for group in parameter_groups(network.interior):
        if group == ("aspect",):
            wanted, with_square = free.copy(), False
            if not square or not free[:2].all():
                continue
        else:
            chosen = np.array([n in group and n not in hold for n in names])
            if not (chosen & ~free).any():
                continue
            wanted, with_square = free | chosen, square
        trial = _forgiving(_with_lens(network, wanted, with_square), stations)
        if trial is None:
            notes.append(f"{_said(group)} {_held(group, centre, limits, names)}: the images do not determine it")
            continue
        u = _lens_uncertainty(trial, wanted, with_square)
        worse = [name for name in u if u[name] > limits[name]]
        if worse:
            notes.append(_why_held(group, worse, u, _held(group, centre, limits, names), names))
            continue
        free, square, network = wanted, with_square, trial.network
        limits = _of_any_lens(network)
    guessed = np.array([0.0 if name in hold else limits[name] for name in names])
    camera = Camera(
        network.interior,
        np.where(free, np.inf, guessed),
        np.where(free, network.interior.parameters, centre),
        limits["aspect"] if square else np.inf,
    )
    return replace(network, cameras=(camera,)), notes


def _with_lens(network: Network, free: np.ndarray, square: bool) -> Network:
    interior = network.interior
    camera = Camera(interior, np.where(free, np.inf, 0.0), interior.parameters, SQUARE if square else np.inf)
    return replace(network, cameras=(camera,))


def _forgiving(network: Network, stations: tuple[str, ...]) -> Adjustment | None:
    """A robust adjustment whose covariances are those of the scatter; None where it does not come to rest."""
    labels = network.labels(stations, (), (), tuple(f"point{k}" for k in range(len(network.point_mm))))
    claimed = network.cov_px2
    found = None
    for _ in range(2):
        white = np.linalg.solve(np.linalg.cholesky(claimed), (network.xy_px - predict(network))[..., None])[..., 0]
        factor = max(float(np.median(np.linalg.norm(white, axis=1)) / 1.1774) ** 2, 1.0)
        try:
            found = adjust(replace(network, cov_px2=factor * claimed), labels, robust=True)
        except (TestfieldError, np.linalg.LinAlgError):
            return None
        if not found.converged or not np.isfinite(found.network.point_mm).all():
            return None
        network = replace(found.network, cov_px2=claimed)
    return replace(found, network=network) if found else None


def _lens_uncertainty(found: Adjustment, free: np.ndarray, square: bool) -> dict[str, float]:
    """Standard uncertainties of what is free of the lens."""
    interior, names = found.network.interior, found.network.interior.names
    place = np.cumsum(free) - 1
    C = found.covariance
    u = {name: float(np.sqrt(max(C[place[k], place[k]], 0))) for k, name in enumerate(names) if free[k]}
    if not square and free[:2].all():
        d = np.zeros(len(C))
        d[place[:2]] = [-1 / interior.fx, 1 / interior.fx]
        u["aspect"] = float(np.sqrt(max(d @ C @ d, 0)))
    return u


def _of_any_lens(network: Network) -> dict[str, float]:
    """Standard uncertainties with which the parameters of any lens are known that nobody has seen."""
    interior = network.interior
    at_camera = network.camera_from_datum()[network.image].apply(network.point_mm[network.point])
    _, by_interior, _ = camera_jacobian(interior, at_camera)
    reach = np.percentile(np.linalg.norm(by_interior, axis=1), 99, axis=0)
    moved = GUESSED["lens"] * interior.width_px / np.maximum(reach, 1e-12)
    limits = dict(zip(interior.names, moved.tolist(), strict=True))
    limits |= {name: GUESSED["focal length"] * interior.fx for name in interior.names[:2]}
    limits |= {name: GUESSED["principal point"] * interior.width_px for name in interior.names[2:4]}
    return limits | {"aspect": GUESSED["aspect"]}


def _said(group: tuple[str, ...]) -> str:
    if group == ("fx", "fy"):
        return "the focal length"
    if group == ("cx", "cy"):
        return "the principal point (cx, cy)"
    if group == ("aspect",):
        return "fy / fx"
    return ", ".join(group)


def _held(group: tuple[str, ...], centre: np.ndarray, limits: dict[str, float], names: tuple[str, ...]) -> str:
    """What is done with a group that the images do not determine."""
    if group == ("aspect",):
        return f"is held to 1, +-{limits['aspect']:.2g}"
    at = "+-" + ", ".join(f"{limits[name]:.2g}" for name in dict.fromkeys(group))
    if group == ("fx", "fy"):
        return f"is held to its start, {centre[0]:.0f} +-{limits['fx']:.2g} px"
    if group == ("cx", "cy"):
        return f"is held to the image's middle, +-{limits['cx']:.2g} px"
    return f"{'are' if len(group) > 1 else 'is'} held to zero, {at}"


def _why_held(group: tuple[str, ...], worse: list[str], u: dict[str, float], held: str, names: tuple[str, ...]) -> str:
    own = [name for name in worse if name in group] or worse
    told = ", ".join(f"{name} to +-{u[name]:.2g}{' px' if name in names[:4] else ''}" for name in own)
    other = "" if own[0] in group else " with it free"
    return f"{_said(group)} {held}: the images would tell {told}{other}, which is less than is known of any lens"


# ------------------------------------------------------------------ outliers, discs, and what is left
def _settle(job: Job, reject: bool = True) -> tuple[Job, Adjustment]:
    """Adjust until nothing is rejected any more and the discs' offsets stand still."""
    job = _offset(job)
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
            job = _offset(job)
            continue
        before = job.network.offset_px
        job = _offset(job)
        if np.allclose(job.network.offset_px, before, rtol=0, atol=SETTLED_PX):
            return job, adjustment
    adjustment = adjust(job.network, job.labels)
    return replace(job, network=adjustment.network), adjustment


def _offset(job: Job) -> Job:
    offset = disc_offsets(job.network, job.ties.moments_px2, job.radius_mm)
    return replace(job, network=replace(job.network, offset_px=offset))


def _without(job: Job, bad: np.ndarray, size: np.ndarray) -> Job:
    """The job without some sights, and without what can no longer be determined then."""
    ties = job.ties
    records = [
        {
            "station": ties.stations[ties.image[k]], "board": "", "code": int(ties.code[ties.point[k]]),
            "x_px": float(ties.xy_px[k, 0]), "y_px": float(ties.xy_px[k, 1]), "sigmas": float(size[k]),
            "why": "contradicts all others",
        }
        for k in np.flatnonzero(bad)
    ]  # fmt: skip
    said = list(job.notes)
    network, kept = job.network, ties.take(~bad)
    all_stations = np.ones(len(ties.stations), bool)
    ties, poses, points, stations, which = _reduced(kept, all_stations, network.stations, network.point_mm, said)
    number = np.full(len(network.point_mm), -1)
    number[which] = np.arange(len(which))
    ends = number[network.distances.ends]
    whole = (ends >= 0).all(axis=1)
    network = replace(
        loose_network(ties, network.interior, poses, points, network.cameras[0]),
        known_mm=network.known_mm[which], information=network.information[which],
        distances=Distances(ends[whole], network.distances.length_mm[whole], network.distances.u_mm[whole]),
        images=Images.one_camera(len(stations)),
    )  # fmt: skip
    return replace(
        job, network=network, ties=ties, radius_mm=job.radius_mm[which], rejected=job.rejected + tuple(records),
        notes=tuple(said),
    )  # fmt: skip


def _of_images(ties: Ties, images: np.ndarray) -> Ties:
    """Ties of some images (a mask), renumbered; points keep their numbers."""
    number = np.cumsum(images) - 1
    some = ties.take(images[ties.image])
    stations = tuple(name for name, there in zip(ties.stations, images, strict=True) if there)
    return replace(some, stations=stations, image=number[some.image])


def _compact(
    ties: Ties, reached: np.ndarray, poses: Poses, points: np.ndarray, known: np.ndarray, notes: list[str]
) -> tuple[Ties, Poses, np.ndarray]:
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
    ties = replace(_of_images(ties, keep), code=ties.code[left])
    ties = replace(ties, point=number[ties.point])
    return ties, poses[keep], points[left], np.flatnonzero(keep), left
