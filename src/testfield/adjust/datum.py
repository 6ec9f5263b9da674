"""The datum: which motions of everything together no observation can see, and in which frame they are held.

A small similarity (three shifts, three turns, one scale) changes no image. What is known of boards, points and
distances takes some of the seven away; those that stay open are held still while the network is adjusted, and the
covariance is then transformed to the datum asked for: inner constraints over chosen points (S-transformation, Baarda
1973; METHODS section 5.4).
"""

from dataclasses import replace

import numpy as np

from testfield.adjust.network import EXACT_MM, Layout, Network
from testfield.camera.pose import Poses, cross_matrix, nearest_rotation

NOTHING_KNOWN = 1e-12
"""Information in 1/mm^2 below which a direction counts as open: what is known to a kilometre is not known."""


def open_motions(network: Network) -> tuple[np.ndarray, np.ndarray]:
    """How the d motions that nothing holds move the reduced unknowns (P, d) and the points (n, 3, d)."""
    layout = Layout.of(network)
    centre = network.datum_mm(network.seen_points).mean(axis=0) if len(network.seen_points) else np.zeros(3)
    span = np.abs(network.datum_mm(network.seen_points) - centre).max(initial=1.0)
    by_reduced, by_point, held = _similarity(network, layout, centre)
    # In millimetres all: turns and the scale by what they move at the field's edge.
    unit = np.array([1, 1, 1, *[1 / span] * 4])
    values, vectors = np.linalg.eigh(held * unit * unit[:, None])
    ways = unit[:, None] * vectors[:, values < NOTHING_KNOWN]
    return by_reduced @ ways, by_point @ ways


def _similarity(network: Network, layout: Layout, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The seven motions of reduced unknowns (P, 7) and points (n, 3, 7), and what is known against them (7, 7)."""
    n, stations = len(network.point_mm), network.stations
    by_reduced, by_point, held = np.zeros((layout.size, 7)), np.zeros((n, 3, 7)), np.zeros((7, 7))

    def move(x: np.ndarray) -> np.ndarray:
        """(k, 3, 7) motion of places (k, 3) in the datum frame."""
        turn = -cross_matrix(x - centre)
        return np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turn, (x - centre)[:, :, None]], axis=2)

    # A camera at C, R turns with the world: R' = R (1 - [w]x), C' = C + move(C), t = -R C.
    at = by_reduced[layout.station : layout.member].reshape(-1, 6, 7)
    at[:, :3, 3:6] = -stations.R
    at[:, 3:] = -stations.R @ move(stations.origin_mm)
    at[:, 3:, 3:6] += cross_matrix(stations.t_mm) @ stations.R  # -d(R) C = R [w]x C, and R C = -t
    by_reduced[layout.member : layout.board[0]].reshape(-1, 6, 7)[:, 3:, 6] = network.members.t_mm[1:]
    if len(network.boards):
        six = np.zeros((len(network.boards), 6, 7))
        six[:, :3, 3:6] = np.eye(3)
        six[:, 3:] = move(network.boards.t_mm)
        for b, ways in enumerate(network.ways):
            by_reduced[layout.board[b] : layout.board[b + 1]] = ways.T @ six[b]
            left = six[b] - ways @ (ways.T @ six[b])  # ways are orthonormal
            held += left.T @ left / EXACT_MM**2
            if network.known_boards and ways.size:
                held += six[b].T @ (network.known_boards.information[b][:, None] * six[b])
        held[6, 6] += 1 / EXACT_MM**2  # boards are made to size
    loose = network.point_board < 0
    by_point[loose] = move(network.point_mm[loose])
    told = np.flatnonzero(network.information.any(axis=(1, 2)))
    own = by_point[told]
    held += (np.swapaxes(own, 1, 2) @ network.information[told] @ own).sum(axis=0)
    kept = network.kept_points
    by_reduced[layout.kept :] = by_point[kept].reshape(-1, 7)
    if network.known_members:  # a rig's cameras at stated distances
        by_scale = np.column_stack([np.zeros((len(network.members) - 1, 3)), network.members.t_mm[1:]])
        held[6, 6] += (network.known_members.information * by_scale**2).sum()
    held[6, 6] += ((network.distances.length_mm / np.maximum(network.distances.u_mm, EXACT_MM)) ** 2).sum()
    return by_reduced, by_point, held


def aligned(network: Network, before: np.ndarray, points: np.ndarray, with_scale: bool) -> Network:
    """The network moved as one so that loose `points` lie as near as can be to where they were, `before` (k, 3)."""
    here = network.point_mm[points]
    a, b = here - here.mean(axis=0), before - before.mean(axis=0)
    R = nearest_rotation(b.T @ a)
    scale = float((b * (a @ R.T)).sum() / (a**2).sum()) if with_scale else 1.0
    shift = before.mean(axis=0) - scale * R @ here.mean(axis=0)
    loose = (network.point_board < 0)[:, None]
    centre = scale * network.stations.origin_mm @ R.T + shift
    turned = network.stations.R @ R.T
    return replace(
        network,
        stations=Poses(turned, -np.einsum("nij,nj->ni", turned, centre)),
        members=Poses(network.members.R, scale * network.members.t_mm),
        boards=Poses(R @ network.boards.R, scale * network.boards.t_mm @ R.T + shift),
        point_mm=np.where(loose, scale * network.point_mm @ R.T + shift, network.point_mm),
    )
