"""Which images see which boards, and the tree that joins them all to the first board."""

from collections import deque

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import minimum_spanning_tree

from testfield.camera.pose import Poses


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
    nodes = stations + boards
    # The spanning tree of least cost keeps the heaviest edges; a cost of zero would read as no edge.
    cost = csr_matrix((1 / weight, (station, stations + board)), shape=(nodes, nodes))
    tree = minimum_spanning_tree(cost).tocoo()
    edge_of = {(s, b): e for e, (s, b) in enumerate(zip(station, board, strict=True))}
    neighbours: dict[int, list[int]] = {k: [] for k in range(nodes)}
    for a, b in zip(tree.row, tree.col, strict=True):
        neighbours[int(a)].append(int(b))
        neighbours[int(b)].append(int(a))

    station_poses, board_poses = Poses.identity(stations), Poses.identity(boards)
    reached = np.zeros(nodes, bool)
    reached[stations] = True
    queue = deque([stations])
    while queue:
        node = queue.popleft()
        for other in neighbours[node]:
            if reached[other]:
                continue
            reached[other] = True
            queue.append(other)
            s, b = (node, other - stations) if node < stations else (other, node - stations)
            here = camera_from_board[np.array([edge_of[s, b]])]
            if other < stations:
                pose, into = here.after(board_poses[np.array([b])].inverse()), station_poses
            else:
                pose, into = station_poses[np.array([s])].inverse().after(here), board_poses
            k = other if other < stations else b
            into.R[k], into.t_mm[k] = pose.R[0], pose.t_mm[0]
    return station_poses, board_poses, reached[:stations], reached[stations:]
