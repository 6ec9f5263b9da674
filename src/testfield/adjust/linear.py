"""One linearisation of a network: whitened residuals and their derivatives, in groups of observations that share the
unknowns they depend on, so that every group is a few dense matrices."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from testfield.adjust.network import Layout, Network
from testfield.adjust.side_by_side import side_by_side
from testfield.camera.project import camera_jacobian

BATCH_ROWS = 4096
"""Observations that are linearised together: few enough to stay in a core's cache."""


@dataclass(frozen=True)
class Group:
    """k observations in one image on one board or none: `rows` (k,) of the network, in the order of their `points`
    (k,), each of which occurs once; `columns` (p,) of the reduced unknowns they depend on; `kept` whether their points
    are among those, whose columns come last."""

    camera: int
    image: int
    board: int
    rows: np.ndarray
    points: np.ndarray
    columns: np.ndarray
    kept: bool

    @cached_property
    def column_runs(self) -> list[slice]:
        """The columns as runs of neighbours, in order."""
        edges = np.flatnonzero(np.diff(self.columns) != 1) + 1
        return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(self.columns, edges) if len(run)]


@dataclass(frozen=True)
class Derivatives:
    """Of one group, whitened: `by_unknown` (k, 2, p), `by_point` (k, 2, 3), which is zero for kept points, and
    `residual` (k, 2), observed minus predicted; `point_normal` (k, 3, 3) and `point_right` (k, 3) are what each
    observation adds to its point's normal equations."""

    by_unknown: np.ndarray
    by_point: np.ndarray
    residual: np.ndarray
    point_normal: np.ndarray
    point_right: np.ndarray


@dataclass(frozen=True)
class Structure:
    """What does not change from one linearisation to the next: the layout, the groups, and `gather` (n, m), which sums
    what belongs to points over the observations in the groups' order, `order` (m,)."""

    layout: Layout
    groups: tuple[Group, ...]
    order: np.ndarray
    gather: csr_matrix

    @staticmethod
    def of(network: Network) -> "Structure":
        """The structure of a network."""
        layout = Layout.of(network)
        n, m = len(network.point_mm), len(network.point)
        place = np.full(n, -1)
        place[network.kept_points] = np.arange(len(network.kept_points))
        kept = place[network.point] >= 0
        board = network.point_board[network.point]
        camera = network.images.camera[network.image]
        keys = (_repeat(network.image, network.point), kept, board, network.image, camera)
        order = np.lexsort((network.point, *keys))
        edges = np.zeros(m, bool)
        for key in keys:
            edges[1:] |= np.diff(np.asarray(key)[order]) != 0
        groups = []
        for rows in np.split(order, np.flatnonzero(edges)) if m else ():
            i, b, points = int(network.image[rows[0]]), int(board[rows[0]]), network.point[rows]
            columns = _columns(network, layout, i, b)
            is_kept = bool(kept[rows[0]])
            if is_kept:
                own = layout.kept + 3 * place[points][:, None] + np.arange(3)
                columns = np.concatenate([columns, own.ravel()])
            groups.append(Group(int(camera[rows[0]]), i, b, rows, points, columns, is_kept))
        separate = (~kept).astype(float)
        gather = csr_matrix((separate[order], (network.point[order], np.arange(m))), shape=(n, m))
        return Structure(layout, tuple(groups), order, gather)


def _repeat(image: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(m,) how often each observation's point occurs before it in its image."""
    order = np.lexsort((point, image))
    same = np.zeros(len(order), bool)
    same[1:] = (np.diff(image[order]) == 0) & (np.diff(point[order]) == 0)
    first = np.maximum.accumulate(np.where(same, 0, np.arange(len(order)))) if len(order) else order
    count = np.empty(len(order), int)
    count[order] = np.arange(len(order)) - first
    return count


def _columns(network: Network, layout: Layout, image: int, board: int) -> np.ndarray:
    """The reduced unknowns that all observations of one image on one board share, in the order of `_shared`."""
    images, k = network.images, int(network.images.camera[image])
    parts = [
        np.arange(layout.camera[k], layout.camera[k + 1]),
        layout.station + 6 * images.station[image] + np.arange(6),
    ]
    if images.member[image]:
        parts.append(layout.member + 6 * (images.member[image] - 1) + np.arange(6))
    if board >= 0:
        parts.append(np.arange(layout.board[board], layout.board[board + 1]))
        parts += [np.array([layout.scale])] if network.scale_free else []
    return np.concatenate(parts)


def linearise(network: Network, structure: Structure, whitening: np.ndarray) -> list[Derivatives]:
    """Derivatives of every group; `whitening` (m, 2, 2) maps residuals in px to such of unit covariance."""
    batches: list[list[Group]] = []
    for group in structure.groups:
        full = not batches or batches[-1][0].camera != group.camera
        if full or sum(len(g.rows) for g in batches[-1]) + len(group.rows) > BATCH_ROWS:
            batches.append([])
        batches[-1].append(group)
    multiplications = 5000 * sum(len(group.rows) for group in structure.groups)
    parts = side_by_side(lambda batch: _of_camera(network, batch[0].camera, batch, whitening), batches, multiplications)
    return [part for batch in parts for part in batch]


def _of_camera(network: Network, camera: int, groups: list[Group], whitening: np.ndarray) -> list[Derivatives]:
    unknown = network.cameras[camera].unknown
    rows = np.concatenate([group.rows for group in groups])
    image, point = network.image[rows], network.point[rows]
    station, member = network.images.station[image], network.images.member[image]
    datum = network.datum_mm(point)
    turned = np.einsum("nij,nj->ni", network.stations.R[station], datum)
    at_station = turned + network.stations.t_mm[station]
    rig = len(network.members) > 1
    R = network.members.R[member]
    at_camera = np.einsum("nij,nj->ni", R, at_station) + network.members.t_mm[member] if rig else at_station
    uv, by_interior, by_camera = camera_jacobian(network.cameras[camera].interior, at_camera)
    white = whitening[rows]
    residual = np.einsum("nij,nj->ni", white, network.xy_px[rows] - uv - network.offset_px[rows])
    by_camera = white @ by_camera
    by_station = by_camera @ R if rig else by_camera
    by_datum = by_station @ network.stations.R[station]
    shared = [white @ by_interior[:, :, unknown], _turn(by_station, turned), by_station]

    answer, start = [], 0
    for group in groups:
        k = len(group.rows)
        here = slice(start, start + k)
        start += k
        parts = [part[here] for part in shared]
        if network.images.member[group.image]:
            parts += [_turn(by_camera[here], at_camera[here] - network.members.t_mm[member[here]]), by_camera[here]]
        by_point = by_datum[here]
        if group.board >= 0:
            lever = datum[here] - network.boards.t_mm[group.board]
            ways = network.ways[group.board]
            if ways.shape[1]:
                parts.append(np.concatenate([_turn(by_point, lever), by_point], axis=2) @ ways)
            if network.scale_free:
                parts.append(np.einsum("nij,nj->ni", by_point, lever / network.scale)[:, :, None])
            by_point = by_point @ (network.scale * network.boards.R[group.board])
        if group.kept:
            own = np.zeros((k, 2, k, 3))
            own[np.arange(k), :, np.arange(k)] = by_point
            parts.append(own.reshape(k, 2, 3 * k))
            by_point = np.zeros_like(by_point)
        own_normal = np.einsum("nij,nik->njk", by_point, by_point)
        own_right = np.einsum("nij,ni->nj", by_point, residual[here])
        answer.append(Derivatives(np.concatenate(parts, axis=2), by_point, residual[here], own_normal, own_right))
    return answer


def _turn(rows: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """(n, 2, 3) derivative by a small turn of the lever (n, 3), where `rows` (n, 2, 3) is that by its end."""
    a, b = lever[:, None, :], rows
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
