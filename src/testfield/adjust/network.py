"""What the bundle adjusts: unknowns with their starting values, and everything that was observed."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix, rotation
from testfield.camera.project import ProjectionJacobian, project_with_jacobian

EXACT_MM = 1e-6
"""A coordinate or a length that is said to be exact is held with this standard deviation."""


@dataclass(frozen=True)
class Network:
    """Unknowns and observations of one adjustment, in the frame of board 0, which is the datum.

    Unknowns: `interior` where `free` says so; camera-from-datum poses `stations` (S); datum-from-board poses
    `boards` (B), the first held at identity; one `scale` of all boards with prior 1 +- `u_scale` (0: held);
    `point_mm` (n, 3) in the frame of board `point_board` (n,), or in the datum frame where that is -1, with prior
    `prior_mm` and standard deviations `u_prior_mm` (n, 3), infinite where nothing is known.

    Observations: `xy_px` (m, 2) with `cov_px2` (m, 2, 2) of point `point` (m,) in station `station` (m,);
    `offset_px` (m, 2) is what the image of a disc adds to the projection of its centre. Distances between points
    `ends` (d, 2), which lie in the datum frame, of `length_mm` (d,) with `u_length_mm` (d,).
    """

    interior: Interior
    free: np.ndarray
    stations: Poses
    boards: Poses
    scale: float
    u_scale: float
    point_mm: np.ndarray
    point_board: np.ndarray
    prior_mm: np.ndarray
    u_prior_mm: np.ndarray
    station: np.ndarray
    point: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    offset_px: np.ndarray
    ends: np.ndarray
    length_mm: np.ndarray
    u_length_mm: np.ndarray

    @property
    def kept_points(self) -> np.ndarray:
        """Points that distances tie together; they stay in the reduced system."""
        return np.unique(self.ends)

    @property
    def scale_free(self) -> bool:
        """Whether the boards' common scale is an unknown."""
        return self.u_scale > 0

    def labels(self, station_names: tuple[str, ...], board_names: tuple[str, ...]) -> list[str]:
        """A name for each unknown of the reduced system, in its order."""
        axes = ("rx", "ry", "rz", "tx", "ty", "tz")
        named = [name for name, free in zip(self.interior.names, self.free, strict=True) if free]
        named += [f"station:{s}.{axis}" for s in station_names for axis in axes]
        named += [f"board:{b}.{axis}" for b in board_names[1:] for axis in axes]
        named += ["scale"] if self.scale_free else []
        return named + [f"point{k}.{axis}" for k in self.kept_points for axis in "xyz"]

    def datum_mm(self, points: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Positions (k, 3) of points in the datum frame."""
        local, board = self.point_mm[points], self.point_board[points]
        moved = self.boards[np.maximum(board, 0)].apply(self.scale * local)
        return np.where((board >= 0)[:, None], moved, local)

    def normals(self) -> np.ndarray:
        """(n, 3) normals in the datum frame of the boards that carry the points; NaN for loose points."""
        z = self.boards.R[np.maximum(self.point_board, 0)][:, :, 2]
        return np.where((self.point_board >= 0)[:, None], z, np.nan)

    def moved(self, step: np.ndarray, point_step: np.ndarray) -> "Network":
        """The network after a step (P,) of the reduced unknowns and (n, 3) of the points that are not among them."""
        s, b, f = len(self.stations), len(self.boards), int(self.free.sum())
        parameters = self.interior.parameters.copy()
        parameters[self.free] += step[:f]
        at = f
        stations = _turned(self.stations, step[at : at + 6 * s].reshape(s, 6))
        at += 6 * s
        boards = _turned(self.boards, np.vstack([np.zeros((1, 6)), step[at : at + 6 * (b - 1)].reshape(b - 1, 6)]))
        at += 6 * (b - 1)
        scale = self.scale
        if self.scale_free:
            scale += step[at]
            at += 1
        points = self.point_mm + point_step
        points[self.kept_points] += step[at:].reshape(-1, 3)
        return replace(
            self, interior=self.interior.with_parameters(parameters), stations=stations, boards=boards,
            scale=float(scale), point_mm=points,
        )  # fmt: skip

    def take(self, rows: np.ndarray) -> "Network":
        """The network with only these image observations."""
        return replace(
            self, station=self.station[rows], point=self.point[rows], xy_px=self.xy_px[rows],
            cov_px2=self.cov_px2[rows], offset_px=self.offset_px[rows],
        )  # fmt: skip

    def project(self) -> tuple[np.ndarray, ProjectionJacobian]:
        """Predicted pixels (m, 2) of all image observations, with the projection's derivatives."""
        uv, jacobian = project_with_jacobian(self.interior, self.stations[self.station], self.datum_mm()[self.point])
        return uv + self.offset_px, jacobian

    def lever(self) -> np.ndarray:
        """(m, 3) board-rotated, scaled point of each observation: what a turn of its board acts on."""
        board = np.maximum(self.point_board[self.point], 0)
        return self.scale * np.einsum("nij,nj->ni", self.boards.R[board], self.point_mm[self.point])

    def lever_matrix(self) -> np.ndarray:
        """(m, 3, 3) derivative of each observation's datum point by a turn of its board."""
        return -cross_matrix(self.lever())


def _turned(poses: Poses, step: np.ndarray) -> Poses:
    return Poses(rotation(step[:, :3]) @ poses.R, poses.t_mm + step[:, 3:])
