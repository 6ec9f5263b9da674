"""Covariances of everything that was adjusted, and between any of it, made when asked for.

With A the inverse of the reduced normal matrix and Y = (points' blocks)^-1 x across, the points' deviations are their
own, with covariance (points' blocks)^-1, less Y times those of the reduced unknowns. Open motions H are taken away by
x - H K x_J, where K makes the chosen points J stand still on the whole.
"""

import numpy as np
from scipy.linalg.blas import dsyr2k, dsyrk

from testfield.adjust.linear import Structure
from testfield.adjust.network import Network
from testfield.adjust.normal import NormalEquations, mirrored


class Covariance:
    """Covariance of an adjusted network.

    `reduced` (P, P) of the reduced unknowns in the order of `Network.labels`. Points are named by their numbers in the
    network; their coordinates are those of `Network.point_mm`, on boards the board's own.
    """

    def __init__(
        self,
        network: Network,
        equations: NormalEquations,
        inverse: np.ndarray,
        own: np.ndarray,
        open_ways: tuple[np.ndarray, np.ndarray],
        datum_points: np.ndarray,
    ):
        self._equations, self._inverse, self._own = equations, inverse, own
        self._structure: Structure = equations.structure
        self._place = {int(point): k for k, point in enumerate(network.kept_points)}
        self._by_reduced, self._by_point = open_ways
        self.reduced = inverse
        if self._by_reduced.shape[1]:
            self._hold(datum_points)

    def _hold(self, datum_points: np.ndarray) -> None:
        H = self._by_point[datum_points].reshape(-1, self._by_reduced.shape[1])
        if len(H) >= H.shape[1] and np.linalg.matrix_rank(H) == H.shape[1]:
            K = np.linalg.solve(H.T @ H, H.T).reshape(H.shape[1], -1, 3)
            own, y = self._rows(datum_points)
            self._K = {int(p): K[:, k] for k, p in enumerate(datum_points)}
            self._M = -np.einsum("dki,kip->dp", K, y)
            self._E = np.einsum("dki,kij,ekj->de", K, own, K) + self._M @ self._inverse @ self._M.T
        else:  # no points to hold: the stations stand still on the whole
            H = self._by_reduced
            self._K, self._M = {}, np.linalg.solve(H.T @ H, H.T)
            self._E = self._M @ self._inverse @ self._M.T
        T = self._M @ self._inverse
        H = self._by_reduced
        self.reduced = self._inverse - H @ T - T.T @ H.T + H @ self._E @ H.T

    def _rows(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of k points: the covariance of their own part (k, 3, 3) and Y (k, 3, P)."""
        points = np.asarray(points, int)
        own, y = self._own[points].copy(), np.zeros((len(points), 3, self._equations.size))
        if not len(points):
            return own, y
        kept = np.array([int(p) in self._place for p in points])
        # Neighbouring numbers are made together; what lies between them is not worth a second pass.
        order = np.argsort(points, kind="stable")
        for run in np.split(order, np.flatnonzero(np.diff(points[order]) > 64) + 1):
            first, last = int(points[run[0]]), int(points[run[-1]]) + 1
            across = self._equations.across(first, last)[points[run] - first]
            y[run] = self._own[points[run]] @ across
        for k in np.flatnonzero(kept):
            at = self._structure.layout.kept + 3 * self._place[int(points[k])]
            own[k], y[k] = 0, 0
            y[k][[0, 1, 2], [at, at + 1, at + 2]] = -1
        return own, y

    def points(self, points: np.ndarray) -> np.ndarray:
        """(3k, 3k) joint covariance of k points in mm^2."""
        if not len(points):
            return np.zeros((0, 0))
        own, y = self._rows(points)
        flat, k = y.reshape(-1, self._equations.size), len(points)
        # Symmetric products: half the work.
        half = np.asfortranarray((flat @ np.linalg.cholesky(self._inverse)).T)
        answer = dsyrk(1.0, half, trans=True)
        if self._by_reduced.shape[1]:
            H = self._by_point[points].reshape(3 * k, -1)
            change = 0.5 * H @ self._E - self._motion(points, own, flat).T
            answer = dsyr2k(1.0, H, change, beta=1.0, c=answer, overwrite_c=True)
        answer = mirrored(answer).T
        blocks = answer.reshape(k, 3, k, 3)
        blocks[np.arange(k), :, np.arange(k)] += own
        return answer

    def across(self, points: np.ndarray) -> np.ndarray:
        """(3k, P) covariance between k points and the reduced unknowns."""
        own, y = self._rows(points)
        flat = y.reshape(-1, self._equations.size)
        answer = -flat @ self._inverse
        if self._by_reduced.shape[1]:
            H = self._by_point[points].reshape(len(flat), -1)
            T, T_points = self._M @ self._inverse, self._motion(points, own, flat)
            answer += -H @ T - T_points.T @ self._by_reduced.T + H @ self._E @ self._by_reduced.T
        return answer

    def joint(self, by_reduced: np.ndarray, points: np.ndarray, by_points: np.ndarray) -> np.ndarray:
        """(q, q) covariance of q quantities that are linear in the reduced unknowns (q, P) and in k points (q, 3k):
        distances, angles, positions in the datum frame."""
        own, y = self._rows(points)
        flat = y.reshape(-1, self._equations.size)
        k = len(points)
        gain = by_reduced - by_points @ flat
        root = np.zeros_like(by_points)
        for column in range(3):  # by_points @ blockdiag(own), without making the diagonal
            root[:, column::3] = np.einsum("qki,ki->qk", by_points.reshape(-1, k, 3), own[:, :, column])
        answer = gain @ self._inverse @ gain.T + root @ by_points.T
        if self._by_reduced.shape[1]:
            H = by_reduced @ self._by_reduced + by_points @ self._by_point[points].reshape(3 * k, -1)
            T = self._M @ self._inverse @ by_reduced.T + self._motion(points, own, flat) @ by_points.T
            answer += -H @ T - T.T @ H.T + H @ self._E @ H.T
        return 0.5 * (answer + answer.T)

    def point_blocks(self) -> np.ndarray:
        """(n, 3, 3) covariance of every point by itself."""
        n = len(self._own)
        answer = np.empty((n, 3, 3))
        step = max(1, 20_000_000 // (3 * self._equations.size))
        for first in range(0, n, step):
            points = np.arange(first, min(first + step, n))
            own, y = self._rows(points)
            flat = y.reshape(-1, self._equations.size)
            half = (flat @ self._inverse).reshape(y.shape)
            answer[points] = own + half @ np.swapaxes(y, 1, 2)
            if self._by_reduced.shape[1]:
                H = self._by_point[points]
                T = np.moveaxis(self._motion(points, own, flat).reshape(-1, len(points), 3), 0, 1)
                cross = H @ T
                answer[points] += H @ self._E @ np.swapaxes(H, 1, 2) - cross - np.swapaxes(cross, 1, 2)
        return answer

    def _motion(self, points: np.ndarray, own: np.ndarray, flat: np.ndarray) -> np.ndarray:
        """(d, 3k) covariance of the held motion with k points."""
        answer = -self._M @ self._inverse @ flat.T
        for k, point in enumerate(np.asarray(points, int)):
            if int(point) in self._K:
                answer[:, 3 * k : 3 * k + 3] += self._K[int(point)] @ own[k]
        return answer

    def of_predictions(self) -> list[np.ndarray]:
        """For each group (k, 2, 2): the covariance of its whitened predicted observations."""
        answer = []
        for group, d in zip(self._structure.groups, self._equations.derivatives, strict=True):
            own, y = self._rows(group.points)
            gain = np.zeros((len(group.rows), 2, self._equations.size))
            gain[:, :, group.columns] = d.by_unknown
            gain -= d.by_point @ y
            half = (gain.reshape(-1, self._equations.size) @ self._inverse).reshape(gain.shape)
            answer.append(half @ np.swapaxes(gain, 1, 2) + d.by_point @ own @ np.swapaxes(d.by_point, 1, 2))
        return answer
