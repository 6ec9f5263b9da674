"""Which images see which boards, and the tree that joins them all to the first board."""

from collections import deque

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from testfield.camera.pose import Poses


def spanning_tree(
    station: np.ndarray, board: np.ndarray, weight: np.ndarray, stations: int, boards: int
) -> list[tuple[int, int, bool]]:
    """The strongest spanning tree from board 0, as steps in order: station, board, whether the step leads to the
    station (otherwise to the board). Edge e joins station `station[e]` and board `board[e]` with `weight[e]`.
    """
    nodes = stations + boards
    # The spanning tree of least cost keeps the heaviest edges; a cost of zero would read as no edge.
    cost = csr_matrix((1 / weight, (station, stations + board)), shape=(nodes, nodes))
    tree = minimum_spanning_tree(cost).tocoo()
    neighbours: dict[int, list[int]] = {k: [] for k in range(nodes)}
    for a, b in zip(tree.row, tree.col, strict=True):
        neighbours[int(a)].append(int(b))
        neighbours[int(b)].append(int(a))
    steps = []
    reached, queue = {stations}, deque([stations])
    while queue:
        node = queue.popleft()
        for other in neighbours[node]:
            if other in reached:
                continue
            reached.add(other)
            queue.append(other)
            steps.append((min(node, other), max(node, other) - stations, other < stations))
    return steps


def spanning_poses(
    station: np.ndarray,
    board: np.ndarray,
    weight: np.ndarray,
    camera_from_board: Poses,
    stations: int,
    boards: int,
) -> tuple[Poses, Poses, np.ndarray, np.ndarray]:
    """Poses along the strongest spanning tree from board 0.

    Edge e joins station `station[e]` and board `board[e]` with `weight[e]` and the pose `camera_from_board[e]`.
    Returns camera-from-datum poses, datum-from-board poses, and which stations and boards the tree reaches.
    """
    edge_of = {(int(s), int(b)): e for e, (s, b) in enumerate(zip(station, board, strict=True))}
    station_poses, board_poses = Poses.identity(stations), Poses.identity(boards)
    has_station, has_board = np.zeros(stations, bool), np.zeros(boards, bool)
    has_board[0] = True
    for s, b, to_station in spanning_tree(station, board, weight, stations, boards):
        here = camera_from_board[np.array([edge_of[s, b]])]
        if to_station:
            pose, into, has, k = here.after(board_poses[np.array([b])].inverse()), station_poses, has_station, s
        else:
            pose, into, has, k = station_poses[np.array([s])].inverse().after(here), board_poses, has_board, b
        into.R[k], into.t_mm[k] = pose.R[0], pose.t_mm[0]
        has[k] = True
    return station_poses, board_poses, has_station, has_board


def given_poses(
    station: np.ndarray,
    board: np.ndarray,
    weight: np.ndarray,
    camera_from_board: Poses,
    given: Poses,
    known: np.ndarray,
    stations: int,
) -> tuple[Poses, Poses, np.ndarray, np.ndarray]:
    """As `spanning_poses`, with the poses `given` (B) of the boards in the mask `known` (B,): each station is where its
    strongest board of them says, and each other board where its strongest station says."""
    station_poses, board_poses = Poses.identity(stations), Poses(given.R.copy(), given.t_mm.copy())
    has_station, has_board = np.zeros(stations, bool), known.copy()
    order = np.argsort(-weight, kind="stable")
    for e in order:
        s, b = int(station[e]), int(board[e])
        if known[b] and not has_station[s]:
            pose = camera_from_board[np.array([e])].after(given[np.array([b])].inverse())
            station_poses.R[s], station_poses.t_mm[s], has_station[s] = pose.R[0], pose.t_mm[0], True
    for e in order:
        s, b = int(station[e]), int(board[e])
        if has_station[s] and not has_board[b]:
            pose = station_poses[np.array([s])].inverse().after(camera_from_board[np.array([e])])
            board_poses.R[b], board_poses.t_mm[b], has_board[b] = pose.R[0], pose.t_mm[0], True
    return station_poses, board_poses, has_station, has_board


def groups_apart(station: np.ndarray, board: np.ndarray, stations: int, boards: int) -> list[tuple[list, list]]:
    """The graph's connected parts that have an edge: their stations and their boards, the largest first."""
    nodes = stations + boards
    joined = csr_matrix((np.ones(len(station)), (station, stations + board)), shape=(nodes, nodes))
    _, part = connected_components(joined, directed=False)
    groups = []
    for k in np.unique(part[station]):
        inside = np.flatnonzero(part == k)
        groups.append((inside[inside < stations].tolist(), (inside[inside >= stations] - stations).tolist()))
    return sorted(groups, key=lambda group: -len(group[0]))
