"""The cheap depth of Monte Carlo: pixels and calibration drawn from their covariances, the points met again.

All points of thousands of trials at once: the estimating equation gain x residuals = 0 is solved by steps of the gain
itself, which needs projections only. Projections are exact in every trial; what stays as it was at the estimate are
the weights, the rays that take part, and what a disc's image adds to its centre's projection.
"""

from dataclasses import dataclass

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera import lens
from testfield.camera.pose import rotation
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.bundle import information_of_cameras, posterior_of
from testfield.reconstruct.estimate import Estimate, Solved, Trials, estimate_of, settle, solve, to_meet
from testfield.reconstruct.sights import sights_of
from testfield.registry import known_of
from testfield.seeds import Plane
from testfield.targets.field import Field

STEPS = 4
MOST_AT_ONCE = 2_000_000
"""Projections held in memory at once."""


@dataclass(frozen=True)
class RayTrials:
    """Points ready to be met again: `solved` of those that are met, and the `estimate` of all (n); `root` (P, P) of the
    calibration's covariance; `afterwards` (3n, 2mk) what residuals of all points move them by in one more step, where
    the method has one."""

    solved: Solved
    estimate: Estimate
    calibration: Calibration
    root: np.ndarray
    afterwards: np.ndarray | None

    @property
    def code(self) -> np.ndarray:
        """(n,) codes of the points."""
        return self.estimate.code

    @property
    def xyz_mm(self) -> np.ndarray:
        """(n, 3) positions at the estimate."""
        if self.afterwards is None:
            return self.estimate.xyz_mm
        return self.estimate.xyz_mm + (self.afterwards @ self.solved.rays.residual_px.ravel()).reshape(-1, 3)

    @staticmethod
    def of(observations: Observations, calibration: Calibration, field: Field, method: str) -> "RayTrials":
        """Raises `TestfieldError` where the method did not tell how trials are met again."""
        again: Trials | None = known_of("reconstructors", method, "trials")
        if again is None:
            raise TestfieldError(
                f"the points of '{method}' cannot be met again all at once",
                "measure.reconstructor",
                "use --depth calibration, which takes any method as it is",
            )
        sights = sights_of(observations, calibration, field)
        sound = settle(to_meet(sights, calibration), calibration, again.screened_by or again.method)
        solved = solve(sound.sights, calibration, again.method)
        estimate = estimate_of(solved, sights, calibration)
        afterwards = _change_of_cameras(solved, estimate, calibration) if again.moves_cameras else None
        values, vectors = np.linalg.eigh(calibration.covariance)
        return RayTrials(solved, estimate, calibration, vectors * np.sqrt(np.maximum(values, 0)), afterwards)

    def draw(self, trials: range, seed: int) -> np.ndarray:
        """(T, n, 3) positions of the trials with these numbers, the same in whatever blocks they are asked for."""
        n, k = self.solved.sights.there.shape
        most = max(1, MOST_AT_ONCE // max(n * k, 1))
        parts = [self._draw(trials[first : first + most], seed) for first in range(0, len(trials), most)]
        return np.concatenate(parts)

    def _draw(self, trials: range, seed: int) -> np.ndarray:
        solved, sights = self.solved, self.solved.sights
        T, (n, k) = len(trials), sights.there.shape
        z = Plane(seed, "pixels").normals(trials, 2 * n * k).reshape(T, n, k, 2)
        noise = np.einsum("nkij,tnkj->tnki", np.linalg.cholesky(sights.cov_px2), z, optimize=True)
        off = Plane(seed, "calibration").normals(trials, len(self.root)) @ self.root.T
        interiors, R, t = self._cameras(off)
        # Measured where the points were predicted, off by the residual that the estimate leaves.
        start = solved.xyz_mm
        same = np.broadcast_to(start, (1, n, 3))
        predicted = self._project(*self._cameras(np.zeros((1, len(self.root)))), same)
        measured = np.where(sights.there[..., None], predicted + solved.rays.residual_px + noise, 0)
        xyz = np.broadcast_to(start, (T, n, 3)).copy()
        gain = solved.gain
        for step in range(STEPS + 1):
            residual = measured - np.where(sights.there[..., None], self._project(interiors, R, t, xyz), 0)
            if step < STEPS:
                flat = residual.reshape(T, n, 2 * k).transpose(1, 2, 0)
                # At the estimate the gain's residual is zero but for what the method's own lines leave.
                xyz += (gain @ flat).transpose(2, 0, 1) - self._rest
        # What the calibration adjusted itself moves as it was drawn.
        everything = np.empty((T, len(self.code), 3))
        met = np.isin(self.code, sights.code)
        everything[:, met] = xyz
        taken = self.calibration.point_unknowns(self.code[~met])
        everything[:, ~met] = self.estimate.xyz_mm[~met] + off[:, taken].reshape(T, -1, 3)
        if self.afterwards is not None:
            everything += (residual.reshape(T, -1) @ self.afterwards.T).reshape(everything.shape)
        return everything

    @property
    def _rest(self) -> np.ndarray:
        """(n, 3) gain x residuals at the estimate: zero for reprojection, of second order for lines."""
        n, k = self.solved.sights.there.shape
        return np.einsum("nij,nj->ni", self.solved.gain, self.solved.rays.residual_px.reshape(n, 2 * k))

    def _cameras(self, off: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
        """Interiors (T, p) of all cameras, rotations (T, S, 3, 3) and translations (T, S, 3) of the images, of
        deviations (T, P) of the unknowns."""
        calibration, T = self.calibration, len(off)
        interiors = []
        for k, camera in enumerate(calibration.interiors):
            interior, own = np.tile(camera.parameters, (T, 1)), calibration.interior_unknowns(k)
            names = [name for name in own if name in calibration.labels]
            interior[:, [own.index(name) for name in names]] += off[:, calibration.index(names)]
            interiors.append(interior)
        stations = calibration.stations
        unknowns = np.array([calibration.index(calibration.station_unknowns(s)) for s in range(len(stations))])
        six = off[:, unknowns]
        return interiors, rotation(six[..., :3]) @ stations.R, stations.t_mm + six[..., 3:]

    def _project(self, interiors: list[np.ndarray], R: np.ndarray, t: np.ndarray, xyz: np.ndarray) -> np.ndarray:
        """(T, n, k, 2) pixels."""
        station = self.solved.sights.station
        camera = np.empty((len(xyz), *station.shape, 3))
        for s in range(R.shape[1]):  # gathering a rotation for every ray would cost more than the projection
            point, slot = np.nonzero(station == s)
            camera[:, point, slot] = xyz[:, point] @ np.swapaxes(R[:, s], 1, 2) + t[:, s, None]
        plane = camera[..., :2] / camera[..., 2:]
        uv = self._imaged(0, interiors[0], plane)
        by = self.calibration.camera_of_image[station]
        for k in range(1, len(interiors)):
            uv = np.where((by == k)[..., None], self._imaged(k, interiors[k], plane), uv)
        return uv

    def _imaged(self, number: int, interior: np.ndarray, plane: np.ndarray) -> np.ndarray:
        """(T, n, k, 2) pixels of places on the plane before the lens, all by the camera of this number."""
        camera_at = self.calibration.interiors[number]
        own = 4 + len(camera_at.coefficients)
        bent = lens.distort(camera_at.lens, plane, interior[:, 4:own].T[:, :, None, None])
        uv = bent * interior[:, None, None, :2] + interior[:, None, None, 2:4]
        if camera_at.modes:
            for at, amounts in zip(uv, interior[:, own:], strict=True):
                at += (camera_at.by_modes(at.reshape(-1, 2)) @ amounts).reshape(at.shape)
        return uv


def _change_of_cameras(solved: Solved, estimate: Estimate, calibration: Calibration) -> np.ndarray:
    """(3n, 2mk) by what residuals of all points move the points, through what they tell of the cameras."""
    n, k = solved.sights.there.shape
    information, _ = information_of_cameras(solved)
    whitening = np.where(
        solved.sights.there[..., None, None], np.linalg.inv(np.linalg.cholesky(solved.sights.cov_px2)), 0
    )
    J = (whitening @ solved.rays.by_point).reshape(n, 2 * k, 3)
    G = (whitening @ solved.rays.by_calibration).reshape(n, 2 * k, -1)
    basis = np.linalg.qr(J)[0]
    left = (G - basis @ (np.swapaxes(basis, 1, 2) @ G)).reshape(n, k, 2, -1)
    right = np.einsum("nkip,nkij->pnkj", left, whitening).reshape(-1, 2 * n * k)
    return estimate.by_calibration @ (posterior_of(calibration.covariance, information) @ right)
