"""The calibrated camera and boards against the true ones."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix, nearest_rotation, rotation, rotation_vector
from testfield.camera.project import camera_jacobian, directions, project_camera
from testfield.scene.world import World
from testfield.statistics.consistency import chi_squared, nees

GRID = (13, 11)
KNOWN = 1e-9
"""Variances below this part of the larger one at a place are zero: the covariance says nothing along that axis."""
TURNS = 3
"""Steps in which the rotation is found that two cameras may differ by."""


def interior_difference(true: Interior, found: Interior, uv_px: np.ndarray) -> np.ndarray:
    """(n, 2) px by which the found camera images the true camera's rays elsewhere.

    A small rotation of the camera and a shift of the principal point look alike, so the rotation that best explains
    the difference over the image is taken out first.
    """
    columns, rows = GRID
    grid = np.stack(
        np.meshgrid(np.linspace(0, true.width_px - 1, columns), np.linspace(0, true.height_px - 1, rows)), -1
    ).reshape(columns * rows, 2)
    a, b = directions(true, grid), directions(found, grid)
    a, b = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (a, b))
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    R = nearest_rotation(b[good].T @ a[good])
    return project_camera(found, directions(true, uv_px) @ R.T) - uv_px


def imaging_score(true: Interior, calibration: Calibration) -> dict:
    """The found camera against the true one where there are data: `imaging_error_px` and `imaging_u_px`, stated, both
    root mean squares over the places, and `imaging_anees`, the sum over the places of e^T C^+ e over that of C's ranks
    (2 each, unless fewer than two parameters are told apart there).

    A place is a pixel of the true camera: one observation in each cell of a grid over the image that has any. Its ray
    is imaged by the found camera, smooth field included, with the covariance of that camera's parameters. A turn of the
    camera is no error of it, so the rotation that explains most of the differences is taken from them, and its part
    from the covariance (S-transformation, METHODS section 5.4). The places share their parameters: one calibration's
    figure scatters widely about 1, the mean over independent calibrations does not (METHODS section 5.4).
    """
    found, at = calibration.interior, _places(true, calibration.residual_at_px)
    rays = directions(true, at)
    at, rays = (values[np.isfinite(rays).all(axis=1)] for values in (at, rays))
    names = [name for name in found.names if name in calibration.labels]
    if len(at) < 3 or not names:
        return {"imaging_error_px": None, "imaging_u_px": None, "imaging_anees": None}
    for _ in range(TURNS):  # the principal point may be off by pixels, and the turn that makes up for it is not small
        uv, by_interior, by_ray = camera_jacobian(found, rays)
        turns = (-by_ray @ cross_matrix(rays)).reshape(2 * len(at), 3)
        turn = np.linalg.lstsq(turns, (at - uv).ravel(), rcond=None)[0]
        rays = rays @ rotation(turn[None])[0].T
    uv, by_interior, by_ray = camera_jacobian(found, rays)
    turns = (-by_ray @ cross_matrix(rays)).reshape(2 * len(at), 3)
    flat = by_interior[:, :, [found.names.index(name) for name in names]].reshape(2 * len(at), len(names))
    S = np.eye(2 * len(at)) - turns @ np.linalg.pinv(turns)
    error, flat, index = S @ (uv - at).ravel(), (S @ flat).reshape(len(at), 2, len(names)), calibration.index(names)
    covariance = flat @ calibration.covariance[np.ix_(index, index)] @ np.swapaxes(flat, 1, 2)
    error = error.reshape(len(at), 2)
    squares = np.einsum("ni,nij,nj->n", error, np.linalg.pinv(covariance, rcond=KNOWN, hermitian=True), error)
    variances = np.linalg.eigvalsh(covariance)
    freedom = int((variances > KNOWN * variances[:, -1:]).sum())
    return {
        "imaging_error_px": float(np.sqrt((error**2).sum(axis=1).mean())),
        "imaging_u_px": float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean())),
        "imaging_anees": float(squares.sum()) / freedom if freedom else None,
    }


def _places(true: Interior, seen_px: np.ndarray) -> np.ndarray:
    """(k, 2) of the pixels (n, 2) those that lie nearest to the middles of the cells of a grid over the image."""
    cell = seen_px / [true.width_px, true.height_px] * GRID
    number = np.clip(cell.astype(int), 0, np.array(GRID) - 1) @ [1, GRID[0]]
    off = np.linalg.norm(cell % 1 - 0.5, axis=1)
    order = np.lexsort((off, number))
    return seen_px[order[np.unique(number[order], return_index=True)[1]]]


def true_in_datum(world: World, board_names: tuple[str, ...]) -> tuple[Poses, Poses]:
    """World-from-datum (1) and datum-from-board (B) true poses; the datum is the first of the named boards.

    Of a free network, which names none, nobody knows the true datum: the world stands for it, and what is measured must
    be fitted before it is compared.
    """
    if not board_names:
        return Poses.identity(1), Poses.identity(0)
    names = [board.name for board in world.field.boards]
    order = np.array([names.index(name) for name in board_names])
    datum = world.world_from_board[order[:1]]
    inverse = datum.inverse()
    boards = world.world_from_board[order]
    return datum, Poses(inverse.R @ boards.R, (inverse.R @ boards.t_mm[..., None])[..., 0] + inverse.t_mm)


def score_camera(world: World, calibration: Calibration) -> dict:
    """Interior orientation: error of each parameter with what was claimed, error in px at the corners, NEES."""
    # Parameters can only be compared between equal models; another model is judged by where it images.
    alike = calibration.interior.model == world.interior.model
    free = [name for name in calibration.interior.without_modes.names if alike and name in calibration.labels]
    chosen = [calibration.interior.names.index(name) for name in free]
    error = (
        (calibration.interior.without_modes.parameters - world.interior.parameters)[chosen] if alike else np.zeros(0)
    )
    index = calibration.index(free)
    covariance = calibration.covariance[np.ix_(index, index)]
    anees = nees(error, covariance) if free else None
    inset = world.interior.corners_px
    corners = interior_difference(world.interior, calibration.interior, inset)
    size = np.linalg.norm(corners, axis=1)
    return {
        "reprojection_rms_px": calibration.reprojection_rms_px,
        "sigma0": calibration.sigma0,
        "observations": calibration.used,
        "rejected": len(calibration.rejected),
        "corner_error_px": float(size.max()),
        "corner_errors_px": size.tolist(),
        "interior_error": dict(zip(free, error.tolist(), strict=True)),
        "interior_u": dict(zip(free, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        "interior_anees": anees,
        **imaging_score(world.interior, calibration),
        "lens_misfit": calibration.misfit or None,
        "notes": list(calibration.notes),
    }


def score_boards(world: World, calibration: Calibration) -> dict:
    """Board poses in the datum frame: shift of each board's marks, turn, NEES; none without boards."""
    _, true = true_in_datum(world, calibration.board_names)
    sheets = {sheet.name: sheet for sheet in world.field.boards}
    shifts, turns, moves, squares = [], [], [], []
    for b, name in enumerate(calibration.board_names):
        if b == 0:
            continue
        xy = sheets[name].marks.xy_mm
        local = np.column_stack([xy, np.zeros(len(xy))])
        found_R, found_t = calibration.boards.R[b], calibration.boards.t_mm[b]
        moved = local @ (found_R - true.R[b]).T + found_t - true.t_mm[b]
        shifts.append((moved**2).sum(axis=1).mean())
        turn = rotation_vector((found_R @ true.R[b].T)[None])[0]
        error = np.concatenate([turn, found_t - true.t_mm[b]])
        unknowns = [f"board:{name}.{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")]
        if calibration.states(unknowns):
            index = calibration.index(unknowns)
            squares.append(chi_squared(error, calibration.covariance[np.ix_(index, index)]))
        turns.append(np.linalg.norm(turn))
        moves.append(np.linalg.norm(error[3:]))
    return {
        "joined": len(calibration.board_names),
        "pose_rms_mm": float(np.sqrt(np.mean(shifts))) if shifts else (0.0 if calibration.board_names else None),
        "names": list(calibration.board_names[1:]),
        "mark_shift_rms_mm": np.sqrt(shifts).tolist(),
        "translation_error_mm": [float(v) for v in moves],
        "rotation_error_mrad": [1e3 * float(v) for v in turns],
        "anees": float(np.divide(*np.sum(squares, axis=0))) if squares else float("nan"),
        "graph": [list(edge) for edge in calibration.graph],
    }
