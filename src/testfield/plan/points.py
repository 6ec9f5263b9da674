"""How well loose targets will be known: their pixels' noise, and the calibration that all of them share.

The sandwich of METHODS section 1.6 at noise-free rays: with v = B dx + A dtheta + noise, a gain G gives dx = G v, whose
covariance is G D G^T + (G A) C (G A)^T. The gain is that of generalised least squares (the reconstructor `gls`), of a
bundle of points and cameras (`bundle`), or of the pixels' weights alone (all others).
"""

from dataclasses import dataclass

import numpy as np

from testfield.camera.pose import Poses, cross_matrix
from testfield.camera.project import camera_jacobian

MOST_FLOPS = 3e11
"""Of generalised least squares: above it points are weighed by their pixels, and the difference is sampled."""
SAMPLE = 48
"""Points in which both weights are compared then."""
CHUNK_NUMBERS = 4_000_000


@dataclass(frozen=True)
class Rays:
    """m rays to n points, sorted by point: `first` (n + 1,) where each point's begin; whitened derivatives `by_point`
    (m, 2, 3) and `by_shared` (m, 2, w) by the unknowns at `columns` (m, w) of the calibration's covariance."""

    first: np.ndarray
    by_point: np.ndarray
    by_shared: np.ndarray
    columns: np.ndarray

    @property
    def count(self) -> np.ndarray:
        """(n,) rays of each point."""
        return np.diff(self.first)


@dataclass(frozen=True)
class PointCovariance:
    """Of n points: `own` (n, 3, 3) from pixels, `by_shared` (3n, P) how they follow the shared unknowns, whose
    covariance is `shared` (P, P). `weights` says by which gain."""

    own: np.ndarray
    by_shared: np.ndarray
    shared: np.ndarray
    weights: str

    def __len__(self) -> int:
        return len(self.own)

    def blocks(self) -> np.ndarray:
        """(n, 3, 3) covariance of each point by itself, in mm^2."""
        n = len(self)
        half = (self.by_shared @ self.shared).reshape(n, 3, self.by_shared.shape[1])
        return np.asarray(self.own + half @ np.swapaxes(self._wide, 1, 2))

    def take(self, points: np.ndarray) -> "PointCovariance":
        """The same of some points."""
        wide = self._wide[points]
        own = wide.reshape(3 * len(wide), self.by_shared.shape[1])
        return PointCovariance(self.own[points], own, self.shared, self.weights)

    @property
    def _wide(self) -> np.ndarray:
        return self.by_shared.reshape(len(self), 3, self.by_shared.shape[1])

    def joint(self, points: np.ndarray) -> np.ndarray:
        """(3k, 3k) joint covariance of some points."""
        points = np.asarray(points, int)
        rows = (3 * points[:, None] + np.arange(3)).ravel()
        own = self.by_shared[rows]
        answer = own @ self.shared @ own.T
        k = len(points)
        answer.reshape(k, 3, k, 3)[np.arange(k), :, np.arange(k)] += self.own[points]
        return np.asarray(answer)

    def u_lengths_mm(self, ends: np.ndarray, xyz_mm: np.ndarray) -> np.ndarray:
        """(d,) standard uncertainties of the distances between points `ends` (d, 2) at `xyz_mm` (n, 3)."""
        if not len(ends):
            return np.zeros(0)
        a, b = ends.T
        direction = xyz_mm[a] - xyz_mm[b]
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        wide = self._wide
        follows = np.einsum("di,dip->dp", direction, wide[a] - wide[b])
        shared = np.einsum("dp,dp->d", follows @ self.shared, follows)
        own = np.einsum("di,dij,dj->d", direction, self.own[a] + self.own[b], direction)
        return np.sqrt(shared + own)

    def rms_after(self, basis: np.ndarray) -> float:
        """Root mean square uncertainty per coordinate after motions `basis` (3n, r) were fitted to all points."""
        n, K = len(self), self.by_shared
        normal = np.linalg.inv(basis.T @ basis)
        wide = basis.reshape(n, 3, -1)
        own = np.einsum("nii->", self.own) - np.trace(normal @ np.einsum("nir,nij,njs->rs", wide, self.own, wide))
        cross = K.T @ basis
        shared = np.einsum("pq,pq->", self.shared, K.T @ K - cross @ normal @ cross.T)
        return float(np.sqrt(max(own + shared, 0) / (3 * n)))


def rays_of(
    xyz_mm: np.ndarray,
    point: np.ndarray,
    image: np.ndarray,
    cov_px2: np.ndarray,
    poses: Poses,
    camera: np.ndarray,
    interiors: tuple,
    interior_at: list[tuple[np.ndarray, np.ndarray]],
    image_at: np.ndarray,
) -> Rays:
    """Rays of points (n, 3) by observations of `point` (m,) in `image` (m,) with `cov_px2` (m, 2, 2).

    `poses` (I), `camera` (I,) of the images; `interior_at` of each camera which parameters are unknown and where they
    stand in the covariance, `image_at` (I,) where an image's six unknowns begin. All points have rays.
    """
    order = np.argsort(point, kind="stable")
    point, image, cov_px2 = point[order], image[order], cov_px2[order]
    turned = np.einsum("nij,nj->ni", poses.R[image], xyz_mm[point])
    at_camera = turned + poses.t_mm[image]
    p = max(len(chosen) for chosen, _ in interior_at)
    m = len(point)
    by_place = np.empty((m, 2, 3))
    by_shared, columns = np.zeros((m, 2, p + 6)), np.zeros((m, p + 6), int)
    for k, interior in enumerate(interiors):
        here = np.flatnonzero(camera[image] == k)
        _, by_interior, by_place[here] = camera_jacobian(interior, at_camera[here])
        chosen, at = interior_at[k]
        by_shared[here, :, : len(chosen)] = by_interior[:, :, chosen]
        columns[here, : len(chosen)] = at
    by_shared[:, :, p : p + 3] = -by_place @ cross_matrix(turned)
    by_shared[:, :, p + 3 :] = by_place
    columns[:, p:] = image_at[image][:, None] + np.arange(6)
    white = np.linalg.inv(np.linalg.cholesky(cov_px2))
    first = np.concatenate([[0], np.cumsum(np.bincount(point, minlength=len(xyz_mm)))])
    return Rays(first, white @ (by_place @ poses.R[image]), white @ by_shared, columns)


def by_pixels(rays: Rays, shared: np.ndarray) -> PointCovariance:
    """Points weighed by their pixels alone."""
    B, A, n = rays.by_point, rays.by_shared, len(rays.count)
    normal = np.add.reduceat(np.swapaxes(B, 1, 2) @ B, rays.first[:-1])
    own = np.linalg.inv(normal)
    point = np.repeat(np.arange(n), rays.count)
    share = -own[point] @ (np.swapaxes(B, 1, 2) @ A)
    K = np.zeros((n, 3, len(shared)))
    for axis in range(3):
        at = (point[:, None] * len(shared) + rays.columns).ravel()
        K[:, axis] = np.bincount(at, share[:, axis].ravel(), n * len(shared)).reshape(n, -1)
    return PointCovariance(own, K.reshape(3 * n, -1), shared, "pixels")


def by_all(rays: Rays, shared: np.ndarray) -> PointCovariance:
    """Points by generalised least squares: weights from pixels and from the calibration, cameras correlated."""
    n, P = len(rays.count), len(shared)
    used = np.unique(rays.columns)
    place = np.full(P, -1)
    place[used] = np.arange(len(used))
    half = _root(shared[np.ix_(used, used)])
    own, K = np.empty((n, 3, 3)), np.zeros((n, 3, P))
    for k in np.unique(rays.count):
        points = np.flatnonzero(rays.count == k)
        size = max(1, int(CHUNK_NUMBERS // (2 * k * (len(used) + 2 * k))))
        for begin in range(0, len(points), size):
            some = points[begin : begin + size]
            row = rays.first[some][:, None] + np.arange(k)
            A, B, columns = rays.by_shared[row], rays.by_point[row], rays.columns[row]
            Z = _followed(A.reshape(-1, *A.shape[2:]), columns.reshape(-1, columns.shape[2]), half, place)
            Z = Z.reshape(len(some), 2 * k, -1)
            S = Z @ np.swapaxes(Z, 1, 2)
            S[:, np.arange(2 * k), np.arange(2 * k)] += 1
            flat = B.reshape(len(some), 2 * k, 3)
            weighed = np.linalg.solve(S, flat)
            normal = np.linalg.inv(np.swapaxes(weighed, 1, 2) @ flat)
            gain = normal @ np.swapaxes(weighed, 1, 2)
            own[some] = gain @ np.swapaxes(gain, 1, 2)
            split = gain.reshape(len(some), 3, k, 2)
            follows = -np.einsum("sikl,sklj->sikj", split, A)
            at = (np.arange(len(some))[:, None, None] * P + columns).ravel()
            for axis in range(3):
                part = np.bincount(at, follows[:, axis].ravel(), len(some) * P)
                K[some, axis] = part.reshape(len(some), P)
    return PointCovariance(own, K.reshape(3 * n, -1), shared, "pixels and calibration")


def _followed(A: np.ndarray, columns: np.ndarray, half: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(m, 2, r) rows A (m, 2, w) at `columns` (m, w) times a matrix whose rows stand at `place`: all rays of one image
    share their columns, so that each image is one product."""
    image = columns[:, -1]
    order = np.argsort(image, kind="stable")
    answer = np.empty((len(A), 2, half.shape[1]))
    for rows in np.split(order, np.flatnonzero(np.diff(image[order])) + 1):
        here = half[place[columns[rows[0]]]]
        answer[rows] = (A[rows].reshape(-1, A.shape[2]) @ here).reshape(len(rows), 2, -1)
    return answer


def flops_of(rays: Rays, shared: np.ndarray) -> float:
    """Multiplications and additions that `by_all` needs, about."""
    two = 2.0 * rays.count
    used = len(np.unique(rays.columns))
    width = rays.by_shared.shape[-1]
    return float((2 * two**2 * used + 2 / 3 * two**3 + 4 * two * used * width).sum())


def information_of_points(rays: Rays, size: int) -> np.ndarray:
    """(P, P) what the rays of all points tell of the shared unknowns, the points eliminated."""
    B, A = rays.by_point, rays.by_shared
    answer = np.zeros((size, size))
    for k in np.unique(rays.count):
        points = np.flatnonzero(rays.count == k)
        step = max(1, int(CHUNK_NUMBERS // (2 * k * size)))
        for begin in range(0, len(points), step):
            some = points[begin : begin + step]
            row = rays.first[some][:, None] + np.arange(k)
            J = B[row].reshape(len(some), 2 * k, 3)
            G = np.zeros((len(some), k, size, 2))
            which = np.arange(len(some))[:, None], np.arange(k)
            for j in range(A.shape[-1]):  # a camera with fewer unknowns than another is padded with zeros
                G[(*which, rays.columns[row, j])] += A[row, :, j]
            G = np.swapaxes(G, 2, 3)
            basis = np.linalg.qr(J)[0]
            G = G.reshape(len(some), 2 * k, size)
            left = (G - basis @ (np.swapaxes(basis, 1, 2) @ G)).reshape(-1, size)
            answer += left.T @ left
    return answer


def _root(covariance: np.ndarray) -> np.ndarray:
    """(q, r) with covariance = root root^T, whatever its rank."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0))
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / unit / unit[:, None])
    good = values > 1e-14 * max(float(values[-1]), 0.0)
    return np.asarray(unit[:, None] * vectors[:, good] * np.sqrt(values[good]))
