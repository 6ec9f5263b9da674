"""The linear result: coordinates and lengths with standard uncertainties, from the points' joint covariance."""

from dataclasses import dataclass

import numpy as np

from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points


@dataclass(frozen=True)
class Lengths:
    """Lengths between points: `names`, and `ends` (L, 2), places of both ends among the points."""

    names: tuple[str, ...]
    ends: np.ndarray

    @staticmethod
    def between(points: Points, pairs: dict[str, tuple[int, int]]) -> "Lengths":
        """Lengths by name between pairs of codes. Raises `TestfieldError` for a code that was not reconstructed."""
        known = {int(code) for code in points.code}
        for name, pair in pairs.items():
            for code in pair:
                if code not in known:
                    raise TestfieldError(
                        f"target {code} of length '{name}' was not reconstructed",
                        "points.parquet",
                        "choose two of its codes",
                    )
        ends = np.array([points.rows(list(pair)) for pair in pairs.values()], int).reshape(-1, 2)
        return Lengths(tuple(pairs), ends)

    def of(self, xyz_mm: np.ndarray) -> np.ndarray:
        """(..., L) lengths of positions (..., n, 3)."""
        return np.linalg.norm(xyz_mm[..., self.ends[:, 0], :] - xyz_mm[..., self.ends[:, 1], :], axis=-1)


@dataclass(frozen=True)
class Linear:
    """q quantities by `names`: all coordinates of the points in order, then lengths. `value_mm`, `u_mm` (q,)."""

    names: tuple[str, ...]
    value_mm: np.ndarray
    u_mm: np.ndarray
    lengths: Lengths

    def of(self, xyz_mm: np.ndarray) -> np.ndarray:
        """(T, q) the quantities of T sets of positions (T, n, 3)."""
        return np.concatenate([xyz_mm.reshape(len(xyz_mm), -1), self.lengths.of(xyz_mm)], axis=1)


def linear(points: Points, lengths: Lengths) -> Linear:
    """The law of propagation for all coordinates and lengths (METHODS section 1.6)."""
    of_lengths = [points.distance(int(a), int(b)) for a, b in lengths.ends]
    names = tuple(f"{code}.{axis}" for code in points.code for axis in "xyz") + lengths.names
    value = np.concatenate([points.xyz_mm.ravel(), [length for length, _ in of_lengths]])
    u = np.concatenate([np.sqrt(np.diag(points.cov_xyz_mm2)), [u for _, u in of_lengths]])
    return Linear(names, value, u, lengths)
