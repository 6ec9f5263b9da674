"""Normal equations, points apart from all other unknowns, and their reduction (Schur complement).

A point appears only in its own observations, so its 3 x 3 block is inverted at once and what remains couples cameras,
stations, boards and the few points that distances tie together. The part between points and the rest is made for one
chunk of points at a time, so that memory does not grow with the network.
"""

from itertools import pairwise

import numpy as np
from scipy.linalg.blas import dsyrk

from testfield.adjust.by_point import (
    gathered,
    point_factors,
    point_normals,
    point_rows,
    prediction_rows,
    spread,
    take_away,
)
from testfield.adjust.chunks import Chunk
from testfield.adjust.factor import mirrored
from testfield.adjust.groups import Group, Structure
from testfield.adjust.known import add_distances, add_what_was_known
from testfield.adjust.linear import Derivatives
from testfield.adjust.network import Network
from testfield.adjust.side_by_side import THREADS, side_by_side
from testfield.errors import TestfieldError


class NormalEquations:
    """Normal equations of one linearisation: `normal` (P, P) and `right` (P,) of the reduced unknowns, `point_normal`
    (n, 3, 3) and `point_right` (n, 3) of the points."""

    def __init__(self, network: Network, structure: Structure, derivatives: Derivatives):
        self.structure, self.derivatives = structure, derivatives
        self.size = structure.layout.size
        self.normal, self.right = np.zeros((self.size, self.size)), np.zeros(self.size)
        residual = derivatives.residual
        for group in structure.groups:
            A = self._flat(group)
            self.normal[np.ix_(group.columns, group.columns)] += A.T @ A
            self.right[group.columns] += A.T @ residual[group.here].ravel()
            if group.kept:
                self._add_kept(group)
        self.point_normal = point_normals(structure.first, structure.ray, derivatives.by_point)
        self.point_right = gathered(structure.first, structure.ray, derivatives.by_point, residual)
        add_what_was_known(self.normal, self.right, structure.layout, network)
        add_distances(self.normal, self.right, structure.layout, network)
        told = np.flatnonzero(network.information.any(axis=(1, 2)))
        self.point_normal[told] += network.information[told]
        off = (network.known_mm - network.point_mm)[told]
        self.point_right[told] += np.einsum("nij,nj->ni", network.information[told], off)
        # Points nobody observed, and those kept in the reduced system, stay where they are.
        idle = np.diff(structure.first) == 0
        self.point_normal[idle], self.point_right[idle] = np.eye(3), 0

    def _flat(self, group: Group) -> np.ndarray:
        """(2k, p) derivatives of a group's observations by its unknowns."""
        return self.derivatives.by_unknown[group.here, :, : len(group.columns)].reshape(-1, len(group.columns))

    def _add_kept(self, group: Group) -> None:
        A, B = self._flat(group), self.derivatives.by_point[group.here]
        own = self.structure.kept_at[group.points][:, None] + np.arange(3)
        across = np.einsum("kip,kij->pkj", A.reshape(len(B), 2, -1), B).reshape(A.shape[1], -1)
        self.normal[np.ix_(group.columns, own.ravel())] += across
        self.normal[np.ix_(own.ravel(), group.columns)] += across.T
        self.normal[own[:, :, None], own[:, None, :]] += np.swapaxes(B, 1, 2) @ B
        self.right[own] += np.einsum("kij,ki->kj", B, self.derivatives.residual[group.here])

    def rows(self, points: np.ndarray, by: np.ndarray, place: np.ndarray, width: int) -> np.ndarray:
        """(k, 3, width): of k points, `by` (n, 3, 3) of each times its part of the normal matrix with the reduced
        unknowns, unknown c in column `place[c]`; zero of kept points."""
        s, d = self.structure, self.derivatives
        points = np.array(points, np.int64)
        return np.asarray(
            point_rows(points, s.first, s.ray, s.group, s.columns, s.count, d.by_unknown, d.by_point, by, place, width)
        )

    def prediction_rows(self, points: np.ndarray, rows: np.ndarray, place: np.ndarray) -> np.ndarray:
        """(q, 2, u): how the predictions of all observations of k points follow the reduced unknowns when the points
        follow them by minus `rows` (k, 3, u), unknown c in column `place[c]`."""
        s, d = self.structure, self.derivatives
        points = np.array(points, np.int64)
        return np.asarray(
            prediction_rows(points, s.first, s.ray, s.group, s.columns, s.count, d.by_unknown, d.by_point, rows, place)
        )

    def placed(self, chunk: Chunk) -> np.ndarray:
        """(P,) the column of each unknown in a chunk's matrices."""
        place = np.zeros(self.size, np.int64)
        place[chunk.columns] = np.arange(len(chunk.columns))
        return place

    def to_points(self, step: np.ndarray) -> np.ndarray:
        """(n, 3): the points' part of the normal matrix times a step (P,) of the reduced unknowns."""
        s, d = self.structure, self.derivatives
        change = np.empty(d.residual.shape)
        for group in s.groups:
            change[group.here] = (self._flat(group) @ step[group.columns]).reshape(-1, 2)
        return np.asarray(gathered(s.first, s.ray, d.by_point, change))

    def from_points(self, amounts: np.ndarray) -> np.ndarray:
        """(P, d): the same matrix' transpose times amounts (n, 3, d) of the points."""
        answer = np.zeros((self.size, amounts.shape[2]))
        change = spread(self.structure.point, self.derivatives.by_point, np.ascontiguousarray(amounts))
        for group in self.structure.groups:
            if not group.kept:
                answer[group.columns] += self._flat(group).T @ change[group.here].reshape(-1, amounts.shape[2])
        return answer

    def reduced(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The reduced normal matrix (P, P), its right side (P,) and the points' inverse blocks (n, 3, 3)."""
        # F with F' F = inverse: the reduction is then a symmetric product.
        factor, inverse, bad = point_factors(self.point_normal, damping)
        if bad:
            raise TestfieldError(
                f"{_undetermined(self.point_normal * (1 + damping * np.eye(3))) or bad} point(s) are not determined by "
                "their observations",
                do="a point needs two images from different directions",
            )
        normal = self.normal.copy(order="F")
        normal[np.diag_indices(self.size)] *= 1 + damping
        own = np.einsum("nij,nj->ni", inverse, self.point_right)
        right = self.right - self.from_points(own[:, :, None])[:, 0]
        chunks = self.structure.chunks
        dense = [chunk for chunk in chunks if chunk.dense]

        def product(chunk: Chunk) -> np.ndarray:
            width = len(chunk.columns)
            half = self.rows(chunk.points, factor, self.placed(chunk), width)
            return np.asarray(dsyrk(1.0, half.reshape(-1, width).T))

        work = sum(3 * len(chunk.points) * len(chunk.columns) ** 2 for chunk in dense)
        for chunk, less in zip(dense, side_by_side(product, dense, work), strict=True):
            if len(chunk.columns) == self.size:
                normal -= less
            else:
                normal[np.ix_(chunk.columns, chunk.columns)] -= less
        self._take_away([chunk.points for chunk in chunks if not chunk.dense], factor, normal)
        return mirrored(normal), right, inverse

    def _take_away(self, points: list[np.ndarray], factor: np.ndarray, normal: np.ndarray) -> None:
        """What points that share little with each other take from the upper triangle of `normal`; every element is
        added up in the order of the points, whoever adds it."""
        if not points:
            return
        s, d, alone = self.structure, self.derivatives, np.concatenate(points)
        edges = np.unique(np.linspace(0, self.size, THREADS + 1).astype(int)).tolist()

        def part(rows: tuple[int, int]) -> None:
            take_away(
                normal.T, *rows, alone, s.first, s.ray, s.group, s.columns, s.count, d.by_unknown, d.by_point, factor
            )

        for _ in side_by_side(part, list(pairwise(edges)), 3 * len(alone) * 100**2):
            pass

    def back_substituted(self, step: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """(n, 3) step of the points that goes with a step (P,) of the reduced unknowns."""
        return np.einsum("nij,nj->ni", inverse, self.point_right - self.to_points(step))

    def relative_size(self, step: np.ndarray) -> float:
        """The largest step in units of what its unknown's own observations resolve."""
        return float(np.abs(step * np.sqrt(np.diag(self.normal))).max(initial=0))


def _undetermined(own: np.ndarray) -> int:
    """How many 3 x 3 blocks are singular."""
    return int((np.linalg.eigvalsh(own)[:, 0] <= 1e-14 * np.trace(own, axis1=1, axis2=2)).sum())
