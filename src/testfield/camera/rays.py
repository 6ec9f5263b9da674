"""Where rays meet: the starting values of every reconstruction."""

from collections.abc import Sequence

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import directions
from testfield.camera.several import by_camera
from testfield.errors import TestfieldError


def meet(interior: Interior, poses: Poses, xy_px: np.ndarray) -> np.ndarray:
    """The point (3,) nearest to k rays in the sense of least squares (METHODS section 1.2).

    `poses` (k) camera-from-datum, `xy_px` (k, 2). Raises `TestfieldError` for a pixel the lens cannot reach.
    """
    return meet_rays(directions(interior, xy_px), poses, xy_px)


def meet_rays(rays: np.ndarray, poses: Poses, xy_px: np.ndarray) -> np.ndarray:
    """The point (3,) nearest to k rays of directions (k, 3) in their cameras, as `meet`; `xy_px` names them."""
    d = np.einsum("nji,nj->ni", poses.R, rays)
    if not np.isfinite(d).all():
        x, y = xy_px[int(np.argmin(np.isfinite(d).all(axis=1)))]
        raise TestfieldError(f"the pixel ({x:.1f}, {y:.1f}) lies outside the lens' domain", do="drop the observation")
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    projector = np.eye(3) - d[:, :, None] * d[:, None, :]
    return np.linalg.solve(projector.sum(axis=0), np.einsum("nij,nj->i", projector, poses.origin_mm))


def meet_all(
    interiors: Sequence[Interior],
    camera: np.ndarray,
    poses: Poses,
    station: np.ndarray,
    there: np.ndarray,
    xy_px: np.ndarray,
) -> np.ndarray:
    """Points (n, 3), each nearest to up to k rays: `station` (n, k) of their `poses`, `there` (n, k) which are rays,
    `xy_px` (n, k, 2), and `camera` (n, k) which of `interiors` imaged them. A pixel that its lens cannot reach gives no
    ray."""
    rays = by_camera(directions, interiors, camera.ravel(), xy_px.reshape(-1, 2)).reshape(*station.shape, 3)
    d = np.einsum("nkji,nkj->nki", poses.R[station], rays)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    good = there & np.isfinite(d).all(axis=-1)
    projector = np.where(good[..., None, None], np.eye(3) - d[..., :, None] * d[..., None, :], 0)
    right = np.einsum("nkij,nkj->ni", projector, poses.origin_mm[station])
    return np.linalg.solve(projector.sum(axis=1), right[..., None])[..., 0]
