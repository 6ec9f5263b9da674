"""The network that a plan stands for, at its true values: what `calibrate/start.py` finds from images, made from the
scene."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from testfield.adjust.bundle import predict
from testfield.adjust.network import (
    EXACT_MM,
    FREE,
    HELD,
    Distances,
    KnownBoards,
    Network,
    information_of,
)
from testfield.calibrate.edges import LEAST_MARKS
from testfield.calibrate.imaging import images_of, known_members, placed_on_rigs
from testfield.calibrate.start_points import board_points
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError
from testfield.plan.job import Job

LEAST_CODES = 2
"""Ring codes of a board that must be read before its dots have names (`detect/identify.py`)."""
NAMED = 6
"""Stations that a note names."""
ONE_BOARD = ("zhang", "opencv", "opencv_ro", "colmap")
GIVEN = ("stitched_given", "tsai", "dlt")
"""Calibrators that take the boards' certified poses as known."""


@dataclass(frozen=True)
class Planned:
    """A `network` of everything that is expected to be measured, its pixels free of noise.

    `images` (I,) and `boards` (B,) in use, by their numbers in the job; `codes` (L,) of the loose points, which come
    last, `first` the number of the first of them; `calibrating` (m,) which observations calibrate (boards and ends of
    control bars), `row` (m,) which of the job's observations each is; `bars` names of its distances; `datum` (1)
    world-from-datum. `notes` say what is left out.
    """

    job: Job
    network: Network
    images: np.ndarray
    boards: np.ndarray
    codes: np.ndarray
    first: int
    calibrating: np.ndarray
    row: np.ndarray
    bars: tuple[str, ...]
    datum: Poses
    places: tuple[str, ...]
    notes: tuple[str, ...]

    def labels(self, network: Network) -> list[str]:
        """Names of a network's unknowns."""
        imaging = self.job.imaging
        boards = tuple(self.job.field.boards[b].name for b in self.boards)
        cameras = tuple(camera.name for camera in imaging.cameras)
        return network.labels(self.places, boards, cameras, member_names=imaging.member_names)

    @property
    def image_names(self) -> tuple[str, ...]:
        """Names of the images in use."""
        return tuple(self.job.images[k] for k in self.images)

    @property
    def calibration(self) -> Network:
        """The network of the calibration alone: boards, and ends of control bars, which come last."""
        whole = self.network
        kept = np.concatenate([np.arange(self.first), self.control_points])
        number = np.full(len(whole.point_mm), -1)
        number[kept] = np.arange(len(kept))
        own = whole.take(self.calibrating)
        return replace(
            own,
            point=number[own.point],
            distances=replace(whole.distances, ends=number[whole.distances.ends]),
            **{name: getattr(whole, name)[kept] for name in ("point_mm", "point_board", "known_mm", "information")},
        )

    @property
    def control_points(self) -> np.ndarray:
        """Numbers in the network of the ends of control bars."""
        return np.unique(self.network.distances.ends)

    def points_of(self, codes: Any) -> np.ndarray:
        """Numbers of loose points in the network by their codes; -1 for those that are not measured."""
        place = {int(code): self.first + k for k, code in enumerate(self.codes)}
        return np.array([place.get(int(code), -1) for code in codes], int)


def planned(job: Job) -> Planned:
    """The network of a job. Raises `TestfieldError` where a datum defect leaves part of it without a frame, naming
    boards and stations."""
    rows, marks, field = job.expected, job.world.marks, job.field
    method = job.scene.measure.calibrator
    notes: list[str] = []
    alone = _one_board(job) if method in ONE_BOARD else None
    pairs, counts = _edges(job, alone)
    group, notes = _groups(job, pairs, counts, method, notes)
    images, boards = group
    used_pair = np.zeros((len(job.images), len(field.boards)), bool)
    used_pair[tuple(pairs.T)] = True
    board = marks.board[rows.mark]
    has_image, has_board = np.zeros(len(job.images), bool), np.zeros(len(field.boards) + 1, bool)
    has_image[images], has_board[boards] = True, True
    use = has_image[rows.station]
    on_board = use & (board >= 0)
    on_board[on_board] = used_pair[rows.station[on_board], board[on_board]] & has_board[board[on_board]]
    codes = _codes_met(job, use & (board < 0))
    if alone is None:
        control = {c for bar in field.scale_bars if bar.role == "control" for c in bar.codes}
    else:
        control = set()
    control &= {c for bar in field.scale_bars if set(bar.codes) <= set(codes.tolist()) for c in bar.codes}

    points = board_points(field, boards, {})
    first = len(points.local)
    number = np.full(len(field.boards), -1)
    number[boards] = np.arange(len(boards))
    point = np.full(len(rows), -1)
    point[on_board] = points.first[number[board[on_board]]] + marks.point[rows.mark[on_board]]
    loose = use & (board < 0) & np.isin(marks.code[rows.mark], codes)
    point[loose] = first + np.searchsorted(codes, marks.code[rows.mark[loose]])
    row = np.flatnonzero(point >= 0)

    datum = job.world.world_from_board[boards[:1]]
    to_datum = datum.inverse()
    local, u = points.local, points.u
    loose_mm = _positions(job, codes)
    at = np.zeros(len(codes), int)
    local = np.vstack([local, to_datum[at].apply(loose_mm)])
    u = np.vstack([u, np.full((len(codes), 3), np.inf)])
    bars = [bar for bar in field.scale_bars if set(bar.codes) <= control and bar.role == "control"]
    stations, members, network_images, places = _standing(job, images, datum)
    image_number = np.full(len(job.images), -1)
    image_number[images] = np.arange(len(images))
    network = Network(
        cameras=job.cameras,
        stations=stations,
        images=network_images,
        boards=to_datum[np.zeros(len(boards), int)].after(job.world.world_from_board[boards]),
        ways=(HELD, *[FREE] * (len(boards) - 1)),
        point_mm=local,
        point_board=np.concatenate([points.owner, np.full(len(codes), -1)]),
        known_mm=local,
        information=information_of(u),
        image=image_number[rows.station[row]],
        point=point[row],
        xy_px=rows.xy_px[row],
        cov_px2=rows.cov_px2[row],
        offset_px=np.zeros((len(row), 2)),
        distances=Distances(
            first + np.searchsorted(codes, np.array([bar.codes for bar in bars], int).reshape(-1, 2)),
            np.array([bar.length_mm for bar in bars], float),
            np.array([bar.u_length_mm for bar in bars], float),
        ),
        u_scale=field.u_scale,
        members=members,
        known_boards=_known(job, boards) if method in GIVEN else None,
        known_members=known_members(job.imaging),
    )
    network = replace(network, xy_px=predict(network))
    calibrating = (network.point < first) | np.isin(network.point, first + np.searchsorted(codes, sorted(control)))
    return Planned(
        job=job,
        network=network,
        images=images,
        boards=boards,
        codes=codes,
        first=first,
        calibrating=calibrating,
        row=row,
        bars=tuple(bar.name for bar in bars),
        datum=datum,
        places=places,
        notes=tuple(notes),
    )


def _edges(job: Job, alone: int | None) -> tuple[np.ndarray, np.ndarray]:
    """(E, 2) pairs of image and board where enough of the board is seen to find and name it, and its marks (E,)."""
    rows, marks, sheets = job.expected, job.world.marks, job.field.boards
    board, coded = marks.board[rows.mark], marks.code[rows.mark] > 0
    on = board >= 0
    shape = len(job.images), len(sheets)
    seen, codes = np.zeros(shape, int), np.zeros(shape, int)
    np.add.at(seen, (rows.station[on], board[on]), 1)
    np.add.at(codes, (rows.station[on & coded], board[on & coded]), 1)
    by_code = np.array([sheet.pattern is None and bool((sheet.marks.code > 0).any()) for sheet in sheets])
    found = (seen >= LEAST_MARKS) & ((codes >= LEAST_CODES) | ~by_code)
    if alone is not None:
        found[:, np.arange(len(sheets)) != alone] = False
    pairs = np.argwhere(found)
    return pairs, seen[tuple(pairs.T)]


def _groups(
    job: Job, pairs: np.ndarray, counts: np.ndarray, method: str, notes: list[str]
) -> tuple[tuple[np.ndarray, np.ndarray], list[str]]:
    """Images and boards in use, the datum board first; what is left out is said."""
    field, places, boards = job.field, job.imaging.station, len(job.field.boards)
    images = len(job.images)
    if not len(pairs):
        raise TestfieldError(
            f"no station sees {LEAST_MARKS} marks of any board, so nothing holds the datum",
            f"{job.source}, stations",
            "move stations nearer, or turn them to the boards",
        )
    # Boards with certified poses are joined without any image; images of one place share their orientation.
    given = [b for b in range(boards) if method in GIVEN and (b == 0 or field.boards[b].pose is not None)]
    a = [*pairs[:, 0], *range(images), *(images + b for b in given)]
    b = [*(images + pairs[:, 1]), *(images + boards + places), *(images + given[0] for _ in given)]
    size = images + boards + int(places.max()) + 1
    _, group = connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(size, size)), directed=False)
    of_pairs = group[pairs[:, 0]]
    joined = [int(g) for g in np.unique(of_pairs)]
    if len(joined) > 1:
        raise _apart(job, pairs, of_pairs, counts, joined)
    has_image = (group[:images] == joined[0]) & np.isin(places, places[np.unique(pairs[:, 0])])
    has_board = np.isin(np.arange(boards), pairs[:, 1])
    if not has_image.all():
        lost = [f"'{job.images[k]}'" for k in np.flatnonzero(~has_image)]
        named = ", ".join(lost[:NAMED]) + (f" and {len(lost) - NAMED} more" if len(lost) > NAMED else "")
        notes.append(f"stations that see no board well enough and take no part: {named}")
    if method not in ONE_BOARD:
        notes += [
            f"board '{field.boards[k].name}' is seen by no station well enough" for k in np.flatnonzero(~has_board)
        ]
    return (np.flatnonzero(has_image), np.flatnonzero(has_board)), notes


def _apart(job: Job, pairs: np.ndarray, of_pairs: np.ndarray, counts: np.ndarray, joined: list[int]) -> TestfieldError:
    """Groups of boards and stations that share no image: each has a datum of its own."""
    most = max(joined, key=lambda g: int(counts[of_pairs == g].sum()))
    parts = []
    for g in joined:
        if g == most:
            continue
        here = pairs[of_pairs == g]
        boards = ", ".join(f"'{job.field.boards[b].name}'" for b in np.unique(here[:, 1]))
        by = [job.images[k] for k in np.unique(here[:, 0])]
        seen = ", ".join(f"'{name}'" for name in by[:4]) + (f" and {len(by) - 4} more" if len(by) > 4 else "")
        parts.append(f"board{'s' if ',' in boards else ''} {boards} (seen by {seen})")
    one = len(parts) == 1
    return TestfieldError(
        f"datum defect: no image joins {'; nor '.join(parts)} to the others, so 6 parameters "
        f"(3 shifts, 3 turns) of {'it' if one else 'each'} are undetermined",
        f"{job.source}, stations",
        "add a station that sees a board of both groups",
    )


def _one_board(job: Job) -> int:
    """The board that a calibrator of one board takes: the one named, or the one seen best."""
    names = [sheet.name for sheet in job.field.boards]
    if job.scene.measure.board in names:
        return names.index(job.scene.measure.board)
    board = job.world.marks.board[job.expected.mark]
    return int(np.bincount(board[board >= 0], minlength=len(names)).argmax())


def _codes_met(job: Job, rows: np.ndarray) -> np.ndarray:
    """Codes, ascending, of loose targets that two places or more see."""
    origin = job.poses.origin_mm
    _, place = np.unique(origin, axis=0, return_inverse=True)
    pairs = np.column_stack([job.world.marks.code[job.expected.mark[rows]], place.ravel()[job.expected.station[rows]]])
    codes, count = np.unique(np.unique(pairs, axis=0)[:, 0], return_counts=True)
    return codes[(count >= 2) & np.isin(codes, list(job.field.loose))]


def _positions(job: Job, codes: np.ndarray) -> np.ndarray:
    """(L, 3) positions in the world of loose targets by code."""
    code = np.where(job.world.marks.board < 0, job.world.marks.code, -1)
    order = np.argsort(code, kind="stable")
    return job.world.mark_world_mm[order[np.searchsorted(code[order], codes)]].reshape(-1, 3)


def _standing(job: Job, images: np.ndarray, datum: Poses) -> tuple[Poses, Poses, Any, tuple[str, ...]]:
    """Poses of places and rig members, the network's images, names of the places."""
    imaging = job.imaging
    poses = job.poses.after(datum[np.zeros(len(job.poses), int)])
    weight = np.isin(np.arange(len(poses)), images).astype(float)
    stations, members, _ = placed_on_rigs(imaging, poses, weight)
    places = np.unique(imaging.station[images])
    names = tuple(imaging.places[p] for p in places)
    return stations[places], members, images_of(imaging, images, places), names


def _known(job: Job, boards: np.ndarray) -> KnownBoards:
    """The boards' certified poses as a prior."""
    sheets = job.field.boards
    u = np.full((len(boards), 6), np.inf)
    for k, b in enumerate(boards):
        pose = sheets[b].pose
        if pose is not None:
            u[k] = [pose.u_turn_rad] * 3 + [max(pose.u_mm, EXACT_MM)] * 3
    first = job.world.world_from_board[boards[:1]].inverse()
    return KnownBoards(first[np.zeros(len(boards), int)].after(job.world.world_from_board[boards]), u)
