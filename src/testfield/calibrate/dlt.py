"""The direct linear transformation (Abdel-Aziz and Karara 1971) on points that are known in space."""

from dataclasses import replace

import numpy as np
from scipy.linalg import rq

from testfield.adjust.bundle import adjust
from testfield.adjust.groups import Structure
from testfield.adjust.linear import linearise, whitening_of
from testfield.adjust.network import HELD, Camera, Distances, Images, Network, information_of
from testfield.adjust.normal import NormalEquations
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.edges import left_out
from testfield.calibrate.quality import board_quality, joints, residual_test
from testfield.calibrate.rejections import of_joints
from testfield.calibrate.rows import usable_rows
from testfield.calibrate.start import starting_network
from testfield.calibrate.views import AXES, LEAST_VARIANCE_PX2, evaluated
from testfield.camera.interior import Interior
from testfield.camera.lens import lens_model
from testfield.camera.pose import Poses
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field

LEAST_POINTS = 8
FLAT = 1e-3
"""A field whose thickness is less than this part of its width has too little depth for eleven parameters."""


@register("calibrators", "dlt")
def dlt(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """Eleven parameters an image, linear in the pixels; their camera matrices' mean is the camera, a pinhole.

    The points are the marks of all boards in the frame of the first, so the field sheet must certify the boards' poses.
    Each image's eleven parameters are taken apart into a camera matrix and a pose; with the mean camera the poses are
    resected again. The coefficients of `lens` stay those of a pinhole. Raises `TestfieldError` where the sheet gives no
    poses, and where no image sees points that are not in one plane.
    """
    if not any(sheet.pose is not None for sheet in field.boards[1:]):
        raise TestfieldError(
            "the field sheet certifies the pose of no board, and 'dlt' needs points that are known in space",
            "field.json, boards",
            "give each board a pose, in a scene by [certified_poses], or use 'stitched'",
        )
    rows, turned_down, notes = usable_rows(observations, field)
    sheet = replace(
        field, boards=tuple(b for k, b in enumerate(field.boards) if k == 0 or b.pose is not None), scale_bars=()
    )
    rows = _renumbered(rows, field, sheet)
    start = starting_network(rows, sheet, width_px, height_px, lens, (), least_stations=1, given=True)
    turned_down, notes = turned_down + left_out(rows, sheet, start.why), notes + start.notes
    rigid = _rigid(start.network)
    cameras, solved = [], []
    for i in range(len(start.stations)):
        here = np.flatnonzero(rigid.image == i)
        xyz = rigid.datum_mm(rigid.point[here])
        depth = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
        if len(here) < LEAST_POINTS or depth[2] < FLAT * depth[0]:
            notes.append(f"station '{start.stations[i]}' sees points of one plane only, which 'dlt' cannot use")
            continue
        K, R, t = eleven_parameters(xyz, rigid.xy_px[here])
        cameras.append(K)
        solved.append((i, R, t))
    if not solved:
        raise TestfieldError(
            "no image sees boards of different planes, which eleven parameters need",
            do="add stations that see several boards",
        )
    which = np.array([i for i, _, _ in solved])
    K = np.mean(cameras, axis=0)
    pinhole = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *lens_model(lens).pinhole])
    interior = Interior(width_px, height_px, pinhole, lens)
    u_camera = _scatter_of_mean(rigid, cameras, solved)

    chosen = rigid.take(np.isin(rigid.image, which))
    number = np.full(len(start.stations), -1)
    number[which] = np.arange(len(which))
    poses = Poses(np.array([R for _, R, _ in solved]), np.array([t for _, _, t in solved]))
    free = np.arange(len(interior.names)) < 4
    chosen = replace(
        chosen,
        cameras=(Camera.of(interior, np.zeros(len(free), bool)),),
        stations=poses,
        images=Images.one_camera(len(which)),
        image=number[chosen.image],
    )
    stations = tuple(start.stations[i] for i in which)
    labels = chosen.labels(stations, start.boards)
    resected = adjust(chosen, labels).network
    resected = replace(resected, cameras=(Camera.of(interior, free),))
    found = evaluated(resected, resected.labels(stations, start.boards), 4 + 6 * len(which))
    covariance, names = _covariance(found.network, u_camera, stations, start.boards, sheet)
    edges = joints(found, stations, start.boards)
    notes.append(
        "the camera is a pinhole, the mean of the images' own, with the covariance of their eleven parameters; "
        "the stations' has its part and the pixels'; what is unknown of boards, and the discs' eccentricity, is in none"
    )
    calibration = Calibration(
        method="dlt",
        interior=interior,
        station_names=stations,
        stations=found.network.stations,
        board_names=start.boards,
        boards=found.network.boards,
        scale=1.0,
        covariance=covariance,
        labels=names,
        sigma0=found.sigma0,
        freedom=found.freedom,
        reprojection_rms_px=float(np.sqrt((found.residual_px**2).sum(axis=1).mean())),
        used=len(resected.xy_px),
        rejected=tuple(turned_down),
        residual_at_px=resected.xy_px,
        residual_px=found.residual_px,
        graph=tuple((e["station"], e["board"], e["marks"]) for e in edges),
        notes=tuple(notes),
        joints=edges,
        board_quality=board_quality(covariance, names, start.boards, edges),
        test=residual_test(found),
    )
    return of_joints(calibration)


def eleven_parameters(xyz_mm: np.ndarray, xy_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Camera matrix (3, 3) with its shear, rotation and translation from points (n, 3) seen at pixels (n, 2)."""
    to_xyz, to_xy = _normalising(xyz_mm), _normalising(xy_px)
    X = np.column_stack([xyz_mm, np.ones(len(xyz_mm))]) @ to_xyz.T
    x = np.column_stack([xy_px, np.ones(len(xy_px))]) @ to_xy.T
    none = np.zeros_like(X)
    rows = np.vstack([np.hstack([X, none, -x[:, [0]] * X]), np.hstack([none, X, -x[:, [1]] * X])])
    P = np.linalg.inv(to_xy) @ np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4) @ to_xyz
    P = P if np.linalg.det(P[:, :3]) > 0 else -P
    K, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    return K / K[2, 2], R, np.linalg.solve(K, P[:, 3])


def _normalising(values: np.ndarray) -> np.ndarray:
    """The similarity that gives points (n, d) mean zero and unit size (Hartley 1997)."""
    d = values.shape[1]
    mean = values.mean(axis=0)
    size = np.sqrt(((values - mean) ** 2).sum(axis=1).mean() / d)
    answer = np.eye(d + 1) / size
    answer[:d, d], answer[d, d] = -mean / size, 1.0
    return answer


def _renumbered(rows: Observations, field: Field, sheet: Field) -> Observations:
    """The observations with board numbers of a sheet that lists some of the boards; what is on others goes."""
    names = [board.name for board in sheet.boards]
    place = np.array([names.index(board.name) if board.name in names else -1 for board in field.boards])
    board = np.where(rows.board >= 0, place[np.maximum(rows.board, 0)], -1)
    return replace(rows, board=board).take(board >= 0)


def _rigid(network: Network) -> Network:
    """The network with boards as the sheet has them: shape, pose and size exact, all pixels alike."""
    known = network.known_boards
    assert known is not None
    return replace(
        network,
        boards=known.poses,
        ways=(HELD,) * len(network.boards),
        known_boards=None,
        u_scale=0.0,
        information=information_of(np.zeros_like(network.known_mm)),
        distances=Distances(),
        cov_px2=np.broadcast_to(np.eye(2), network.cov_px2.shape).copy(),
    )


def _scatter_of_mean(
    rigid: Network, cameras: list[np.ndarray], solved: list[tuple[int, np.ndarray, np.ndarray]]
) -> np.ndarray:
    """(4, 4) covariance of the mean camera: of each image's own, all its eleven parameters being unknown."""
    total = np.zeros((4, 4))
    size = rigid.interior
    for K, (i, R, t) in zip(cameras, solved, strict=True):
        here = rigid.take(rigid.image == i)
        values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], 0, 0, 0, 0, 0, K[0, 1] / K[0, 0]])
        own = Interior(size.width_px, size.height_px, values, "brown_shear")
        free = np.array([name in ("fx", "fy", "cx", "cy", "shear") for name in own.names])
        network = replace(
            here,
            cameras=(Camera.of(own, free),),
            stations=Poses(R[None], t[None]),
            images=Images.one_camera(1),
            image=np.zeros(len(here.image), int),
        )
        names = network.labels(("own",), tuple(str(b) for b in range(len(network.boards))))
        total += evaluated(network, names, 11).covariance[:4, :4]
    return total / len(solved) ** 2


def _covariance(
    network: Network, u_camera: np.ndarray, stations: tuple[str, ...], boards: tuple[str, ...], sheet: Field
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Covariance of camera, stations, boards and scale: the camera's own, the stations' with what pixels and camera
    leave unknown, the boards' and the scale's from the sheet."""
    structure = Structure.of(network)
    variance = whitening_of(network.cov_px2)
    normal = NormalEquations(network, structure, linearise(network, structure, variance)).normal
    s = 6 * len(stations)
    pose = np.linalg.inv(normal[4:, 4:])
    follow = -pose @ normal[4:, :4]
    poses = {board.name: board.pose for board in sheet.boards}
    certified = [poses[name] for name in boards[1:]]
    u_boards = [v for p in certified if p for v in [p.u_turn_rad] * 3 + [p.u_mm] * 3]
    least = np.sqrt(LEAST_VARIANCE_PX2)
    scale = [sheet.u_scale] if sheet.u_scale else []
    size = 4 + s + len(u_boards) + len(scale)
    answer = np.zeros((size, size))
    answer[:4, :4] = u_camera
    answer[4 : 4 + s, :4] = follow @ u_camera
    answer[:4, 4 : 4 + s] = answer[4 : 4 + s, :4].T
    answer[4 : 4 + s, 4 : 4 + s] = pose + follow @ u_camera @ follow.T
    at = 4 + s + np.arange(len(u_boards))
    answer[at, at] = np.maximum(u_boards, least) ** 2
    answer[-1, -1] = sheet.u_scale**2 if scale else answer[-1, -1]
    names = [*network.interior.names[:4], *(f"station:{n}.{a}" for n in stations for a in AXES)]
    names += [f"board:{n}.{a}" for n in boards[1:] for a in AXES] + (["scale"] if scale else [])
    return answer, tuple(names)
