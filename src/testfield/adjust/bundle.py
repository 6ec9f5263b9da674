"""The bundle adjustment: Gauss-Newton on the reduced normal equations, with analytic derivatives.

Points are eliminated (Schur complement), since each appears only in its own observations; cameras, boards, the scale
and points tied by distances remain. Whitened residuals make every weight one, so the inverse of the normal matrix is
the covariance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_matrix

from testfield.adjust.network import EXACT_MM, Network
from testfield.errors import TestfieldError

MOST_STEPS = 60


@dataclass(frozen=True)
class Adjustment:
    """An adjusted network.

    `covariance` (P, P) of the reduced unknowns in the order of `Network.labels`; rotations are small turns applied
    after the pose's rotation, in rad, translations in mm. `residual_px` (m, 2) observed minus predicted; `chi2` and
    `freedom` of the whole adjustment, priors and distances included; `steps` taken;
    `converged` whether the last step was negligible.
    """

    network: Network
    covariance: np.ndarray
    residual_px: np.ndarray
    chi2: float
    freedom: int
    steps: int
    converged: bool

    @property
    def sigma0(self) -> float:
        """Square root of chi-squared per degree of freedom: 1 where the stated covariances are right."""
        return float(np.sqrt(self.chi2 / self.freedom)) if self.freedom > 0 else float("nan")


def adjust(network: Network, labels: list[str]) -> Adjustment:
    """Adjust a network from its starting values.

    Raises `TestfieldError` where the observations do not determine all unknowns, naming those that are loose.
    """
    chi2 = _chi2(network)
    damping, steps = 1e-4, 0
    system, converged = _System(network), False
    while steps < MOST_STEPS:
        steps += 1
        step, point_step = system.solve(damping, labels)
        trial = network.moved(step, point_step)
        trial_chi2 = _chi2(trial)
        if np.isfinite(trial_chi2) and trial_chi2 <= chi2 * (1 + 1e-14) + 1e-20:
            small = system.relative_size(step)
            gain, network, chi2 = chi2 - trial_chi2, trial, trial_chi2
            damping = damping / 10 if damping > 1e-12 else 0.0
            system = _System(network)
            if small < 1e-9 or (gain <= 1e-12 * chi2 and damping == 0 and small < 1e-5):
                converged = True
                break
        elif damping > 1e8 or system.relative_size(step) < 1e-9:
            converged = damping <= 1e8
            break
        else:
            damping = max(damping * 10, 1e-6)
    predicted, _ = network.project()
    freedom = 2 * len(network.xy_px) + len(network.length_mm) + network.scale_free - len(step)
    priors = int(np.isfinite(network.u_prior_mm[np.unique(network.point)]).sum())
    freedom += priors - 3 * (len(np.unique(network.point)) - len(network.kept_points))
    return Adjustment(network, system.covariance(labels), network.xy_px - predicted, chi2, freedom, steps, converged)


def _whitening(cov_px2: np.ndarray) -> np.ndarray:
    """(m, 2, 2) matrices W with W cov W^T = I."""
    return np.linalg.inv(np.linalg.cholesky(cov_px2))


def _prior_weight(network: Network) -> np.ndarray:
    """(n, 3) square roots of the priors' weights, 0 where nothing is known."""
    return 1 / np.maximum(network.u_prior_mm, EXACT_MM)


def _distances(network: Network) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Length residuals, directions (d, 3) from the second end to the first, and weights' square roots."""
    a, b = network.point_mm[network.ends[:, 0]], network.point_mm[network.ends[:, 1]]
    length = np.linalg.norm(a - b, axis=1)
    return (
        network.length_mm - length,
        (a - b) / length[:, None],
        1 / np.maximum(network.u_length_mm, EXACT_MM),
    )


def _chi2(network: Network) -> float:
    with np.errstate(all="ignore"):
        predicted, _ = network.project()
        white = np.einsum("nij,nj->ni", _whitening(network.cov_px2), network.xy_px - predicted)
        used = np.unique(network.point)
        prior = (_prior_weight(network) * (network.prior_mm - network.point_mm))[used]
        gap, _, weight = _distances(network)
        scale = (1 - network.scale) / network.u_scale if network.scale_free else 0.0
        return float((white**2).sum() + (prior**2).sum() + ((gap * weight) ** 2).sum() + scale**2)


class _System:
    """Normal equations of one linearisation, points still separate."""

    def __init__(self, network: Network):
        self.network = network
        m, n = len(network.xy_px), len(network.point_mm)
        stations, boards, free = len(network.stations), len(network.boards), np.flatnonzero(network.free)
        kept = network.kept_points
        self.size = len(free) + 6 * stations + 6 * (boards - 1) + network.scale_free + 3 * len(kept)

        predicted, j = network.project()
        white = _whitening(network.cov_px2)
        residual = np.einsum("nij,nj->ni", white, network.xy_px - predicted)
        by_camera = white @ j.camera_point
        by_datum = by_camera @ network.stations.R[network.station]
        board = network.point_board[network.point]
        on_board = board >= 0
        rotate = network.boards.R[np.maximum(board, 0)]
        by_point = np.where(on_board[:, None, None], network.scale * by_datum @ rotate, by_datum)

        # Columns of each observation's derivatives; a column that does not exist goes to one past the end.
        nowhere = self.size
        first_board = len(free) + 6 * stations
        first_kept = first_board + 6 * (boards - 1) + network.scale_free
        keep_index = np.full(n, -1)
        keep_index[kept] = np.arange(len(kept))
        in_kept = keep_index[network.point]
        blocks = [
            (white @ j.interior[:, :, free], np.broadcast_to(np.arange(len(free)), (m, len(free)))),
            (white @ j.rotation, len(free) + 6 * network.station[:, None] + np.arange(3)),
            (by_camera, len(free) + 6 * network.station[:, None] + 3 + np.arange(3)),
        ]
        column = np.where(board > 0, first_board + 6 * (board - 1), nowhere)[:, None]
        six = np.where(column < nowhere, column + np.arange(6), nowhere)
        blocks += [(by_datum @ network.lever_matrix(), six[:, :3]), (by_datum, six[:, 3:])]
        if network.scale_free:
            by_scale = np.einsum("nij,nj->ni", by_datum, network.lever() / network.scale)[:, :, None]
            blocks.append((by_scale, np.where(on_board, first_kept - 1, nowhere)[:, None]))
        three = np.where(in_kept >= 0, first_kept + 3 * in_kept, nowhere)[:, None]
        blocks.append((by_point, np.where(three < nowhere, three + np.arange(3), nowhere)))

        values = np.concatenate([block for block, _ in blocks], axis=2)
        columns = np.concatenate([index for _, index in blocks], axis=1)
        width = columns.shape[1]
        dense = csr_matrix(
            (values.ravel(), np.repeat(columns, 2, axis=0).ravel(), np.arange(0, 2 * m * width + 1, width)),
            shape=(2 * m, self.size + 1),
        )
        own = np.where((in_kept < 0)[:, None, None], by_point, 0.0)
        point_columns = np.repeat(3 * network.point[:, None] + np.arange(3), 2, axis=0)
        points = csr_matrix((own.ravel(), point_columns.ravel(), np.arange(0, 6 * m + 1, 3)), shape=(2 * m, 3 * n))

        flat = residual.ravel()
        self.normal = (dense.T @ dense).toarray()[:-1, :-1]
        self.right = (dense.T @ flat)[:-1]
        self.across = np.asarray((dense.T @ points).todense())[:-1]
        blocks3 = np.zeros((n, 3, 3))
        np.add.at(blocks3, network.point, np.swapaxes(own, 1, 2) @ own)
        point_right = (points.T @ flat).reshape(n, 3)

        weight = _prior_weight(network)
        separate = np.ones(n, bool)
        separate[kept] = False
        blocks3[:, [0, 1, 2], [0, 1, 2]] += np.where(separate[:, None], weight**2, 0.0)
        point_right += np.where(separate[:, None], weight**2 * (network.prior_mm - network.point_mm), 0.0)
        # Points nobody observed, and those kept in the reduced system, stay where they are.
        idle = ~separate | ~np.isin(np.arange(n), network.point)
        blocks3[idle] = np.eye(3)
        point_right[idle] = 0
        self.point_normal, self.point_right = blocks3, point_right

        for number, point in enumerate(kept):
            at = first_kept + 3 * number + np.arange(3)
            self.normal[at, at] += weight[point] ** 2
            self.right[at] += weight[point] ** 2 * (network.prior_mm - network.point_mm)[point]
        if network.scale_free:
            self.normal[first_kept - 1, first_kept - 1] += 1 / network.u_scale**2
            self.right[first_kept - 1] += (1 - network.scale) / network.u_scale**2
        gap, direction, sharp = _distances(network)
        for (a, b), d, g, w in zip(network.ends, direction, gap, sharp, strict=True):
            row = np.zeros(self.size)
            row[first_kept + 3 * keep_index[a] : first_kept + 3 * keep_index[a] + 3] = d * w
            row[first_kept + 3 * keep_index[b] : first_kept + 3 * keep_index[b] + 3] = -d * w
            self.normal += np.outer(row, row)
            self.right += row * g * w

    def _reduced(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        points = self.point_normal * (1 + damping * np.eye(3))
        try:
            inverse = np.linalg.inv(points)
        except np.linalg.LinAlgError as error:
            raise TestfieldError("a point is not determined by its observations", do="it needs two stations") from error
        n = len(points)
        weighted = np.einsum("pni,nij->pnj", self.across.reshape(self.size, n, 3), inverse).reshape(self.size, 3 * n)
        normal = self.normal + damping * np.diag(np.diag(self.normal)) - weighted @ self.across.T
        right = self.right - weighted @ self.point_right.ravel()
        return normal, right, inverse

    def solve(self, damping: float, labels: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """Step of the reduced unknowns (P,) and of the points (n, 3)."""
        normal, right, inverse = self._reduced(damping)
        step = _Factor(normal, labels).solve(right)
        point_right = self.point_right - (step @ self.across).reshape(-1, 3)
        return step, np.einsum("nij,nj->ni", inverse, point_right)

    def covariance(self, labels: list[str]) -> np.ndarray:
        """(P, P) inverse of the reduced normal matrix."""
        return _Factor(self._reduced(0.0)[0], labels).solve(np.eye(self.size))

    def relative_size(self, step: np.ndarray) -> float:
        """The largest step in units of what its unknown's own observations resolve."""
        return float(np.abs(step * np.sqrt(np.diag(self.normal))).max())


class _Factor:
    """Cholesky factor of a normal matrix at unit diagonal; a singular one is an error that names its unknowns."""

    def __init__(self, normal: np.ndarray, labels: list[str]):
        self.scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        unit = normal * self.scale[:, None] * self.scale[None, :]
        try:
            self.factor = cho_factor(unit)
        except np.linalg.LinAlgError as error:
            values, vectors = np.linalg.eigh(unit)
            weak = np.abs(vectors[:, values < 1e-12]).max(axis=1, initial=0)
            named = [labels[k] for k in np.argsort(-weak)[:6] if weak[k] > 0.1]
            raise TestfieldError(
                f"the observations do not determine {', '.join(named) or 'all unknowns'}",
                do="add stations with other directions and roll, or hold a lens parameter (measure.hold)",
            ) from error

    def solve(self, right: np.ndarray) -> np.ndarray:
        scale = self.scale if right.ndim == 1 else self.scale[:, None]
        return scale * cho_solve(self.factor, scale * right)
