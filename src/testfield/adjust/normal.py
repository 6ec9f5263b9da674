"""Normal equations, points apart from all other unknowns, and their reduction (Schur complement).

A point appears only in its own observations, so its 3 x 3 block is inverted at once and what remains couples cameras,
stations, boards and the few points that distances tie together. `across` (n, 3, P) between points and the rest is made
for some points at a time, so that memory does not grow with the network.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import dsyrk

from testfield.adjust.linear import Derivatives, Structure
from testfield.adjust.network import EXACT_MM, Network
from testfield.adjust.side_by_side import side_by_side
from testfield.errors import TestfieldError

PARTS = 8
"""At least so many chunks, for as many threads; not the number of cores, or sums would depend on it."""
CHUNK_NUMBERS = 16_000_000
"""Numbers of `across` that a thread holds at a time."""
SINGULAR = 1e-13
"""Smallest eigenvalue of a reduced normal matrix of unit diagonal that still determines its unknowns."""


class NormalEquations:
    """Normal equations of one linearisation."""

    def __init__(self, network: Network, structure: Structure, derivatives: list[Derivatives]):
        self.structure, self.derivatives = structure, derivatives
        layout, n = structure.layout, len(network.point_mm)
        self.size = layout.size
        self.normal, self.right = np.zeros((self.size, self.size)), np.zeros(self.size)
        for group, d in zip(structure.groups, derivatives, strict=True):
            flat = d.by_unknown.reshape(-1, d.by_unknown.shape[2])
            self.normal[np.ix_(group.columns, group.columns)] += flat.T @ flat
            self.right[group.columns] += flat.T @ d.residual.ravel()
        blocks = [np.zeros((0, 9)), *(d.point_normal.reshape(-1, 9) for d in derivatives)]
        rights = [np.zeros((0, 3)), *(d.point_right for d in derivatives)]
        self.point_normal = np.asarray(structure.gather @ np.concatenate(blocks)).reshape(n, 3, 3)
        self.point_right = np.asarray(structure.gather @ np.concatenate(rights))

        self._add_what_was_known(network)
        self._add_distances(network)
        # Points nobody observed, and those kept in the reduced system, stay where they are.
        idle = np.ones(n, bool)
        idle[network.seen_points] = False
        idle[network.kept_points] = True
        self.point_normal[idle], self.point_right[idle] = np.eye(3), 0

    def _add_what_was_known(self, network: Network) -> None:
        layout = self.structure.layout
        for k, camera in enumerate(network.cameras):
            columns = np.arange(layout.camera[k], layout.camera[k + 1])
            weight = 1 / camera.u[camera.unknown] ** 2
            self.normal[columns, columns] += weight
            self.right[columns] += weight * (camera.known - camera.interior.parameters)[camera.unknown]
            aspect = camera.aspect[camera.unknown]
            self.normal[np.ix_(columns, columns)] += np.outer(aspect, aspect)
            self.right[columns] -= aspect * (camera.aspect @ camera.interior.parameters)
        if network.known_boards:
            off = network.known_boards.deviation(network.boards)
            for b, (ways, weight) in enumerate(zip(network.ways, network.known_boards.information, strict=True)):
                columns = np.arange(layout.board[b], layout.board[b + 1])
                self.normal[np.ix_(columns, columns)] += ways.T @ (weight[:, None] * ways)
                self.right[columns] += ways.T @ (weight * off[b])
        if network.known_members:
            off = network.known_members.deviation(network.members[1:]).ravel()
            weight = network.known_members.information.ravel()
            columns = layout.member + np.arange(len(off))
            self.normal[columns, columns] += weight
            self.right[columns] += weight * off
        if network.scale_free:
            self.normal[layout.scale, layout.scale] += 1 / network.u_scale**2
            self.right[layout.scale] += (1 - network.scale) / network.u_scale**2
        pull = np.einsum("nij,nj->ni", network.information, network.known_mm - network.point_mm)
        self.point_normal = self.point_normal + network.information
        self.point_right = self.point_right + pull
        for number, point in enumerate(network.kept_points):
            at = layout.kept + 3 * number + np.arange(3)
            self.normal[np.ix_(at, at)] += network.information[point]
            self.right[at] += pull[point]

    def _add_distances(self, network: Network) -> None:
        gap, weight, rows = distance_rows(network, self.structure)
        for g, w, (columns, values) in zip(gap, weight, rows, strict=True):
            self.normal[np.ix_(columns, columns)] += w * w * np.outer(values, values)
            self.right[columns] += w * w * g * values

    def across(self, first: int, last: int) -> np.ndarray:
        """(last - first, 3, P) of the normal matrix between points and the reduced unknowns."""
        block = np.zeros((last - first, 3, self.size))
        for group, d in zip(self.structure.groups, self.derivatives, strict=True):
            if group.kept:
                continue
            a, b = np.searchsorted(group.points, [first, last])
            if a == b:
                continue
            part = np.swapaxes(d.by_point[a:b], 1, 2) @ d.by_unknown[a:b]
            points = group.points[a:b] - first
            # Slices are added several times faster than scattered rows and columns.
            rows = slice(points[0], points[-1] + 1) if points[-1] - points[0] == len(points) - 1 else points
            start = 0
            for run in group.column_runs:
                block[rows, :, run] += part[:, :, start : start + run.stop - run.start]
                start += run.stop - run.start
        return block

    def chunks(self) -> list[tuple[int, int]]:
        """Ranges of points whose `across` is made at a time, the same on every machine: their sums are in order."""
        n = len(self.point_normal)
        step = max(1, min(CHUNK_NUMBERS // (3 * max(self.size, 1)), -(-n // PARTS)))
        return [(first, min(first + step, n)) for first in range(0, n, step)]

    def reduced(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The reduced normal matrix (P, P), its right side (P,) and the points' inverse blocks (n, 3, 3)."""
        own = self.point_normal * (1 + damping * np.eye(3))
        try:
            # L with L L^T = inverse: the reduction is then a symmetric product.
            factor = np.linalg.inv(np.linalg.cholesky(own))
        except np.linalg.LinAlgError as error:
            raise TestfieldError(
                f"{_undetermined(own)} point(s) are not determined by their observations",
                do="a point needs two images from different directions",
            ) from error
        inverse = np.swapaxes(factor, 1, 2) @ factor
        normal = self.normal.copy(order="F")
        normal[np.diag_indices(self.size)] *= 1 + damping
        right = self.right.copy()

        def reduction(chunk: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
            here = slice(*chunk)
            half = (factor[here] @ self.across(*chunk)).reshape(-1, self.size)
            own_right = np.einsum("nij,nj->ni", factor[here], self.point_right[here]).ravel()
            return dsyrk(1.0, half.T), half.T @ own_right

        multiplications = 3 * len(self.point_normal) * self.size**2
        for less, less_right in side_by_side(reduction, self.chunks(), multiplications):
            normal -= less
            right -= less_right
        return mirrored(normal), right, inverse

    def back_substituted(self, step: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """(n, 3) step of the points that goes with a step (P,) of the reduced unknowns."""
        right = self.point_right.copy()
        for group, d in zip(self.structure.groups, self.derivatives, strict=True):
            if not group.kept:
                change = d.by_unknown @ step[group.columns]
                right[group.points] -= np.einsum("nij,ni->nj", d.by_point, change)
        return np.einsum("nij,nj->ni", inverse, right)

    def relative_size(self, step: np.ndarray) -> float:
        """The largest step in units of what its unknown's own observations resolve."""
        return float(np.abs(step * np.sqrt(np.diag(self.normal))).max(initial=0))


def distance_rows(
    network: Network, structure: Structure
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Residuals (d,) of the distances, their weights' square roots, and each one's columns with derivatives."""
    layout, ends = structure.layout, network.distances.ends
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


class Factor:
    """Cholesky factor of a reduced normal matrix at unit diagonal, the directions that the datum leaves open (P, d)
    held still; a singular one is an error that names its unknowns."""

    def __init__(self, normal: np.ndarray, labels: list[str], open_ways: np.ndarray | None = None):
        own = np.diag(normal)
        self.scale = 1 / np.sqrt(np.where(own > 0, own, 1))  # nothing is known where the diagonal is not positive
        unit = normal * self.scale[:, None] * self.scale[None, :]
        if open_ways is not None and open_ways.shape[1]:
            basis = np.linalg.qr(open_ways / self.scale[:, None])[0]
            unit = unit + basis @ basis.T
        if not np.isfinite(unit).all():
            raise TestfieldError(
                "the adjustment runs away: its equations are no finite numbers",
                "observations",
                "check that images, boards and points are named as they are",
            )
        try:
            self.factor = cho_factor(unit)
            sound = float(np.min(np.abs(np.diag(self.factor[0])), initial=1)) ** 2 > SINGULAR
        except np.linalg.LinAlgError:
            sound = False
        if not sound:
            values, vectors = np.linalg.eigh(unit)
            weak = np.abs(vectors[:, : max(1, int((values < 1e-12).sum()))]).max(axis=1, initial=0)
            named = [labels[k] for k in np.argsort(-weak)[:6] if weak[k] > 0.1]
            raise TestfieldError(
                f"the observations do not determine {', '.join(named) or 'all unknowns'}",
                do="add stations with other directions and roll, or hold a lens parameter (measure.hold)",
            )

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solution for right sides (P,) or (P, q)."""
        scale = self.scale if right.ndim == 1 else self.scale[:, None]
        return scale * cho_solve(self.factor, scale * right)


def mirrored(upper: np.ndarray) -> np.ndarray:
    """A symmetric matrix of which only the upper triangle was made, completed in place."""
    step = 256
    for first in range(0, len(upper), step):
        here = slice(first, first + step)
        upper[here, :first] = upper[:first, here].T
        block = upper[here, here]
        upper[here, here] = np.triu(block) + np.triu(block, 1).T
    return upper


def _undetermined(own: np.ndarray) -> int:
    """How many 3 x 3 blocks are singular."""
    return int((np.linalg.eigvalsh(own)[:, 0] <= 1e-14 * np.trace(own, axis1=1, axis2=2)).sum())
