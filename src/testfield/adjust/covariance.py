"""Covariances of everything that was adjusted, and between any of it, made when asked for.

With z the deviations of the reduced unknowns and Y = (points' blocks)^-1 x across, the points' deviations are their
own, with covariance (points' blocks)^-1, less Y z. Open motions H are taken away by x - H m, m = K x_J, where K makes
the chosen points J stand still on the whole. So z and m together, with covariance C, are all that points share: the
deviation of a point is its own less (Y, H) times them, of which its own and m have the covariance `pull`.
"""

import numpy as np

from testfield.adjust.chunks import Chunk
from testfield.adjust.known import add_distances, add_what_was_known
from testfield.adjust.network import Network
from testfield.adjust.normal import NormalEquations
from testfield.adjust.side_by_side import side_by_side
from testfield.camera.interior import MODE
from testfield.store.threads import one_blas_thread

TILE = 256
"""Rows and columns of a large product that are made at a time, the same on every machine."""
BLOCK_NUMBERS = 2_000_000
"""Numbers of a chunk's matrices that a thread holds at a time."""


class Covariance:
    """Covariance of an adjusted network.

    `reduced` (P, P) of the reduced unknowns in the order of `Network.labels`. Points are named by their numbers in the
    network; their coordinates are those of `Network.point_mm`, on boards the board's own.
    """

    def __init__(
        self,
        equations: NormalEquations,
        inverse: np.ndarray,
        own: np.ndarray,
        open_ways: tuple[np.ndarray, np.ndarray],
        datum_points: np.ndarray,
        widened: np.ndarray | None = None,
    ):
        self._equations, self._inverse, self._own = equations, inverse, own
        self._open_ways, self._datum_points = open_ways, datum_points
        self._kept_at = equations.structure.kept_at
        by_reduced, by_point = open_ways
        self._d = by_reduced.shape[1]
        self.reduced = self._shared = inverse if widened is None else widened
        if self._d:
            self._hold(self.reduced, by_reduced, by_point, datum_points)

    @one_blas_thread()
    def widened(self, network: Network, factor: float) -> "Covariance":
        """The same where what observations of an adjusted `network` do to the reduced unknowns, but not what was known
        before, has `factor` times the variance. What points have by themselves stays: their rays' own errors. The
        amounts of a lens' smooth field were known to 0 +- sqrt(`factor`)."""
        D, layout = np.zeros_like(self._inverse), self._equations.structure.layout
        add_what_was_known(D, np.zeros(len(D)), layout, network)
        for first, camera in zip(layout.camera, network.cameras, strict=False):
            names = np.array(camera.interior.names)[camera.unknown]
            amounts = first + np.flatnonzero(np.char.startswith(names.astype(str), MODE))
            D[amounts, amounts] = 0
        add_distances(D, np.zeros(len(D)), layout, network)
        told = np.flatnonzero(network.information.any(axis=(1, 2)) & (self._kept_at < 0))
        for first in range(0, len(told), TILE):
            points = told[first : first + TILE]
            follow = self._equations.rows(points, self._own, np.arange(len(D)), len(D))
            D += np.tensordot(follow, network.information[points] @ follow, ([0, 1], [0, 1]))
        C = self._inverse
        wide = factor * C - (factor - 1) * C @ D @ C
        wide = 0.5 * (wide + wide.T)
        return Covariance(self._equations, C, self._own, self._open_ways, self._datum_points, wide)

    def _hold(self, C: np.ndarray, by_reduced: np.ndarray, by_point: np.ndarray, datum_points: np.ndarray) -> None:
        d, n = self._d, len(self._own)
        H = by_point[datum_points].reshape(-1, d)
        pull = np.zeros((n, 3, d))
        if len(H) >= d and np.linalg.matrix_rank(H) == d:
            K = np.swapaxes(np.linalg.solve(H.T @ H, H.T).reshape(d, -1, 3), 0, 1)
            kept = self._kept_at[datum_points]
            alone = datum_points[kept < 0]
            pull[alone] = self._own[alone] @ np.swapaxes(K[kept < 0], 1, 2)
            M = -self._equations.from_points(pull).T
            for at, gain in zip(kept[kept >= 0], K[kept >= 0], strict=True):
                M[:, at : at + 3] += gain
            E = np.einsum("kdi,kie->de", K[kept < 0], pull[alone]) + M @ C @ M.T
        else:  # no points to hold: the stations stand still on the whole
            M = np.linalg.solve(by_reduced.T @ by_reduced, by_reduced.T)
            E = M @ C @ M.T
        G = C @ M.T
        self._H, self._by_point, self._pull = by_reduced, by_point, pull
        self._shared = np.block([[C, G], [G.T, 0.5 * (E + E.T)]])
        across = G @ by_reduced.T
        self.reduced = C - across - across.T + by_reduced @ E @ by_reduced.T

    def _rows(self, points: np.ndarray, chunk: Chunk | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Of k points: the covariance of their own part (k, 3, 3), and (Y, H) (k, 3, P + d); of a chunk's unknowns
        alone (k, 3, u + d), if it is given."""
        size = self._equations.size if chunk is None else len(chunk.columns)
        place = np.arange(size) if chunk is None else self._equations.placed(chunk)
        points = np.asarray(points, int)
        own = self._own[points]
        y = self._equations.rows(points, self._own, place, size + self._d)
        if self._d:
            y[:, :, size:] = self._by_point[points]
        for k in np.flatnonzero(self._kept_at[points] >= 0):
            at = self._kept_at[points[k]]
            own[k] = 0
            y[k][[0, 1, 2], [at, at + 1, at + 2]] = -1
        return own, y

    def _half(self, points: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(3k, P + d) minus the covariance of k points with what points share."""
        half = y.reshape(-1, y.shape[2]) @ self._shared
        if self._d:
            half[:, -self._d :] -= self._pull[points].reshape(-1, self._d)
        return half

    @one_blas_thread()
    def points(self, points: np.ndarray) -> np.ndarray:
        """(3k, 3k) joint covariance of k points in mm^2."""
        points = np.asarray(points, int)
        if not len(points):
            return np.zeros((0, 0))
        own, y = self._rows(points)
        left, right = self._half(points, y), y.reshape(-1, y.shape[2])
        if self._d:
            left = np.hstack([left, -self._by_point[points].reshape(-1, self._d)])
            right = np.hstack([right, self._pull[points].reshape(-1, self._d)])
        answer = product_of_symmetric(left, right)
        k = len(points)
        answer.reshape(k, 3, k, 3)[np.arange(k), :, np.arange(k)] += own
        return answer

    @one_blas_thread()
    def across(self, points: np.ndarray) -> np.ndarray:
        """(3k, P) covariance between k points and the reduced unknowns."""
        points = np.asarray(points, int)
        half = self._half(points, self._rows(points)[1])
        if not self._d:
            return -half
        return half[:, -self._d :] @ self._H.T - half[:, : -self._d]

    def joint(self, by_reduced: np.ndarray, points: np.ndarray, by_points: np.ndarray) -> np.ndarray:
        """(q, q) covariance of q quantities that are linear in the reduced unknowns (q, P) and in k points (q, 3k):
        distances, angles, positions in the datum frame."""
        points = np.asarray(points, int)
        own, y = self._rows(points)
        k = len(points)
        if self._d:
            by_reduced = np.hstack([by_reduced, -by_reduced @ self._H])
        gain = by_reduced - by_points @ y.reshape(-1, y.shape[2])
        root = np.zeros_like(by_points)
        for column in range(3):  # by_points @ blockdiag(own), without making the diagonal
            root[:, column::3] = np.einsum("qki,ki->qk", by_points.reshape(-1, k, 3), own[:, :, column])
        answer = gain @ self._shared @ gain.T + root @ by_points.T
        if self._d:
            across = gain[:, -self._d :] @ (by_points @ self._pull[points].reshape(-1, self._d)).T
            answer += across + across.T
        return 0.5 * (answer + answer.T)

    def _chunks(self, numbers_of_point: np.ndarray) -> list[Chunk]:
        """Points that are not kept in chunks whose matrices are small; points that share little each by itself."""
        answer = []
        for chunk in self._equations.structure.chunks:
            width = len(chunk.columns) + self._d
            held = np.cumsum(numbers_of_point[chunk.points] * width) // BLOCK_NUMBERS
            if chunk.dense:
                parts = np.split(chunk.points, np.flatnonzero(np.diff(held)) + 1)
                answer += [Chunk(points, chunk.columns, True) for points in parts]
            else:
                answer += [self._equations.structure.alone(point) for point in chunk.points]
        return answer

    def _of_chunk(self, chunk: Chunk) -> np.ndarray:
        """(u + d, u + d) the covariance of what a chunk's points share."""
        size = self._equations.size
        if len(chunk.columns) == size:
            return self._shared
        here = np.concatenate([chunk.columns, size + np.arange(self._d)])
        return self._shared[np.ix_(here, here)]

    @one_blas_thread()
    def point_blocks(self) -> np.ndarray:
        """(n, 3, 3) covariance of every point by itself."""
        answer = self._own.copy()  # of points that nobody saw all there is, in the datum of the reduced unknowns
        left_out = np.flatnonzero(np.diff(self._equations.structure.first) == 0)

        def fill(chunk: Chunk) -> None:
            own, y = self._rows(chunk.points, chunk)
            half = (y.reshape(-1, y.shape[2]) @ self._of_chunk(chunk)).reshape(y.shape)
            answer[chunk.points] = own + self._block(chunk.points, y, half)

        chunks = self._chunks(np.full(len(self._own), 6))
        for _ in side_by_side(fill, chunks, sum(3 * len(c.points) * len(c.columns) ** 2 for c in chunks)):
            pass
        for first in range(0, len(left_out), TILE):
            points = left_out[first : first + TILE]
            own, y = self._rows(points)
            half = (y.reshape(-1, y.shape[2]) @ self._shared).reshape(y.shape)
            answer[points] = own + self._block(points, y, half)
        return answer

    def _block(self, points: np.ndarray, y: np.ndarray, half: np.ndarray) -> np.ndarray:
        block = half @ np.swapaxes(y, 1, 2)
        if self._d:
            across = self._by_point[points] @ np.swapaxes(self._pull[points], 1, 2)
            block -= across + np.swapaxes(across, 1, 2)
        return block

    @one_blas_thread()
    def of_predictions(self) -> np.ndarray:
        """(m, 2, 2) covariances of the whitened predictions, in the structure's order."""
        s, d = self._equations.structure, self._equations.derivatives
        answer = np.empty((len(s.order), 2, 2))
        C = self._inverse

        def fill(chunk: Chunk) -> None:
            place, width = self._equations.placed(chunk), len(chunk.columns)
            y = self._equations.rows(chunk.points, self._own, place, width)
            gain = self._equations.prediction_rows(chunk.points, y, place)
            here = C if width == len(C) else C[np.ix_(chunk.columns, chunk.columns)]
            half = (gain.reshape(-1, width) @ here).reshape(gain.shape)
            rows = s.observations(chunk.points)
            B = d.by_point[rows]
            answer[rows] = half @ np.swapaxes(gain, 1, 2) + B @ self._own[s.point[rows]] @ np.swapaxes(B, 1, 2)

        rays = np.diff(s.first)
        chunks = self._chunks(4 * rays)
        work = sum(2 * int(rays[c.points].sum()) * len(c.columns) ** 2 for c in chunks)
        for _ in side_by_side(fill, chunks, work):
            pass
        for group in s.groups:
            if group.kept:
                own = s.kept_at[group.points][:, None] + np.arange(3)
                columns = np.concatenate([np.tile(group.columns, (len(own), 1)), own], axis=1)
                gain = np.concatenate(
                    [d.by_unknown[group.here, :, : len(group.columns)], d.by_point[group.here]], axis=2
                )
                answer[group.here] = gain @ C[columns[:, :, None], columns[:, None, :]] @ np.swapaxes(gain, 1, 2)
        return answer


def product_of_symmetric(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """left @ right.T (q, q), which is symmetric: half of it is made, in tiles, and mirrored."""
    q = len(left)
    answer = np.empty((q, q))
    edges = [(at, min(at + TILE, q)) for at in range(0, q, TILE)]

    def fill(tile: tuple[tuple[int, int], tuple[int, int]]) -> None:
        (a, b), (c, e) = tile
        part = answer[a:b, c:e]
        np.matmul(left[a:b], right[c:e].T, out=part)
        if a == c:
            part[:] = 0.5 * (part + part.T)
        else:
            answer[c:e, a:b] = part.T

    tiles = [(rows, columns) for k, rows in enumerate(edges) for columns in edges[k:]]
    for _ in side_by_side(fill, tiles, q * q // 2 * left.shape[1]):
        pass
    return answer
