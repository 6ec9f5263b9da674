"""A reduced normal matrix solved, and inverted."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from testfield.errors import TestfieldError

SINGULAR = 1e-13
"""Smallest eigenvalue of a reduced normal matrix of unit diagonal that still determines its unknowns."""


class Factor:
    """Cholesky factor of a reduced normal matrix at unit diagonal, the directions that the datum leaves open (P, d)
    held still; a singular one is an error that names its unknowns."""

    def __init__(self, normal: np.ndarray, labels: list[str], open_ways: np.ndarray | None = None):
        own = np.diag(normal)
        self.scale = 1 / np.sqrt(np.where(own > 0, own, 1))  # nothing is known where the diagonal is not positive
        unit = normal * self.scale[:, None]
        unit *= self.scale
        if open_ways is not None and open_ways.shape[1]:
            basis = np.linalg.qr(open_ways / self.scale[:, None])[0]
            unit += basis @ basis.T
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

    def inverse(self) -> np.ndarray:
        """The inverse (P, P)."""
        if not len(self.scale):
            return np.zeros((0, 0))
        answer = mirrored(dpotri(self.factor[0], lower=self.factor[1])[0])
        answer *= self.scale[:, None]
        answer *= self.scale
        return np.ascontiguousarray(answer.T)  # symmetric: the same in the other order


def mirrored(upper: np.ndarray) -> np.ndarray:
    """A symmetric matrix of which only the upper triangle was made, completed in place."""
    step = 256
    for first in range(0, len(upper), step):
        here = slice(first, first + step)
        upper[here, :first] = upper[:first, here].T
        block = upper[here, here]
        upper[here, here] = np.triu(block) + np.triu(block, 1).T
    return upper
