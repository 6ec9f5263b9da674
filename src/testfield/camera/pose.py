"""Rotations and rigid motions in float64."""

from dataclasses import dataclass

import numpy as np


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """(..., 3) to (..., 3, 3) with `cross_matrix(a) @ b == np.cross(a, b)`."""
    answer = np.zeros((*v.shape, 3), np.result_type(v, float))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    answer[..., 0, 1], answer[..., 0, 2], answer[..., 1, 2] = -z, y, -x
    answer[..., 1, 0], answer[..., 2, 0], answer[..., 2, 1] = z, -y, x
    return answer


def rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues)."""
    vector = np.asarray(vector, float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    k = cross_matrix(vector)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    return np.eye(3) + a * k + b * (k @ k)


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) in radians of rotation matrices (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(matrix).as_rotvec()


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation (..., 3, 3) closest to a matrix in the Frobenius norm."""
    u, _, vt = np.linalg.svd(matrix)
    flip = np.ones(u.shape[:-1])
    flip[..., -1] = np.linalg.det(u @ vt)
    return (u * flip[..., None, :]) @ vt


@dataclass(frozen=True)
class Poses:
    """Rigid motions b-from-a: `x_b = R @ x_a + t_mm`. `R` (n, 3, 3), `t_mm` (n, 3)."""

    R: np.ndarray
    t_mm: np.ndarray

    def __len__(self) -> int:
        return len(self.R)

    def __getitem__(self, index: np.ndarray | slice) -> "Poses":
        return Poses(self.R[index], self.t_mm[index])

    def apply(self, xyz_mm: np.ndarray) -> np.ndarray:
        """Move point i by motion i: (n, 3) in, (n, 3) out."""
        return np.einsum("nij,nj->ni", self.R, xyz_mm) + self.t_mm

    def inverse(self) -> "Poses":
        """The motions back."""
        transposed = np.swapaxes(self.R, -1, -2)
        return Poses(transposed, -np.einsum("nij,nj->ni", transposed, self.t_mm))

    def after(self, first: "Poses") -> "Poses":
        """Motion i of `first`, then motion i of these."""
        return Poses(self.R @ first.R, np.einsum("nij,nj->ni", self.R, first.t_mm) + self.t_mm)

    @property
    def origin_mm(self) -> np.ndarray:
        """(n, 3) where the b frames' origins lie in a: the projection centres of camera-from-world poses."""
        return self.inverse().t_mm

    @staticmethod
    def identity(n: int) -> "Poses":
        """n motions that move nothing."""
        return Poses(np.broadcast_to(np.eye(3), (n, 3, 3)).copy(), np.zeros((n, 3)))

    @staticmethod
    def join(parts: list["Poses"]) -> "Poses":
        """All motions in order."""
        return Poses(np.concatenate([p.R for p in parts]), np.concatenate([p.t_mm for p in parts]))
