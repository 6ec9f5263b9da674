"""Stitched sub-boards: homographies, the graph of images and boards, one bundle (METHODS section 4)."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Network
from testfield.adjust.normals import target_normal
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.graph import spanning_poses
from testfield.calibrate.homography import focal_length, plane_homography, plane_pose
from testfield.camera.circle import disc_image
from testfield.camera.interior import PARAMETERS, Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.camera.rays import meet
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field

LEAST_MARKS = 8
REJECT_SIGMA = 6.0
"""An observation is rejected whose residual is larger than this many of its own standard deviations."""
ROUNDS = 6


@register("calibrators", "stitched")
def stitched(observations: Observations, field: Field, width_px: int, height_px: int) -> Calibration:
    """Calibrate from what detection measured and the field's sheet; no starting values are needed.

    Raises `TestfieldError` where no board, or too little of them, was seen.
    """
    rows = observations.measured
    if not np.all(np.isfinite(rows.xy_px)) or not np.all(np.isfinite(rows.cov_px2)):
        bad = int(np.argmax(~np.isfinite(rows.xy_px).all(axis=1) | ~np.isfinite(rows.cov_px2).all(axis=(1, 2))))
        raise TestfieldError(
            f"observation {bad} (station '{rows.stations[rows.station[bad]]}', code {rows.code[bad]}) is not finite",
            "observations.parquet", "detect again, or drop the row",
        )  # fmt: skip
    start = _start(rows, field, width_px, height_px)
    network, moments, radius, kept, notes, graph = start
    names = tuple(rows.stations[s] for s in kept["stations"])
    boards = tuple(field.boards[b].name for b in kept["boards"])
    labels = network.labels(names, boards)

    rejected: list[dict] = []
    adjustment = adjust(_coarse(network), _coarse(network).labels(names, boards))
    network = _refined(network, adjustment.network)
    for _ in range(ROUNDS):
        if rows.centre_of_disc:
            network = replace(network, offset_px=_disc_offsets(network, moments, radius))
        adjustment = adjust(network, labels)
        network = adjustment.network
        size = _residual_sizes(adjustment)
        # A first bad point may drag its neighbours along: only residuals near the worst go in one round.
        bad = (size > REJECT_SIGMA) & (size > 0.3 * size.max())
        if not bad.any():
            if not rows.centre_of_disc or np.allclose(
                _disc_offsets(network, moments, radius), network.offset_px, atol=1e-7
            ):
                break
            continue
        rejected += _record(network, size, bad, names, boards)
        network, moments = network.take(~bad), moments[~bad]

    index = np.arange(len(labels) - 3 * len(network.kept_points))
    return Calibration(
        "stitched", network.interior, names, network.stations, boards, network.boards, network.scale,
        adjustment.covariance[np.ix_(index, index)], tuple(labels[: len(index)]), adjustment.sigma0, adjustment.freedom,
        float(np.sqrt((adjustment.residual_px**2).sum(axis=1).mean())), len(network.xy_px), tuple(rejected),
        network.xy_px, adjustment.residual_px,
        tuple((names[s], boards[b], n) for s, b, n in graph), tuple(notes),
    )  # fmt: skip


def _start(rows: Observations, field: Field, width_px: int, height_px: int) -> tuple:
    """A network with starting values from homographies, and what belongs to its observations."""
    middle = np.array([(width_px - 1) / 2, (height_px - 1) / 2])
    station, board, weight, homographies = [], [], [], []
    for s in range(len(rows.stations)):
        for b, sheet in enumerate(field.boards):
            here = np.flatnonzero((rows.station == s) & (rows.board == b))
            if len(here) < LEAST_MARKS:
                continue
            plane, image = sheet.marks.xy_mm[rows.point[here]], rows.xy_px[here]
            spread = np.sqrt(max(np.linalg.det(np.cov(image.T)), 0))
            if spread < 25.0:  # px^2: the marks lie on a line
                continue
            station.append(s)
            board.append(b)
            weight.append(len(here) * spread)
            homographies.append(plane_homography(plane, image))
    if not homographies:
        raise TestfieldError(
            f"no image shows {LEAST_MARKS} identified marks of a board",
            do="look at the observations' status for the reasons",
        )
    edges = np.array(station), np.array(board), np.array(weight)
    focal = focal_length(np.array(homographies), middle)
    poses = [plane_pose(h, focal, middle) for h in homographies]
    camera_from_board = Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))
    first = int(edges[1].min())
    order = np.argsort(np.arange(len(field.boards)) != first, kind="stable")  # the datum board comes first
    place = np.argsort(order)
    station_poses, board_poses, has_station, has_board = spanning_poses(
        edges[0], place[edges[1]], edges[2], camera_from_board, len(rows.stations), len(field.boards)
    )
    notes = []
    for k in np.flatnonzero(~has_board):
        notes.append(f"board '{field.boards[order[k]].name}' shares no image with the others and is left out")
    for k in np.flatnonzero(~has_station):
        notes.append(f"station '{rows.stations[k]}' sees no joined board and is left out")
    boards = order[has_board]
    stations = np.flatnonzero(has_station)
    if len(stations) < 2:
        raise TestfieldError("fewer than two stations see a board", do="add stations")
    interior = Interior(width_px, height_px, np.array([focal, focal, *middle, 0, 0, 0, 0, 0]))

    # Points: every mark of every joined board, then the ends of the control bars.
    sheets = [field.boards[b] for b in boards]
    sizes = [len(sheet.marks) for sheet in sheets]
    offset = np.concatenate([[0], np.cumsum(sizes)])
    local = np.vstack([np.column_stack([s.marks.xy_mm, np.zeros(len(s.marks))]) for s in sheets])
    u = np.vstack([np.tile([s.u_xy_mm, s.u_xy_mm, s.u_z_mm], (len(s.marks), 1)) for s in sheets])
    owner = np.repeat(np.arange(len(sheets)), sizes)
    radius = np.concatenate([s.marks.diameter_mm / 2 for s in sheets])

    station_index, board_index = np.full(len(rows.stations), -1), np.full(len(field.boards), -1)
    station_index[stations], board_index[boards] = np.arange(len(stations)), np.arange(len(boards))
    usable = station_index[rows.station] >= 0
    point = np.full(len(rows), -1)
    on_board = usable & (rows.board >= 0)
    on_board[on_board] = board_index[rows.board[on_board]] >= 0
    point[on_board] = offset[board_index[rows.board[on_board]]] + rows.point[on_board]

    ends, lengths, u_lengths, extra_radius = [], [], [], []
    extra: list[np.ndarray] = []
    for bar in field.scale_bars:
        if bar.role != "control":
            continue
        seen = [np.flatnonzero(usable & (rows.code == code) & (rows.board < 0)) for code in bar.codes]
        if min(len(v) for v in seen) < 2:
            notes.append(f"control bar '{bar.name}' is not seen twice at both ends and is left out")
            continue
        numbers = []
        for code, v in zip(bar.codes, seen, strict=True):
            point[v] = len(local) + len(extra)
            numbers.append(len(local) + len(extra))
            extra.append(meet(interior, station_poses[rows.station[v]], rows.xy_px[v]))
            extra_radius.append(field.loose[code] / 2)
        ends.append(numbers)
        lengths.append(bar.length_mm)
        u_lengths.append(bar.u_length_mm)
    if not ends:
        notes.append("no control bar: the scale is that of the boards' sheets")
    if extra:
        local = np.vstack([local, extra])
        u = np.vstack([u, np.full((len(extra), 3), np.inf)])
        owner = np.concatenate([owner, np.full(len(extra), -1)])
        radius = np.concatenate([radius, extra_radius])

    used = point >= 0
    network = Network(
        interior, np.ones(9, bool), station_poses[stations], board_poses[has_board][: len(boards)], 1.0, field.u_scale,
        local, owner, local, u, station_index[rows.station[used]], point[used], rows.xy_px[used], rows.cov_px2[used],
        np.zeros((int(used.sum()), 2)), np.array(ends, int).reshape(-1, 2), np.array(lengths, float),
        np.array(u_lengths, float),
    )  # fmt: skip
    graph = [
        (int(station_index[s]), int(board_index[b]), int(((rows.station == s) & (rows.board == b)).sum()))
        for s, b in zip(edges[0], edges[1], strict=True)
        if station_index[s] >= 0 and board_index[b] >= 0
    ]
    return network, rows.moments_px2[used], radius, {"stations": stations, "boards": boards}, notes, graph


def _coarse(network: Network) -> Network:
    """The first adjustment: boards as on their sheets, a one-parameter lens, weights that forgive."""
    free = np.array([name in ("fx", "fy", "k1") for name in PARAMETERS])
    on_boards = network.point_board[network.point] >= 0
    coarse = network.take(on_boards)
    return replace(
        coarse, free=free, u_scale=0.0, u_prior_mm=np.zeros_like(network.u_prior_mm),
        cov_px2=np.broadcast_to(np.eye(2), coarse.cov_px2.shape).copy(),
        ends=np.zeros((0, 2), int), length_mm=np.zeros(0), u_length_mm=np.zeros(0),
    )  # fmt: skip


def _refined(network: Network, coarse: Network) -> Network:
    """The full network at the coarse one's camera, stations and boards, its loose points met anew."""
    points = network.point_mm.copy()
    for k in np.flatnonzero(network.point_board < 0):
        v = np.flatnonzero(network.point == k)
        points[k] = meet(coarse.interior, coarse.stations[network.station[v]], network.xy_px[v])
    return replace(network, interior=coarse.interior, stations=coarse.stations, boards=coarse.boards, point_mm=points)


def _disc_offsets(network: Network, moments: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(m, 2) what the discs' images add to the projections of their centres, at the network's present values."""
    normals = network.normals()
    for k in np.flatnonzero(network.point_board < 0):
        v = np.flatnonzero(network.point == k)
        normals[k] = target_normal(
            network.interior, network.stations[network.station[v]], network.point_mm[k], radius[k], moments[v]
        )
    poses, centre = network.stations[network.station], network.datum_mm()[network.point]
    image = disc_image(network.interior, poses, centre, normals[network.point], radius[network.point])
    return image.centroid_px - project(network.interior, poses, centre)


def _residual_sizes(adjustment: Adjustment) -> np.ndarray:
    """(m,) residuals in units of their standard deviations, those of the adjustment's overall misfit."""
    white = np.linalg.solve(np.linalg.cholesky(adjustment.network.cov_px2), adjustment.residual_px[..., None])[..., 0]
    size = np.linalg.norm(white, axis=1)
    typical = np.median(size) / 1.1774  # the median length of a standard normal vector in the plane
    return size / max(typical, 1.0)


def _record(
    network: Network, size: np.ndarray, bad: np.ndarray, names: tuple[str, ...], boards: tuple[str, ...]
) -> list[dict]:
    return [
        {
            "station": names[network.station[k]],
            "board": boards[owner] if (owner := network.point_board[network.point[k]]) >= 0 else "",
            "x_px": float(network.xy_px[k, 0]),
            "y_px": float(network.xy_px[k, 1]),
            "sigmas": float(size[k]),
        }
        for k in np.flatnonzero(bad)
    ]
