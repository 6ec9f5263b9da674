"""Starting values of a stitched calibration: homographies, the graph of images and boards, and their network."""

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np

from testfield.adjust.network import FREE, HELD, Camera, Distances, Images, Network, information_of
from testfield.calibrate.graph import spanning_poses
from testfield.calibrate.homography import focal_length, plane_homography, plane_pose
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.rays import meet
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field

LEAST_MARKS = 8
LEAST_SPREAD_PX2 = 25.0
"""Marks of less spread in an image lie on a line."""
_PINHOLE_LIKE = {"brown": [0.0] * 5, "rational": [0.0] * 12, "fisheye": [1 / 3, 2 / 15, 17 / 315, 62 / 2835]}
"""Coefficients with which each model images as a pinhole does: homographies know nothing else."""
GROSS_PX = 25.0
"""A mark farther than this from its board's homography is misread: no lens bends one board so much."""


@dataclass(frozen=True)
class Start:
    """A network with starting values, and what belongs to it.

    `rows` (m,) which observations it uses; `radius_mm` (n,) of its points' discs, 0 of corners; names of its `stations`
    and `boards`;
    `graph` edges (station, board, marks); `gross` rows that were misread; `notes` for the reader.
    """

    network: Network
    rows: np.ndarray
    radius_mm: np.ndarray
    stations: tuple[str, ...]
    boards: tuple[str, ...]
    graph: tuple[tuple[str, str, int], ...]
    gross: np.ndarray
    notes: list[str]


@dataclass(frozen=True)
class _Edges:
    """One board in one image: station, board, weight, homography (3, 3), number of marks."""

    station: np.ndarray
    board: np.ndarray
    weight: np.ndarray
    homography: np.ndarray
    marks: np.ndarray


def starting_network(
    rows: Observations, field: Field, width_px: int, height_px: int, lens: str, hold: tuple[str, ...]
) -> Start:
    """The network of all boards and stations that a chain of images joins to the first board that was seen.

    Raises `TestfieldError` where no board, or too little of them, was seen.
    """
    middle = np.array([(width_px - 1) / 2, (height_px - 1) / 2])
    edges, gross = _edges(rows, field)
    focal = focal_length(edges.homography, middle)
    poses = [plane_pose(h, focal, middle) for h in edges.homography]
    camera_from_board = Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))

    first = int(edges.board.min())
    order = np.argsort(np.arange(len(field.boards)) != first, kind="stable")  # the datum board comes first
    place = np.argsort(order)
    station_poses, board_poses, has_station, has_board = spanning_poses(
        edges.station, place[edges.board], edges.weight, camera_from_board, len(rows.stations), len(field.boards)
    )
    notes = [
        f"board '{field.boards[order[k]].name}' shares no image with the others and is left out"
        for k in np.flatnonzero(~has_board)
    ]
    notes += [
        f"station '{rows.stations[k]}' shows too little of any joined board and is left out"
        for k in np.flatnonzero(~has_station)
    ]
    boards, stations = order[has_board], np.flatnonzero(has_station)
    if len(stations) < 2:
        raise TestfieldError("fewer than two stations see a board well enough", do="add stations")
    interior = Interior(width_px, height_px, np.array([focal, focal, *middle, *_PINHOLE_LIKE[lens]]), lens)
    unknown = sorted(set(hold) - set(interior.names[4:]))
    if unknown:
        raise TestfieldError(
            f"the lens model '{lens}' has no coefficient '{unknown[0]}'",
            "measure.hold",
            f"its are {', '.join(interior.names[4:])}",
        )
    free = np.array([name not in hold for name in interior.names])
    interior = interior.with_parameters(np.where(free, interior.parameters, 0.0))

    usable = has_station[rows.station] & ~gross
    points = _board_points(field, boards)
    point = np.full(len(rows), -1)
    index = np.full(len(field.boards), -1)
    index[boards] = np.arange(len(boards))
    on_board = usable & (rows.board >= 0)
    on_board[on_board] = index[rows.board[on_board]] >= 0
    point[on_board] = points.first[index[rows.board[on_board]]] + rows.point[on_board]

    bars = _control_bars(rows, field, usable, len(points.local), notes)
    ends_mm = []
    for end, seen in bars.seen.items():
        point[seen] = end
        ends_mm.append(meet(interior, station_poses[rows.station[seen]], rows.xy_px[seen]))
    local = np.vstack([points.local, *ends_mm])
    u = np.vstack([points.u, np.full((len(ends_mm), 3), np.inf)])
    owner = np.concatenate([points.owner, np.full(len(ends_mm), -1)])

    used = np.flatnonzero(point >= 0)
    number = np.full(len(rows.stations), -1)
    number[stations] = np.arange(len(stations))
    network = Network(
        (Camera.of(interior, free),), station_poses[stations], Images.one_camera(len(stations)),
        board_poses[np.flatnonzero(has_board)], (HELD, *[FREE] * (len(boards) - 1)),
        local, owner, local, information_of(u), number[rows.station[used]], point[used], rows.xy_px[used],
        rows.cov_px2[used], np.zeros((len(used), 2)), bars.distances, 1.0, field.u_scale,
    )  # fmt: skip
    graph = tuple(
        (rows.stations[s], field.boards[b].name, int(n))
        for s, b, n in zip(edges.station, edges.board, edges.marks, strict=True)
        if has_station[s] and index[b] >= 0
    )
    return Start(
        network, used, np.concatenate([points.radius, bars.radius]), tuple(rows.stations[s] for s in stations),
        tuple(field.boards[b].name for b in boards), graph, np.flatnonzero(gross), notes,
    )  # fmt: skip


def _edges(rows: Observations, field: Field) -> tuple[_Edges, np.ndarray]:
    """Every board in every image that shows enough of it; and which observations are misread."""
    found: list[tuple] = []
    gross = np.zeros(len(rows), bool)
    for s in range(len(rows.stations)):
        for b, sheet in enumerate(field.boards):
            here = np.flatnonzero((rows.station == s) & (rows.board == b))
            if len(here) < LEAST_MARKS:
                continue
            plane, image = sheet.marks.xy_mm[rows.point[here]], rows.xy_px[here]
            _, inside = cv2.findHomography(plane, image, cv2.RANSAC, GROSS_PX)
            keep = np.zeros(len(here), bool) if inside is None else inside.ravel().astype(bool)
            gross[here[~keep]] = True
            spread = np.sqrt(max(np.linalg.det(np.cov(image[keep].T)), 0)) if keep.sum() >= LEAST_MARKS else 0.0
            if spread < LEAST_SPREAD_PX2:
                continue
            found.append((s, b, keep.sum() * spread, plane_homography(plane[keep], image[keep]), keep.sum()))
    if not found:
        why = Counter(rows.status.astype(str)) if len(rows) else Counter({"no blob was measured": 0})
        seen = ", ".join(f"{n} {status}" for status, n in why.most_common(4))
        raise TestfieldError(
            f"no image shows {LEAST_MARKS} identified marks of a board ({seen})", "observations.parquet",
            "look at the frames: are the targets sharp, bright and large enough?",
        )  # fmt: skip
    station, board, weight, homography, marks = zip(*found, strict=True)
    return _Edges(*(np.array(v) for v in (station, board, weight, homography, marks))), gross


@dataclass(frozen=True)
class _BoardPoints:
    """All marks of some boards: where each board's begin, local coordinates, uncertainties, owners, radii."""

    first: np.ndarray
    local: np.ndarray
    u: np.ndarray
    owner: np.ndarray
    radius: np.ndarray


def _board_points(field: Field, boards: np.ndarray) -> _BoardPoints:
    sheets = [field.boards[b] for b in boards]
    sizes = [len(sheet.marks) for sheet in sheets]
    return _BoardPoints(
        np.concatenate([[0], np.cumsum(sizes)]),
        np.vstack([np.column_stack([s.marks.xy_mm, np.zeros(len(s.marks))]) for s in sheets]),
        np.vstack([np.tile([s.u_xy_mm, s.u_xy_mm, s.u_z_mm], (len(s.marks), 1)) for s in sheets]),
        np.repeat(np.arange(len(sheets)), sizes),
        np.concatenate([np.zeros(len(s.marks)) if s.has_corners else s.marks.diameter_mm / 2 for s in sheets]),
    )


@dataclass(frozen=True)
class _Bars:
    """Control bars: observations of each end by its point number, the distances, radii of the ends."""

    seen: dict[int, np.ndarray]
    distances: Distances
    radius: np.ndarray


def _control_bars(rows: Observations, field: Field, usable: np.ndarray, first: int, notes: list[str]) -> _Bars:
    seen: dict[int, np.ndarray] = {}
    ends, lengths, u_lengths, radius = [], [], [], []
    for bar in field.scale_bars:
        if bar.role != "control":
            continue
        here = [np.flatnonzero(usable & (rows.code == code) & (rows.board < 0)) for code in bar.codes]
        if min(len(v) for v in here) < 2:
            notes.append(f"control bar '{bar.name}' is not seen twice at both ends and is left out")
            continue
        numbers = [first + len(seen), first + len(seen) + 1]
        seen |= dict(zip(numbers, here, strict=True))
        ends.append(numbers)
        lengths.append(bar.length_mm)
        u_lengths.append(bar.u_length_mm)
        radius += [field.loose[code] / 2 for code in bar.codes]
    if not ends:
        notes.append("no control bar: the scale is that of the boards' sheets")
    distances = Distances(np.array(ends, int).reshape(-1, 2), np.array(lengths, float), np.array(u_lengths, float))
    return _Bars(seen, distances, np.array(radius, float))
