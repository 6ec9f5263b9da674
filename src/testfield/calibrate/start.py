"""Starting values of a calibration with boards: homographies, the graph of images and boards, and their network."""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.network import (
    EXACT_MM,
    FREE,
    HELD,
    KnownBoards,
    Network,
    information_of,
)
from testfield.calibrate.edges import Edges
from testfield.calibrate.graph import given_poses, groups_apart, spanning_poses
from testfield.calibrate.imaging import Imaging, known_members
from testfield.calibrate.looks import Guess, from_homographies, joined, looks_of, one_camera, standing_of
from testfield.calibrate.start_points import board_points, control_bars
from testfield.calibrate.units import boards_of_one_unit, dots_fit_their_spacing
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import directions
from testfield.camera.rays import meet_rays
from testfield.camera.several import by_camera
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field


@dataclass(frozen=True)
class Start:
    """A network with starting values, and what belongs to it.

    `rows` (m,) which observations it uses; `radius_mm` (n,) of its points' discs, 0 of corners; names of its `stations`
    and `boards`; `bars` names of its distances; `graph` edges (station, board, marks); `why` (n,) observations were
    left out ("" of the others); `notes` for the reader. `stations` are the images'; `places` where their cameras or
    rigs stood, the network's own stations, and `imaging` says which image was taken from which.
    """

    network: Network
    rows: np.ndarray
    radius_mm: np.ndarray
    stations: tuple[str, ...]
    boards: tuple[str, ...]
    bars: tuple[str, ...]
    graph: tuple[tuple[str, str, int], ...]
    why: np.ndarray
    notes: list[str]
    imaging: Imaging
    places: tuple[str, ...]

    def labels(self, network: Network) -> list[str]:
        """Names of the network's unknowns."""
        cameras = tuple(camera.name for camera in self.imaging.cameras)
        return network.labels(self.places, self.boards, cameras, member_names=self.imaging.member_names)


def starting_network(
    rows: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str,
    hold: tuple[str, ...],
    *,
    fixed: tuple[str, ...] = (),
    guess: Guess = from_homographies,
    least_stations: int = 2,
    given: bool = False,
    left_out: frozenset[int] = frozenset(),
    imaging: Imaging | None = None,
) -> Start:
    """The network of all boards and stations that a chain of images joins to the first board that was seen.

    `hold` names coefficients kept at zero, `fixed` parameters kept as guessed. `given`: the boards' poses that the
    sheet certifies join boards too, and are known with their uncertainty; its first board is then the datum. Boards
    that are `left_out` (numbers on the sheet) take no part. `imaging` says which of several cameras took which image;
    it then gives their sizes and lenses. Raises `TestfieldError` where no board, or too little of them, was seen.
    """
    imaging = imaging or one_camera(rows.stations, width_px, height_px, lens)
    looks, why, notes = looks_of(rows, field, imaging, hold, fixed, guess, left_out)
    told: set[int] = set(left_out)
    edges, camera_from_board = Edges.join([look.edges for look in looks]), joined(looks)
    if len(field.boards) > 1:
        keep = boards_of_one_unit(edges, camera_from_board, field, notes)
        told |= {int(b) for b in edges.board[~keep]}
        edges, camera_from_board = edges.take(keep), camera_from_board[keep]
    sizes = dots_fit_their_spacing(edges, rows, field, notes)
    cameras = tuple(look.camera(edges, imaging) for look in looks)
    interiors = tuple(camera.interior for camera in cameras)

    placed = _placed(edges, camera_from_board, rows, field, given, told, notes)
    standing = standing_of(imaging, placed.station_poses, edges, placed.stations)
    boards, stations = placed.boards, standing.images
    if len(stations) < least_stations:
        raise TestfieldError(
            "no station sees a board well enough"
            if least_stations == 1
            else "fewer than two stations see a board well enough",
            do="add stations",
        )
    has_station = np.isin(np.arange(len(rows.stations)), stations)
    usable = has_station[rows.station] & (why == "")
    points = board_points(field, boards, sizes)
    point = np.full(len(rows), -1)
    index = np.full(len(field.boards), -1)
    index[boards] = np.arange(len(boards))
    on_board = usable & (rows.board >= 0)
    on_board[on_board] = index[rows.board[on_board]] >= 0
    point[on_board] = points.first[index[rows.board[on_board]]] + rows.point[on_board]

    bars = control_bars(rows, field, usable, len(points.local), notes)
    ends_mm = []
    for end, seen in bars.seen.items():
        point[seen] = end
        image = rows.station[seen]
        rays = by_camera(directions, interiors, imaging.camera[image], rows.xy_px[seen])
        ends_mm.append(meet_rays(rays, standing.poses[image], rows.xy_px[seen]))
    local = np.vstack([points.local, *ends_mm])
    u = np.vstack([points.u, np.full((len(ends_mm), 3), np.inf)])
    owner = np.concatenate([points.owner, np.full(len(ends_mm), -1)])

    used = np.flatnonzero(point >= 0)
    number = np.full(len(rows.stations), -1)
    number[stations] = np.arange(len(stations))
    network = Network(
        cameras=cameras,
        stations=standing.stations,
        images=standing.network_images,
        boards=placed.board_poses[boards],
        ways=(HELD, *[FREE] * (len(boards) - 1)),
        point_mm=local,
        point_board=owner,
        known_mm=local,
        information=information_of(u),
        image=number[rows.station[used]],
        point=point[used],
        xy_px=rows.xy_px[used],
        cov_px2=rows.cov_px2[used],
        offset_px=np.zeros((len(used), 2)),
        distances=bars.distances,
        scale=1.0,
        u_scale=field.u_scale,
        members=standing.members,
        known_boards=_known_boards(field, boards) if given else None,
        known_members=known_members(imaging),
    )
    graph = tuple(
        (rows.stations[s], field.boards[b].name, int(n))
        for s, b, n in zip(edges.station, edges.board, edges.marks, strict=True)
        if has_station[s] and index[b] >= 0
    )
    return Start(
        network=network,
        rows=used,
        radius_mm=np.concatenate([points.radius, bars.radius]),
        stations=tuple(rows.stations[s] for s in stations),
        boards=tuple(field.boards[b].name for b in boards),
        bars=bars.names,
        graph=graph,
        why=why,
        notes=notes,
        imaging=imaging,
        places=standing.names,
    )


@dataclass(frozen=True)
class _Placed:
    """Boards and stations in use, by their numbers on the sheet and in the observations, the datum board first, and
    poses of all, those in use being right."""

    boards: np.ndarray
    stations: np.ndarray
    board_poses: Poses
    station_poses: Poses


def _placed(
    edges: Edges,
    camera_from_board: Poses,
    rows: Observations,
    field: Field,
    given: bool,
    told: set[int],
    notes: list[str],
) -> _Placed:
    stations, boards = len(rows.stations), len(field.boards)
    apart = groups_apart(edges.station, edges.board, stations, boards)
    if given:
        known = np.array([b == 0 or sheet.pose is not None for b, sheet in enumerate(field.boards)])
        station_poses, board_poses, has_station, has_board = given_poses(
            edges.station, edges.board, edges.weight, camera_from_board, _certified(field), known, stations
        )
        # The first board is the datum, whether it was seen or not; of the others only those that were seen count.
        has_board &= np.isin(np.arange(boards), [0, *edges.board[has_station[edges.station]]])
        order = np.arange(boards)
    else:
        first = min(apart[0][1])
        order = np.argsort(np.arange(boards) != first, kind="stable")  # the datum board comes first
        place = np.argsort(order)
        station_poses, ordered, has_station, has_order = spanning_poses(
            edges.station, place[edges.board], edges.weight, camera_from_board, stations, boards
        )
        board_poses, has_board = ordered[place], has_order[place]
    joined = order[has_board[order]]
    _note_left_out(apart, has_station, has_board, rows, field, told, notes)
    return _Placed(joined, np.flatnonzero(has_station), board_poses, station_poses)


def _note_left_out(
    apart: list[tuple[list, list]],
    has_station: np.ndarray,
    has_board: np.ndarray,
    rows: Observations,
    field: Field,
    told: set[int],
    notes: list[str],
) -> None:
    """Which groups, boards and stations are not joined to the datum; boards in `told` have had their word."""
    for stations, boards in apart:
        if not has_board[boards].any() or not has_station[stations].any():
            which = ", ".join(f"'{field.boards[b].name}'" for b in boards)
            by = ", ".join(f"'{rows.stations[s]}'" for s in stations)
            notes.append(
                f"board{'s' if len(boards) > 1 else ''} {which}, seen by {by}, "
                f"share{'' if len(boards) > 1 else 's'} no image with the others: this group is left out"
            )
    told_boards = told | {b for _, boards in apart for b in boards}
    told_stations = {s for stations, _ in apart for s in stations}
    notes += [
        f"board '{field.boards[b].name}' is seen by no station well enough and is left out"
        for b in np.flatnonzero(~has_board)
        if b not in told_boards
    ]
    notes += [
        f"station '{rows.stations[s]}' shows too little of any joined board and is left out"
        for s in np.flatnonzero(~has_station)
        if s not in told_stations
    ]


def _certified(field: Field) -> Poses:
    """The sheet's poses of all boards in the frame of its first; the identity where it gives none."""
    poses = Poses.identity(len(field.boards))
    for b, sheet in enumerate(field.boards[1:], 1):
        if sheet.pose is not None:
            poses.R[b], poses.t_mm[b] = rotation(np.array(sheet.pose.turn_rad)), sheet.pose.t_mm
    return poses


def _known_boards(field: Field, boards: np.ndarray) -> KnownBoards:
    u = np.full((len(boards), 6), np.inf)
    for k, b in enumerate(boards):
        pose = field.boards[b].pose
        if pose is not None:
            u[k] = [pose.u_turn_rad] * 3 + [max(pose.u_mm, EXACT_MM)] * 3
    return KnownBoards(_certified(field)[boards], u)
