"""What was known before any image was taken, and distances, as parts of the normal equations."""

import numpy as np

from testfield.adjust.network import EXACT_MM, Layout, Network


def add_what_was_known(normal: np.ndarray, right: np.ndarray, layout: Layout, network: Network) -> None:
    """To normal equations (P, P), (P,) of the reduced unknowns: cameras, boards, members, the scale, kept points."""
    for k, camera in enumerate(network.cameras):
        columns = np.arange(layout.camera[k], layout.camera[k + 1])
        weight = 1 / camera.u[camera.unknown] ** 2
        normal[columns, columns] += weight
        right[columns] += weight * (camera.known - camera.interior.parameters)[camera.unknown]
        aspect = camera.aspect[camera.unknown]
        normal[np.ix_(columns, columns)] += np.outer(aspect, aspect)
        right[columns] -= aspect * (camera.aspect @ camera.interior.parameters)
    if network.known_boards:
        off = network.known_boards.deviation(network.boards)
        for b, (ways, weight) in enumerate(zip(network.ways, network.known_boards.information, strict=True)):
            columns = np.arange(layout.board[b], layout.board[b + 1])
            normal[np.ix_(columns, columns)] += ways.T @ (weight[:, None] * ways)
            right[columns] += ways.T @ (weight * off[b])
    if network.known_members:
        off = network.known_members.deviation(network.members[1:]).ravel()
        weight = network.known_members.information.ravel()
        columns = layout.member + np.arange(len(off))
        normal[columns, columns] += weight
        right[columns] += weight * off
    if network.scale_free:
        normal[layout.scale, layout.scale] += 1 / network.u_scale**2
        right[layout.scale] += (1 - network.scale) / network.u_scale**2
    for number, point in enumerate(network.kept_points):
        at = layout.kept + 3 * number + np.arange(3)
        normal[np.ix_(at, at)] += network.information[point]
        right[at] += network.information[point] @ (network.known_mm - network.point_mm)[point]


def add_distances(normal: np.ndarray, right: np.ndarray, layout: Layout, network: Network) -> None:
    """To the same: distances between kept points."""
    gap, weight, rows = distance_rows(network, layout)
    for g, w, (columns, values) in zip(gap, weight, rows, strict=True):
        normal[np.ix_(columns, columns)] += w * w * np.outer(values, values)
        right[columns] += w * w * g * values


def distance_rows(
    network: Network, layout: Layout
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Residuals (d,) of the distances, their weights' square roots, and each one's columns with derivatives."""
    ends = network.distances.ends
    place = {int(point): k for k, point in enumerate(network.kept_points)}
    at = network.datum_mm(ends.ravel()).reshape(-1, 2, 3)
    difference = at[:, 0] - at[:, 1]
    length = np.linalg.norm(difference, axis=1)
    direction = difference / np.maximum(length, 1e-300)[:, None]
    rows = []
    for pair, d, where in zip(ends, direction, at, strict=True):
        total = np.zeros(layout.size)
        for point, sign, x in zip(pair, (1.0, -1.0), where, strict=True):
            board, toward = network.point_board[point], sign * d
            if board >= 0:
                lever = x - network.boards.t_mm[board]
                six = np.concatenate([np.cross(lever, toward), toward])
                total[layout.board[board] : layout.board[board + 1]] += six @ network.ways[board]
                if network.scale_free:
                    total[layout.scale] += toward @ lever / network.scale
                toward = network.scale * toward @ network.boards.R[board]
            first = layout.kept + 3 * place[int(point)]
            total[first : first + 3] += toward
        columns = np.flatnonzero(total)
        rows.append((columns, total[columns]))
    return network.distances.length_mm - length, 1 / np.maximum(network.distances.u_mm, EXACT_MM), rows
