"""Photographs of a field that nobody rendered: detection, self-calibration, uncoded dots, and what is certified."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.imaging import imaging_of
from testfield.calibrate.loose_discs import measured_radii
from testfield.calibrate.loose_network import loose_network
from testfield.calibrate.misfit import Misfit
from testfield.calibrate.rejections import failed, failed_checks
from testfield.calibrate.self_calibration import free_network, settled
from testfield.calibrate.self_job import FreeNetwork
from testfield.calibrate.stitched import stitched
from testfield.calibrate.ties import Ties, coded_ties
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.photograph import Found
from testfield.detect.target_spec import TargetSpec
from testfield.measure.beside_boards import KINDS as BESIDE
from testfield.measure.beside_boards import points_beside
from testfield.measure.certified import Length, certified_of, lengths_of
from testfield.measure.moved import against_groups, in_settings
from testfield.measure.patterns import Pattern, of_boards
from testfield.measure.single_tags import KINDS as SINGLE_TAGS
from testfield.measure.single_tags import as_coded, odd_sizes, sized
from testfield.reconstruct.points import Points
from testfield.reconstruct.uncoded import match_dots
from testfield.targets.camera_sheet import CameraSheet, RigSheet
from testfield.targets.field import Field, NominalBoard
from testfield.targets.field_file import FieldFile
from testfield.targets.marks import Marks
from testfield.uncertainty.halves import NO_HALVES, Halves, compare_halves

LEAST_TOLERANCE_PX, MOST_TOLERANCE_PX = 0.3, 3.0
"""Within which a ray must meet others to be of the same dot: six times the reprojection's rms, but between these."""


@dataclass(frozen=True)
class Measurement:
    """What photographs gave: `observations` whose `point` is the row in `points`, `calibration`, `points` (codes, and
    dots without one under negative numbers), `lengths`, `datum` in words, `halves` of the photographs
    compared. `unread` are photographs that were given and could not be read."""

    observations: Observations
    calibration: Calibration
    points: Points
    lengths: tuple[Length, ...]
    datum: str
    halves: Halves = NO_HALVES
    unread: tuple[str, ...] = ()

    @property
    def uncoded(self) -> int:
        """How many points have no code."""
        return int((self.points.code < 0).sum())


@dataclass(frozen=True)
class Taken:
    """By which of several `cameras` each photograph was taken (`camera`, a name each), and the `place` where that
    camera, or the rig that holds it, stood."""

    cameras: tuple[CameraSheet, ...]
    rigs: tuple[RigSheet, ...]
    camera: tuple[str, ...]
    place: tuple[str, ...]

    def of(self, images: np.ndarray) -> "Taken":
        """The same of some photographs, by their numbers."""
        return replace(self, camera=tuple(self.camera[k] for k in images), place=tuple(self.place[k] for k in images))


def measure(
    names: tuple[str, ...],
    found: list[Found],
    size_px: tuple[int, int],
    field: FieldFile,
    target: TargetSpec,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    focal_px: float | None = None,
    taken: Taken | None = None,
    patterns: tuple[Pattern, ...] = (),
) -> Measurement:
    """Cameras and points from what was found in photographs of `size_px` (width, height), all by one camera, or as they
    were `taken` by several, and what the two halves of the photographs say of their uncertainties. Where the boards
    `patterns` are the targets, they calibrate the cameras and nothing else is measured."""

    moved: tuple[str, ...] = ()
    if target.kind in SINGLE_TAGS and not patterns:
        found, moved = as_coded(found)
    if field.groups and taken is None and target.kind in ("ring", "cctag", *SINGLE_TAGS) and not patterns:
        found, field, said = in_settings(names, found, size_px, field, lens, hold, focal_px)
        moved += said

    def some(images: np.ndarray, focal_px: float | None, misfit: Misfit | None) -> Measurement:
        chosen = tuple(names[k] for k in images), [found[k] for k in images]
        own = taken.of(images) if taken else None
        return _measured(*chosen, size_px, field, target, lens, hold, focal_px, misfit, own, patterns)

    whole = some(np.arange(len(names)), focal_px, None)
    if field.groups or target.kind in SINGLE_TAGS:
        odd = odd_sizes(whole.points, target) if target.kind in SINGLE_TAGS else []
        said = (*whole.calibration.notes, *moved, *against_groups(whole.points, field), *odd)
        whole = replace(whole, calibration=replace(whole.calibration, notes=said))
    # Images of one rig at one place belong to the same half.
    places = [f"{c}@{p}" for c, p in zip(taken.camera, taken.place, strict=True)] if taken else list(names)
    if taken and taken.rigs:
        places = list(taken.place)
    units = list(dict.fromkeys(places))
    focal, given = whole.calibration.interior.fx, Misfit.of(whole.calibration)

    def half(chosen: np.ndarray) -> tuple[Calibration, Points]:
        wanted = {units[k] for k in chosen}
        one = some(np.array([k for k, place in enumerate(places) if place in wanted]), focal, given)
        return one.calibration, one.points

    return replace(whole, halves=compare_halves(len(units), half, given.between))


def _measured(
    names: tuple[str, ...],
    found: list[Found],
    size_px: tuple[int, int],
    field: FieldFile,
    target: TargetSpec,
    lens: str,
    hold: tuple[str, ...],
    focal_px: float | None,
    misfit: Misfit | None,
    taken: Taken | None,
    patterns: tuple[Pattern, ...],
) -> Measurement:
    if patterns:
        return _of_patterns(names, found, size_px, field, target, patterns, lens, hold, misfit, taken)
    observations = Observations.join([one.observations for one in found], names)
    imaging = None
    if taken:
        observations = observations.by(taken.camera, taken.place)
        imaging = imaging_of(observations, taken.cameras, taken.rigs, "constrained")
    if target.kind == "circles":
        return _of_grid(observations, found, size_px, field, target, lens, hold, misfit)
    ties, notes = coded_ties(observations)
    certified = certified_of(field)
    if target.kind in SINGLE_TAGS:
        certified = sized(certified, found, target)
    result = free_network(ties, *size_px, lens, hold, certified, focal_px, True, notes, misfit, imaging)
    result = with_dots(result, observations, hold, misfit)
    points = Points(
        method="self",
        code=result.code,
        xyz_mm=result.xyz_mm,
        cov_xyz_mm2=result.cov_xyz_mm2,
        rays=result.rays,
        residual_rms_px=result.residual_rms_px,
        rejected=result.rejected,
    )
    place = {int(code): k for k, code in enumerate(result.code)}
    named = np.full(len(observations), -1)
    job = result.job
    named[job.ties.row] = [place.get(int(c), -1) for c in job.ties.code[job.ties.point]]
    unused = {c["certificate"] for c in result.calibration.certificates if not c["used"]}
    lengths, not_compared = lengths_of(certified, points, unused, result.scale_from)
    wrong = failed_checks([(d.name, d.en) for d in lengths if d.role == "check"])
    calibration = failed(result.calibration, not_compared + wrong)
    return Measurement(replace(observations, point=named), calibration, points, lengths, _datum(result, field))


def with_dots(
    result: FreeNetwork, observations: Observations, hold: tuple[str, ...], misfit: Misfit | None = None
) -> FreeNetwork:
    """The network with the dots that have no code, named by their rays; as it was where there are none."""
    calibration, job = result.calibration, result.begin
    place = {name: k for k, name in enumerate(calibration.station_names)}
    station = np.array([place.get(name, -1) for name in observations.stations], int)[observations.station]
    finite = np.isfinite(observations.xy_px).all(axis=1) & np.isfinite(observations.cov_px2).all(axis=(1, 2))
    row = np.flatnonzero((observations.status == MEASURED) & (observations.code == 0) & (station >= 0) & finite)
    if not len(row):
        return result
    tolerance = float(np.clip(6 * calibration.reprojection_rms_px, LEAST_TOLERANCE_PX, MOST_TOLERANCE_PX))
    with np.errstate(invalid="ignore"):
        moments = np.nan_to_num(observations.moments_px2[row])
        size = 2 * np.sqrt(np.maximum(np.linalg.eigvalsh(moments)[:, 1], 0))
    dots = match_dots(
        [calibration.interiors[k] for k in calibration.camera_of_image],
        calibration.stations,
        station[row],
        observations.xy_px[row],
        size,
        result.xyz_mm,
        tolerance,
    )
    if not len(dots.point_mm):
        return result
    sight, old = row[dots.sight], job.ties
    ties = Ties(
        stations=old.stations,
        code=np.concatenate([old.code, -1 - np.arange(len(dots.point_mm))]),
        image=np.concatenate([old.image, station[sight]]),
        point=np.concatenate([old.point, len(old.code) + dots.dot]),
        xy_px=np.concatenate([old.xy_px, observations.xy_px[sight]]),
        cov_px2=np.concatenate([old.cov_px2, observations.cov_px2[sight]]),
        moments_px2=np.concatenate([old.moments_px2, observations.moments_px2[sight]]),
        row=np.concatenate([old.row, sight]),
    )
    network, n = job.network, len(dots.point_mm)
    wider = replace(
        loose_network(
            ties,
            network.cameras,
            network.images.camera,
            network.stations,
            np.vstack([network.point_mm, dots.point_mm]),
        ),
        known_mm=np.vstack([network.known_mm, dots.point_mm]),
        information=np.concatenate([network.information, np.zeros((n, 3, 3))]),
        distances=network.distances,
    )
    radius = np.concatenate([job.radius_mm, measured_radii(wider, ties.moments_px2)[len(old.code) :]])
    return settled(replace(job, network=wider, ties=ties, radius_mm=radius), hold, True, misfit)


def _datum(result: FreeNetwork, field: FieldFile) -> str:
    free = "the origin amid the points, z square to the plane that fits them best, x along the first image's rows"
    return {
        "control points": f"the frame of '{field.boards[0].name if field.boards else ''}', by its certified places",
        "distances": f"free network over all points, scale from the certified distances: {free}",
        "diameters": f"free network over all points, scale from the dots' diameters only: {free}",
        "nothing": f"free network over all points in ARBITRARY SCALE: {free}",
    }[result.scale_from]


def _of_patterns(
    names: tuple[str, ...],
    found: list[Found],
    size_px: tuple[int, int],
    field: FieldFile,
    target: TargetSpec,
    patterns: tuple[Pattern, ...],
    lens: str,
    hold: tuple[str, ...],
    misfit: Misfit | None,
    taken: Taken | None,
) -> Measurement:
    """Cameras from photographs of boards whose print says where every point lies."""
    coded = target if field.patterns and target.kind in BESIDE else None
    named, sheet, notes = of_boards(found, names, patterns, field.target.white_on_black, coded)
    cameras: tuple[CameraSheet, ...] = ()
    if taken:
        named, sheet, cameras = named.by(taken.camera, taken.place), replace(sheet, rigs=taken.rigs), taken.cameras
    calibration = stitched(named, sheet, *size_px, lens, hold, True, misfit, cameras)
    empty = Points("stitched", *(np.zeros(s, t) for s, t in EMPTY))
    datum = f"the frame of '{calibration.board_names[0]}': origin in its middle, x along its rows, y up its columns"
    calibration = replace(calibration, notes=(*calibration.notes, *notes))
    if coded is None:
        return Measurement(named, calibration, empty, (), datum)
    points = points_beside(named, calibration, sheet, field)
    place = {int(code): k for k, code in enumerate(points.code)}
    row = np.array([place.get(int(c), -1) if c > 0 else -1 for c in named.code], int)
    lengths, not_compared = lengths_of(certified_of(field), points, set(), "boards")
    wrong = failed_checks([(d.name, d.en) for d in lengths if d.role == "check"])
    named = replace(named, point=np.where(named.board < 0, row, named.point))
    return Measurement(named, failed(calibration, not_compared + wrong), points, lengths, datum)


def _of_grid(
    observations: Observations,
    found: list[Found],
    size_px: tuple[int, int],
    field: FieldFile,
    target: TargetSpec,
    lens: str,
    hold: tuple[str, ...],
    misfit: Misfit | None,
) -> Measurement:
    """A camera from photographs of a flat grid of circles."""
    assert field.grid and field.target.diameter_mm  # a field file of circles has both
    # A grid's columns run along its longer side, however its size was written.
    columns, rows = max(target.columns, target.rows), min(target.columns, target.rows)
    k = np.arange(columns * rows)
    xy = field.grid.spacing_mm * np.column_stack([k % columns, k // columns]).astype(float)
    marks = Marks(xy, np.full(len(k), field.target.diameter_mm), np.zeros(len(k), int), 14)
    board = NominalBoard("grid", marks, field.grid.u_mm, field.grid.u_flat_mm)
    place = np.concatenate([one.place for one in found])
    on = (place[:, 0] >= 0) & (observations.status == MEASURED)
    point = np.where(on, place[:, 1] * columns + place[:, 0], -1)
    named = replace(observations, board=np.where(on, 0, -1), point=point)
    sizes = Counter(tuple((one.place.max(axis=0, initial=-1) + 1).tolist()) for one in found)
    odd = [s for s in sizes if s != (columns, rows)]
    calibration = stitched(named, Field(14, (board,)), *size_px, lens, hold, True, misfit)
    notes = (*calibration.notes, *(f"{sizes[s]} image(s) show a grid of {s[0]} x {s[1]} only" for s in odd))
    empty = Points("stitched", *(np.zeros(s, t) for s, t in EMPTY))
    return Measurement(
        named, replace(calibration, notes=notes), empty, (), "the grid's own: origin in its first circle"
    )


EMPTY: tuple[tuple, ...] = ((0, int), ((0, 3), float), ((0, 0), float), (0, int), (0, float), (0, int))
"""Shapes and types of the columns of no points."""
