"""What methods that know one board an image give: views of separate pose, chained to one frame with their covariance.

Opponents solve for a pose of every view, which is a board in an image. Their covariance is that of the bundle's normal
equations at their solution, with one standard deviation for all pixels, that of their residuals, as their users would
have it. The frame of the first board, and in it stations and boards, follow along the strongest spanning tree.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.network import HELD, Camera, Distances, Images, Network, information_of
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.edges import Edges
from testfield.calibrate.graph import groups_apart, spanning_tree
from testfield.calibrate.quality import board_quality, joints, residual_test
from testfield.calibrate.rejections import of_joints
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix
from testfield.detect.observations import Observations
from testfield.targets.field import Field

LEAST_VARIANCE_PX2 = 1e-18
"""Where observations fit perfectly, a variance must still be inverted."""
AXES = ("rx", "ry", "rz", "tx", "ty", "tz")


@dataclass(frozen=True)
class Cameras:
    """Interior orientations with their `names`, and `of_image` (I,) which of them took each image."""

    names: tuple[str, ...]
    interiors: tuple[Interior, ...]
    of_image: np.ndarray

    @staticmethod
    def one(interior: Interior, images: int) -> "Cameras":
        """One camera that took them all."""
        return Cameras((), (interior,), np.zeros(images, int))

    def several(self, images: list[int], residual_image: np.ndarray) -> dict[str, Any]:
        """What a calibration of these images (numbers) and of residuals in images `residual_image` (m,) has of several
        cameras; nothing of one."""
        if len(self.interiors) == 1:
            return {}
        return {
            "more_cameras": self.interiors[1:],
            "camera_names": self.names,
            "image_camera": self.of_image[images],
            "residual_camera": self.of_image[residual_image],
        }


@dataclass(frozen=True)
class Uncertain:
    """One pose `R` (3, 3), `t_mm` (3,), and how its small turn and shift (6, P) follow the unknowns."""

    R: np.ndarray
    t_mm: np.ndarray
    by: np.ndarray

    def after(self, first: "Uncertain") -> "Uncertain":
        """The motion `first`, then this one."""
        moved = self.R @ first.t_mm
        turn = self.by[:3] + self.R @ first.by[:3]
        shift = self.by[3:] - cross_matrix(moved) @ self.by[:3] + self.R @ first.by[3:]
        return Uncertain(self.R @ first.R, moved + self.t_mm, np.vstack([turn, shift]))

    def inverse(self) -> "Uncertain":
        """The motion back."""
        back = self.R.T
        turn = -back @ self.by[:3]
        shift = -back @ self.by[3:] - back @ cross_matrix(self.t_mm) @ self.by[:3]
        return Uncertain(back, -back @ self.t_mm, np.vstack([turn, shift]))


def evaluated(network: Network, labels: list[str], unknowns: int, datum_points: np.ndarray | None = None) -> Adjustment:
    """Covariances of a network where it is, all pixels with the standard deviation that its residuals have, whose
    freedom the method's `unknowns` lower."""
    squares = float(((network.xy_px - predict(network)) ** 2).sum())
    variance = max(squares / max(2 * len(network.xy_px) - unknowns, 1), LEAST_VARIANCE_PX2)
    alike = np.broadcast_to(variance * np.eye(2), network.cov_px2.shape).copy()
    return adjust(replace(network, cov_px2=alike), labels, datum_points=datum_points, most_steps=0)


def from_views(
    method: str,
    cameras: Cameras,
    free: np.ndarray | None,
    camera_from_board: Poses,
    edges: Edges,
    rows: Observations,
    field: Field,
    turned_down: list[dict],
    notes: list[str],
) -> Calibration:
    """The calibration of an interior orientation, whose parameters in the mask `free` were estimated, and of the
    camera-from-board poses (E) of edges. Without a mask the cameras are as they are given, and may be several."""
    interior = cameras.interiors[0]
    free = np.zeros(len(interior.parameters), bool) if free is None else free
    stations, boards = len(rows.stations), len(field.boards)
    first = min(groups_apart(edges.station, edges.board, stations, boards)[0][1])
    sheets = [sheet.marks for sheet in field.boards]
    start = np.concatenate([[0], np.cumsum([len(marks) for marks in sheets])])
    local = np.vstack([np.column_stack([marks.xy_mm, np.zeros(len(marks))]) for marks in sheets])
    used = np.concatenate(edges.rows)
    m = len(used)
    network = Network(
        cameras=(
            Camera.of(interior, free),
            *(Camera.of(one, np.zeros(len(one.parameters), bool)) for one in cameras.interiors[1:]),
        ),
        stations=camera_from_board,
        images=replace(Images.one_camera(len(edges)), camera=cameras.of_image[edges.station]),
        boards=Poses.identity(boards),
        ways=(HELD,) * boards,
        point_mm=local,
        point_board=np.repeat(np.arange(boards), np.diff(start)),
        known_mm=local,
        information=information_of(np.zeros_like(local)),
        image=np.repeat(np.arange(len(edges)), edges.marks),
        point=start[rows.board[used]] + rows.point[used],
        xy_px=rows.xy_px[used],
        cov_px2=np.tile(np.eye(2), (m, 1, 1)),
        offset_px=np.zeros((m, 2)),
        distances=Distances(),
        scale=1.0,
        u_scale=field.u_scale,
    )
    names = tuple(f"{rows.stations[s]}/{field.boards[b].name}" for s, b in zip(edges.station, edges.board, strict=True))
    all_boards = tuple(sheet.name for sheet in field.boards)
    labels = network.labels(names, all_boards)
    found = evaluated(network, labels, int(free.sum()) + 6 * len(edges))

    place = {label: k for k, label in enumerate(labels)}
    unit = np.eye(len(labels))
    views = {
        (int(s), int(b)): Uncertain(
            camera_from_board.R[e],
            camera_from_board.t_mm[e],
            unit[[place[f"station:{names[e]}.{axis}"] for axis in AXES]],
        )
        for e, (s, b) in enumerate(zip(edges.station, edges.board, strict=True))
    }
    order = [first, *(b for b in range(boards) if b != first)]
    turn = {b: k for k, b in enumerate(order)}
    board_at = {first: Uncertain(np.eye(3), np.zeros(3), np.zeros((6, len(labels))))}
    station_at: dict[int, Uncertain] = {}
    board = np.array([turn[b] for b in edges.board])
    for s, k, to_station in spanning_tree(edges.station, board, edges.weight, stations, boards):
        b = order[k]
        if to_station:
            station_at[s] = views[s, b].after(board_at[b].inverse())
        else:
            board_at[b] = station_at[s].inverse().after(views[s, b])
    inside = sorted(station_at)
    joined = [b for b in order if b in board_at]
    left = [f"'{field.boards[b].name}'" for b in order if b not in board_at]
    notes = notes + ([f"not joined to the others and left out: board {', '.join(left)}"] if left else [])

    own = [name for name, unknown in zip(interior.names, free, strict=True) if unknown]
    blocks = [unit[: len(own)], *(station_at[s].by for s in inside), *(board_at[b].by for b in joined[1:])]
    out = [*own, *(f"station:{rows.stations[s]}.{axis}" for s in inside for axis in AXES)]
    out += [f"board:{field.boards[b].name}.{axis}" for b in joined[1:] for axis in AXES]
    if network.scale_free:
        blocks.append(unit[[place["scale"]]])
        out.append("scale")
    change = np.vstack(blocks)
    covariance = change @ found.covariance @ change.T
    station_names = tuple(rows.stations[s] for s in inside)
    board_names = tuple(field.boards[b].name for b in joined)
    of_view = joints(found, names, all_boards)
    edge_rows = tuple(
        {**joint, "station": name[: -len(joint["board"]) - 1]}
        for joint, name in zip(of_view, (j["station"] for j in of_view), strict=True)
    )
    white = found.residual_px
    calibration = Calibration(
        method=method,
        interior=interior,
        station_names=station_names,
        stations=_poses([station_at[s] for s in inside]),
        board_names=board_names,
        boards=_poses([board_at[b] for b in joined]),
        scale=1.0,
        covariance=covariance,
        labels=tuple(out),
        sigma0=found.sigma0,
        freedom=found.freedom,
        reprojection_rms_px=float(np.sqrt((white**2).sum(axis=1).mean())),
        used=m,
        rejected=tuple(turned_down),
        residual_at_px=rows.xy_px[used],
        residual_px=white,
        graph=tuple((e["station"], e["board"], e["marks"]) for e in edge_rows),
        notes=tuple([*notes, OWN_WORD]),
        joints=edge_rows,
        board_quality=board_quality(covariance, tuple(out), board_names, edge_rows),
        test=residual_test(found),
        **cameras.several(inside, rows.station[used]),
    )
    return of_joints(calibration)


OWN_WORD = (
    "the covariance is that of this project's normal equations at the method's own solution, every pixel with the "
    "standard deviation of its residuals"
)


def _poses(found: list[Uncertain]) -> Poses:
    return Poses(np.array([p.R for p in found]), np.array([p.t_mm for p in found]))
