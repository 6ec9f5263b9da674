"""What the bundle adjusts: unknowns with their starting values, and everything that was observed."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation, rotation_vector

EXACT_MM = 1e-6
"""A coordinate or a length that is said to be exact is held with this standard deviation."""
EXACT_RAD = 1e-9
"""The same of a turn."""
FREE = np.eye(6)
HELD = np.zeros((6, 0))
"""Ways a pose may move: columns (6, k) of small turns (rad) after its rotation, then shifts (mm)."""


@dataclass(frozen=True)
class Camera:
    """An interior orientation as an unknown: `known` (p,) is what was known before with standard deviations `u` (p,):
    0 holds a parameter, infinity leaves it free, anything between is a prior. `u_aspect` is the standard deviation
    with which fy / fx is known to be 1."""

    interior: Interior
    u: np.ndarray
    known: np.ndarray
    u_aspect: float = np.inf

    @staticmethod
    def of(interior: Interior, free: np.ndarray | None = None) -> "Camera":
        """A camera of which the parameters in the mask `free` (p,) are unknown (all of them, if not given)."""
        mask = np.ones(len(interior.parameters), bool) if free is None else free
        return Camera(interior, np.where(mask, np.inf, 0.0), interior.parameters)

    @property
    def unknown(self) -> np.ndarray:
        """(p,) which parameters are adjusted."""
        return self.u > 0

    @property
    def aspect(self) -> np.ndarray:
        """(p,) what the parameters are multiplied with to give fy / fx - 1 in its standard deviations."""
        row = np.zeros(len(self.u))
        row[:2] = np.array([-1, 1]) / (self.u_aspect * self.known[0])
        return row


@dataclass(frozen=True)
class Images:
    """I images: each was taken at station `station` (I,) by camera `camera` (I,), which is member `member` (I,) of a
    rig (0 for a camera that is alone)."""

    station: np.ndarray
    camera: np.ndarray
    member: np.ndarray

    @staticmethod
    def one_camera(stations: int) -> "Images":
        """One image a station, all by camera 0."""
        return Images(np.arange(stations), np.zeros(stations, int), np.zeros(stations, int))


@dataclass(frozen=True)
class Distances:
    """d distances between points `ends` (d, 2), of `length_mm` (d,) with standard deviations `u_mm` (d,)."""

    ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))
    length_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    u_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.ends)


@dataclass(frozen=True)
class KnownBoards:
    """What was known of board poses before: `poses` (B) datum-from-board, and `u` (B, 6) the standard deviations of
    their small turns in rad and shifts in mm; infinite ones tell nothing."""

    poses: Poses
    u: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """(B, 6) inverse variances."""
        return 1 / np.maximum(self.u, [EXACT_RAD] * 3 + [EXACT_MM] * 3) ** 2

    def deviation(self, boards: Poses) -> np.ndarray:
        """(B, 6) known minus present: turns, then shifts."""
        turn = rotation_vector(self.poses.R @ np.swapaxes(boards.R, 1, 2))
        return np.concatenate([turn, self.poses.t_mm - boards.t_mm], axis=1)


@dataclass(frozen=True)
class Network:
    """Unknowns and observations of one adjustment.

    Unknowns: `cameras`; station-from-datum poses `stations` (S); `members` (R), camera-from-station poses of a rig's
    cameras, of which member 0 is the station itself; datum-from-board poses `boards` (B), which move in their `ways`;
    one `scale` of all boards with prior 1 +- `u_scale` (0: held); `point_mm` (n, 3) in the frame of board
    `point_board` (n,), or in the datum frame where that is -1. `known_mm` (n, 3) with `information` (n, 3, 3), an
    inverse covariance, is what was known of them before; zeros: nothing. `known_boards` the same of the boards' poses,
    `known_members` of the members' (of all but the first).

    Observations: `xy_px` (m, 2) with `cov_px2` (m, 2, 2) of point `point` (m,) in image `image` (m,) of `images`;
    `offset_px` (m, 2) is what the image of a disc adds to the projection of its centre. `distances`.
    """

    cameras: tuple[Camera, ...]
    stations: Poses
    images: Images
    boards: Poses
    ways: tuple[np.ndarray, ...]
    point_mm: np.ndarray
    point_board: np.ndarray
    known_mm: np.ndarray
    information: np.ndarray
    image: np.ndarray
    point: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    offset_px: np.ndarray
    distances: Distances = Distances()
    scale: float = 1.0
    u_scale: float = 0.0
    members: Poses = field(default_factory=lambda: Poses.identity(1))
    known_boards: KnownBoards | None = None
    known_members: KnownBoards | None = None

    @property
    def interiors(self) -> tuple[Interior, ...]:
        """The cameras' interior orientations."""
        return tuple(camera.interior for camera in self.cameras)

    @property
    def camera(self) -> np.ndarray:
        """(m,) the camera of each image observation."""
        return self.images.camera[self.image]

    @property
    def interior(self) -> Interior:
        """The first camera's interior orientation: the only one of most jobs."""
        return self.cameras[0].interior

    @cached_property
    def kept_points(self) -> np.ndarray:
        """Points that distances tie together; they stay in the reduced system."""
        return np.unique(self.distances.ends)

    @cached_property
    def seen_points(self) -> np.ndarray:
        """Points that appear in an image."""
        return np.flatnonzero(self.is_seen)

    @cached_property
    def is_seen(self) -> np.ndarray:
        """(n,) whether a point appears in an image."""
        return np.bincount(self.point, minlength=len(self.point_mm)) > 0

    @property
    def scale_free(self) -> bool:
        """Whether the boards' common scale is an unknown."""
        return self.u_scale > 0

    def camera_from_datum(self) -> Poses:
        """Poses (I) of all images."""
        at_station = self.stations[self.images.station]
        if len(self.members) == 1:
            return at_station
        return self.members[self.images.member].after(at_station)

    def datum_mm(self, points: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Positions (k, 3) of points in the datum frame."""
        local, board = self.point_mm[points], self.point_board[points]
        if not len(self.boards):
            return local
        moved = self.boards[np.maximum(board, 0)].apply(self.scale * local)
        return np.where((board >= 0)[:, None], moved, local)

    def normals(self) -> np.ndarray:
        """(n, 3) normals in the datum frame of the boards that carry the points; NaN for loose points."""
        z = self.boards.R[np.maximum(self.point_board, 0)][:, :, 2]
        return np.where((self.point_board >= 0)[:, None], z, np.nan)

    def take(self, rows: np.ndarray) -> "Network":
        """The network with only these image observations."""
        return replace(
            self,
            image=self.image[rows],
            point=self.point[rows],
            xy_px=self.xy_px[rows],
            cov_px2=self.cov_px2[rows],
            offset_px=self.offset_px[rows],
        )

    def moved(self, step: np.ndarray, point_step: np.ndarray) -> "Network":
        """The network after a step (P,) of the reduced unknowns and (n, 3) of the points that are not among them."""
        at = Layout.of(self)
        cameras = []
        for k, camera in enumerate(self.cameras):
            parameters = camera.interior.parameters.copy()
            parameters[camera.unknown] += step[at.camera[k] : at.camera[k + 1]]
            cameras.append(replace(camera, interior=camera.interior.with_parameters(parameters)))
        free = [ways @ step[at.board[b] : at.board[b + 1]] for b, ways in enumerate(self.ways)]
        members = np.vstack([np.zeros((1, 6)), step[at.member : at.board[0]].reshape(-1, 6)])
        points = self.point_mm + point_step
        points[self.kept_points] += step[at.kept :].reshape(-1, 3)
        return replace(
            self,
            cameras=tuple(cameras),
            stations=_turned(self.stations, step[at.station : at.member].reshape(-1, 6)),
            members=_turned(self.members, members),
            boards=_turned(self.boards, np.array(free).reshape(-1, 6)),
            scale=self.scale + float(step[at.scale]) if self.scale_free else self.scale,
            point_mm=points,
        )

    def labels(
        self,
        station_names: tuple[str, ...],
        board_names: tuple[str, ...] = (),
        camera_names: tuple[str, ...] = (),
        point_names: tuple[str, ...] | None = None,
        member_names: tuple[str, ...] = (),
    ) -> list[str]:
        """A name for each unknown of the reduced system, in its order; those of several cameras begin with theirs."""
        axes = ("rx", "ry", "rz", "tx", "ty", "tz")
        named = []
        for k, camera in enumerate(self.cameras):
            prefix = f"camera:{camera_names[k] if camera_names else k}." if len(self.cameras) > 1 else ""
            own = zip(camera.interior.names, camera.unknown, strict=True)
            named += [prefix + name for name, unknown in own if unknown]
        named += [f"station:{s}.{axis}" for s in station_names for axis in axes]
        members = member_names or tuple(map(str, range(1, len(self.members))))
        named += [f"member:{name}.{axis}" for name in members for axis in axes]
        for b, ways in zip(board_names, self.ways, strict=True):
            named += [f"board:{b}.{_way(axes, way, k)}" for k, way in enumerate(ways.T)]
        named += ["scale"] if self.scale_free else []
        names = point_names or tuple(f"point{k}" for k in range(len(self.point_mm)))
        return named + [f"{names[k]}.{axis}" for k in self.kept_points for axis in "xyz"]


@dataclass(frozen=True)
class Layout:
    """Where the reduced system's unknowns begin: each camera's (K + 1,), the stations', the rig members', each board's
    (B + 1,), the scale, the kept points'; and how many there are."""

    camera: np.ndarray
    station: int
    member: int
    board: np.ndarray
    scale: int
    kept: int
    size: int

    @staticmethod
    def of(network: Network) -> "Layout":
        """The layout of a network."""
        camera = np.cumsum([0, *(int(c.unknown.sum()) for c in network.cameras)])
        station = int(camera[-1])
        member = station + 6 * len(network.stations)
        first_board = member + 6 * (len(network.members) - 1)
        board = first_board + np.cumsum([0, *(ways.shape[1] for ways in network.ways)])
        scale = int(board[-1])
        kept = scale + network.scale_free
        return Layout(camera, station, member, board, scale, kept, kept + 3 * len(network.kept_points))


def information_of(u_mm: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inverse covariances of coordinates with standard deviations (n, 3): infinite ones tell nothing, and
    those of zero are held."""
    return (1 / np.maximum(u_mm, EXACT_MM) ** 2)[:, :, None] * np.eye(3)


def _turned(poses: Poses, step: np.ndarray) -> Poses:
    if not step.any():
        return poses
    return Poses(rotation(step[:, :3]) @ poses.R, poses.t_mm + step[:, 3:])


def _way(axes: tuple[str, ...], way: np.ndarray, k: int) -> str:
    """The axis a way moves along, or its number where it is none of them alone."""
    return axes[int(np.argmax(np.abs(way)))] if np.count_nonzero(np.abs(way) > 1e-12) == 1 else f"way{k}"
