"""Generalised least squares: image noise and the calibration's covariance, cameras correlated (METHODS section 1.6).

For one target seen by k stations the residuals have S = blockdiag(Sigma_u) + G Sigma_theta G^T, with G the derivative
of its pixels by everything the calibration estimated. The same G carries the calibration's error from point to point.
"""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.normals import target_normal
from testfield.calibrate.calibration import Calibration
from testfield.camera.circle import disc_image
from testfield.camera.pose import Poses
from testfield.camera.project import ProjectionJacobian, project, project_with_jacobian
from testfield.camera.rays import meet
from testfield.detect.observations import Observations
from testfield.reconstruct.points import Points
from testfield.registry import register
from testfield.targets.field import Field

PASSES = 6
REJECT_SIGMA = 6.0


@register("reconstructors", "gls")
def gls(observations: Observations, calibration: Calibration, field: Field) -> Points:
    """Generalised least squares: weights from image noise and from the calibration, cameras correlated."""
    return reconstruct(observations, calibration, field, "gls")


@dataclass(frozen=True)
class _Solved:
    xyz: np.ndarray
    own: np.ndarray  # (3, 3) covariance from image noise
    by_calibration: np.ndarray  # (3, P) derivative of the point by the calibration's unknowns
    residual: np.ndarray
    rays: int
    rejected: int


def reconstruct(observations: Observations, calibration: Calibration, field: Field, method: str) -> Points:
    """The loop over targets that all linear methods share; `method` is `gls` or `midpoint`."""
    rows = observations.measured
    place = {name: k for k, name in enumerate(calibration.station_names)}
    station = np.array([place.get(name, -1) for name in rows.stations])[rows.station]
    codes, solved = [], []
    for code in sorted(field.loose):
        here = np.flatnonzero((rows.code == code) & (rows.board < 0) & (station >= 0))
        if len(here) < 2:
            continue
        answer = _solve(rows.take(here), station[here], calibration, field.loose[code] / 2, method)
        if answer is not None:
            codes.append(code)
            solved.append(answer)
    n = len(codes)
    A = np.concatenate([s.by_calibration for s in solved]) if n else np.zeros((0, len(calibration.labels)))
    covariance = A @ calibration.covariance @ A.T
    for k, s in enumerate(solved):
        covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += s.own
    return Points(
        method, np.array(codes, int), np.array([s.xyz for s in solved]).reshape(n, 3), covariance,
        np.array([s.rays for s in solved], int), np.array([np.sqrt((s.residual**2).sum(1).mean()) for s in solved]),
        np.array([s.rejected for s in solved], int),
    )  # fmt: skip


def _solve(
    rows: Observations, station: np.ndarray, calibration: Calibration, radius_mm: float, method: str
) -> _Solved | None:
    rejected = 0
    while len(rows) >= 2:
        answer, worst, size = _estimate(rows, station, calibration, radius_mm, method, rejected)
        if size < REJECT_SIGMA:
            return answer
        if len(rows) == 2:  # two rays that disagree: neither can be told to be the wrong one
            return None
        keep = np.arange(len(rows)) != worst
        rows, station, rejected = rows.take(keep), station[keep], rejected + 1
    return None


def _estimate(
    rows: Observations,
    station: np.ndarray,
    calibration: Calibration,
    radius_mm: float,
    method: str,
    rejected: int,
) -> tuple[_Solved, int, float]:
    """The point, and its worst ray with the size of that ray's residual in standard deviations."""
    interior, poses = calibration.interior, calibration.stations[station]
    k = len(rows)
    x = meet(interior, poses, rows.xy_px)
    offset = np.zeros((k, 2))
    gain = np.zeros((3, 2 * k))
    noise = np.zeros((2 * k, 2 * k))
    for i in range(k):
        noise[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = rows.cov_px2[i]
    for _ in range(PASSES):
        at = np.broadcast_to(x, (k, 3))
        if rows.centre_of_disc:
            normal = target_normal(interior, poses, x, radius_mm, rows.moments_px2)
            image = disc_image(interior, poses, at, np.broadcast_to(normal, (k, 3)), np.full(k, radius_mm))
            offset = image.centroid_px - project(interior, poses, at)
        uv, jacobian = project_with_jacobian(interior, poses, at)
        residual = rows.xy_px - uv - offset
        J = (jacobian.camera_point @ poses.R).reshape(2 * k, 3)
        G = _by_calibration(jacobian, station, calibration)
        S = noise + G @ calibration.covariance @ G.T
        if method == "gls":
            weighted = np.linalg.solve(S, J).T
            gain = np.linalg.solve(weighted @ J, weighted)
        else:
            gain = _midpoint_gain(jacobian.camera_point @ poses.R, poses, x)
        step = gain @ residual.ravel()
        x = x + step
        if np.abs(step).max() < 1e-10:
            break
    leftover = (residual.ravel() - J @ step).reshape(k, 2)
    sizes = [
        float(np.sqrt(r @ np.linalg.solve(S[2 * i : 2 * i + 2, 2 * i : 2 * i + 2], r))) for i, r in enumerate(leftover)
    ]
    worst = int(np.argmax(sizes))
    return _Solved(x, gain @ noise @ gain.T, -gain @ G, leftover, k, rejected), worst, sizes[worst]


def _midpoint_gain(J: np.ndarray, poses: Poses, x: np.ndarray) -> np.ndarray:
    """(3, 2k) how the point nearest to all rays follows their pixels.

    A pixel's error moves its ray, at the point, by the pseudo-inverse of J, which is square to the ray; the point
    follows with the inverse of the sum of the rays' projectors (METHODS sections 1.2 and 1.4).
    """
    d = x - poses.origin_mm
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    projectors = np.eye(3) - d[:, :, None] * d[:, None, :]
    moves = np.linalg.pinv(J)
    return np.linalg.solve(projectors.sum(axis=0), np.concatenate(list(moves), axis=1))


def _by_calibration(jacobian: ProjectionJacobian, station: np.ndarray, calibration: Calibration) -> np.ndarray:
    """(2k, P) derivative of the pixels by the calibration's unknowns."""
    k = len(station)
    G = np.zeros((k, 2, len(calibration.labels)))
    names = [name for name in calibration.interior.names if name in calibration.labels]
    chosen = [calibration.interior.names.index(name) for name in names]
    G[:, :, calibration.index(names)] = jacobian.interior[:, :, chosen]
    for i, s in enumerate(station):
        columns = calibration.index(calibration.station_unknowns(int(s)))
        G[i][:, columns] = np.concatenate([jacobian.rotation[i], jacobian.camera_point[i]], axis=1)
    return G.reshape(2 * k, -1)
