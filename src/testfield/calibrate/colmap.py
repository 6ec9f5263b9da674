"""COLMAP's bundle adjustment (Ceres), by way of pycolmap, as an opponent."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testfield.adjust.network import Camera, Distances, Network
from testfield.calibrate.as_colmap import as_reconstruction, free_bundle
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.edges import left_out
from testfield.calibrate.quality import board_quality, joints, residual_test
from testfield.calibrate.rejections import of_joints
from testfield.calibrate.rows import usable_rows
from testfield.calibrate.start import Start, starting_network
from testfield.calibrate.views import AXES, OWN_WORD, evaluated
from testfield.camera.interior import PINHOLE
from testfield.camera.lens import lens_model, lens_names
from testfield.camera.pose import Poses, cross_matrix, nearest_rotation
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field

LEAST_POINTS = 4


@register("calibrators", "colmap")
def colmap(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """COLMAP's bundle from the start of `stitched`: marks are loose points, for it knows no boards.

    Frame and scale are those of a similarity that lays the points of the first board upon its sheet; the other boards
    are laid upon theirs rigidly. All pixels count alike and centres of discs as projections of centres. COLMAP's brown
    lens has no k3, its rational one no thin prism. Raises `TestfieldError` where pycolmap is not installed.
    """
    try:
        import pycolmap
    except ImportError as error:
        raise TestfieldError("pycolmap is not installed", do="pip install 'testfield[peers]'") from error
    called = lens_model(lens).in_colmap
    if called is None:
        others = [name for name in lens_names() if lens_model(name).in_colmap]
        raise TestfieldError(f"COLMAP has no lens '{lens}'", "measure.lens", f"choose one of {', '.join(others)}")
    rows, turned_down, notes = usable_rows(observations, field)
    start = starting_network(rows, replace(field, scale_bars=()), width_px, height_px, lens, hold)
    turned_down += left_out(rows, field, start.why)
    own = (*PINHOLE, *called.coefficients)
    missing = [name for name in start.network.interior.names if name not in (*own, *hold)]
    notes += start.notes + ([f"COLMAP's camera has no {', '.join(missing)}: held at zero"] if missing else [])
    strange = [name for name in hold if name in own]
    notes += [f"COLMAP cannot hold {', '.join(strange)}: estimated"] if strange else []

    loose, owner = _loose(start)
    solved = _on_first_board(_solved(pycolmap, loose, called.name, own), start, owner)
    free = np.array([name in own for name in loose.interior.names])
    solved = replace(solved, cameras=(Camera.of(solved.interior, free),))
    labels = solved.labels(start.stations)
    datum = np.flatnonzero(owner[0] == 0)
    n = len(solved.point_mm)
    found = evaluated(solved, labels, int(free.sum()) + 6 * len(start.stations) + 3 * n - 7, datum)
    boards, covariance, names = _with_boards(found, labels, start, owner, field.u_scale)
    seen = replace(found.network, point_board=owner[0])
    edges = joints(replace(found, network=seen), start.stations, start.boards)
    calibration = Calibration(
        method="colmap",
        interior=solved.interior,
        station_names=start.stations,
        stations=found.network.stations,
        board_names=start.boards,
        boards=boards,
        scale=1.0,
        covariance=covariance,
        labels=names,
        sigma0=found.sigma0,
        freedom=found.freedom,
        reprojection_rms_px=float(np.sqrt((found.residual_px**2).sum(axis=1).mean())),
        used=len(solved.xy_px),
        rejected=tuple(turned_down),
        residual_at_px=solved.xy_px,
        residual_px=found.residual_px,
        graph=tuple((e["station"], e["board"], e["marks"]) for e in edges),
        notes=tuple([*notes, OWN_WORD]),
        joints=edges,
        board_quality=board_quality(covariance, names, start.boards, edges),
        test=residual_test(found),
    )
    return of_joints(calibration)


def _loose(start: Start) -> tuple[Network, tuple[np.ndarray, np.ndarray]]:
    """The marks that two images or more show as loose points, and of each its board and its place there (n, 3)."""
    network = start.network
    count = np.bincount(network.point, minlength=len(network.point_mm))
    kept = np.flatnonzero((count >= 2) & (network.point_board >= 0))
    place = np.full(len(count), -1)
    place[kept] = np.arange(len(kept))
    chosen = network.take(place[network.point] >= 0)
    xyz = network.datum_mm(kept)
    loose = replace(
        chosen,
        boards=Poses.identity(0),
        ways=(),
        point_mm=xyz,
        known_mm=xyz,
        point=place[chosen.point],
        point_board=np.full(len(kept), -1),
        information=np.zeros((len(kept), 3, 3)),
        distances=Distances(),
        u_scale=0.0,
        known_boards=None,
    )
    return loose, (network.point_board[kept], network.point_mm[kept])


def _solved(pycolmap: Any, network: Network, model_name: str, own: Sequence[str]) -> Network:
    """The network at Ceres' minimum."""
    interior, count = network.interior, len(network.stations)
    model, numbers = as_reconstruction(pycolmap, network, model_name, own)
    tight = dict.fromkeys(("function_tolerance", "gradient_tolerance", "parameter_tolerance"), 1e-14)
    free_bundle(pycolmap, model, count, max_num_iterations=300, **tight).solve()

    parameters = np.zeros(len(interior.names))
    parameters[[interior.names.index(name) for name in own]] = model.camera(1).params
    matrices = np.array([model.image(k + 1).cam_from_world().matrix() for k in range(count)])
    points = np.array([model.point3D(number).xyz for number in numbers])
    cameras = (Camera.of(interior.with_parameters(parameters)),)
    return replace(network, cameras=cameras, stations=Poses(matrices[:, :, :3], matrices[:, :, 3]), point_mm=points)


def _on_first_board(network: Network, start: Start, owner: tuple[np.ndarray, np.ndarray]) -> Network:
    """The network moved and scaled as one so that the first board's points lie on its sheet."""
    here = owner[0] == 0
    if here.sum() < LEAST_POINTS:
        raise TestfieldError(
            f"fewer than {LEAST_POINTS} marks of board '{start.boards[0]}' are seen twice", do="add stations"
        )
    R, t, scale = _laid(network.point_mm[here], owner[1][here], with_scale=True)
    centre = scale * network.stations.origin_mm @ R.T + t
    turned = network.stations.R @ R.T
    return replace(
        network,
        stations=Poses(turned, -np.einsum("nij,nj->ni", turned, centre)),
        point_mm=scale * network.point_mm @ R.T + t,
    )


def _laid(from_mm: np.ndarray, onto_mm: np.ndarray, with_scale: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
    """R, t and scale that lay points (n, 3) upon others in the sense of least squares."""
    a, b = from_mm - from_mm.mean(axis=0), onto_mm - onto_mm.mean(axis=0)
    R = nearest_rotation(b.T @ a)
    scale = float((b * (a @ R.T)).sum() / (a**2).sum()) if with_scale else 1.0
    return R, onto_mm.mean(axis=0) - scale * R @ from_mm.mean(axis=0), scale


def _with_boards(
    found: Any, labels: list[str], start: Start, owner: tuple[np.ndarray, np.ndarray], u_scale: float
) -> tuple[Poses, np.ndarray, tuple[str, ...]]:
    """Poses of the boards laid on their points, and the covariance of camera, stations, boards and scale together."""
    network = found.network
    boards = Poses.identity(len(start.boards))
    count, n = len(labels), len(network.point_mm)
    rows, names = [], list(labels)
    for b in range(1, len(start.boards)):
        here = np.flatnonzero(owner[0] == b)
        if len(here) < LEAST_POINTS:
            raise TestfieldError(
                f"fewer than {LEAST_POINTS} marks of board '{start.boards[b]}' are seen twice", do="add stations"
            )
        R, t, _ = _laid(owner[1][here], network.point_mm[here])
        boards.R[b], boards.t_mm[b] = R, t
        lever = owner[1][here] @ R.T
        A = np.concatenate([-cross_matrix(lever), np.broadcast_to(np.eye(3), (len(here), 3, 3))], axis=2)
        fit = np.linalg.pinv(A.reshape(-1, 6))
        row = np.zeros((6, n, 3))
        row[:, here] = fit.reshape(6, len(here), 3)
        rows.append(row.reshape(6, 3 * n))
        names += [f"board:{start.boards[b]}.{axis}" for axis in AXES]
    by_points = np.vstack([np.zeros((count, 3 * n)), *rows])
    by_reduced = np.vstack([np.eye(count), np.zeros((len(by_points) - count, count))])
    covariance = found.cov.joint(by_reduced, np.arange(n), by_points)
    if u_scale:
        move = np.zeros(len(covariance) + 1)
        for k, name in enumerate(names):
            kind, _, axis = name.rpartition(".")
            if axis in ("tx", "ty", "tz"):
                poses, all_names = (network.stations, start.stations) if kind[0] == "s" else (boards, start.boards)
                move[k] = poses.t_mm[all_names.index(kind.partition(":")[2]), "xyz".index(axis[1])]
        move[-1] = 1.0
        covariance = np.pad(covariance, (0, 1)) + u_scale**2 * np.outer(move, move)
        names.append("scale")
    return boards, covariance, tuple(names)
