"""A prediction under stable keys, those of the scorecard where it has them."""

import itertools
from typing import Any

import numpy as np

from testfield.adjust.network import Camera, Layout
from testfield.camera.pose import cross_matrix
from testfield.camera.project import camera_jacobian, directions
from testfield.plan.datum import datum_card
from testfield.plan.predict import Prediction, detectable
from testfield.plan.weak import warnings_of, weak_axes
from testfield.score.align import rigid_basis
from testfield.score.camera import GRID
from testfield.seeds import generator

PAIRS = 4000
"""Distances between points that are looked at for how uncertainty grows with length, where there are more."""
CLASSES = 6


def card_of(found: Prediction) -> dict[str, Any]:
    """All figures of a prediction; what does not exist is None."""
    job, plan, network = found.job, found.planned, found.adjustment.network
    control = found.reliability
    freedom = found.adjustment.freedom
    return {
        "scene": job.scene.name,
        "images": len(plan.images),
        "detection": {"expected": len(job.expected), "used": len(plan.network.point)},
        "calibration": {
            "method": job.scene.measure.calibrator,
            "observations": len(network.point),
            "freedom": freedom,
            "mean_redundancy": float(np.einsum("mii->m", found.adjustment.redundancy).mean() / 2),
            "least_redundancy": float(control.redundancy.min(initial=1.0)),
            "uncontrolled": int(control.uncontrolled.sum()),
            "detectable_px": float(np.median(control.detectable_px)),
            "largest_effect": float(control.effect[np.isfinite(control.effect)].max(initial=0)),
            "cameras": [_camera(found, k) for k in range(len(network.cameras))],
        },
        "boards": _boards(found),
        "points": _points(found),
        "lengths": _lengths(found),
        "scale": scale_of(found),
        "datum": datum_card(found),
        "warnings": warnings_of(found),
        "notes": list(found.notes),
    }


def _camera(found: Prediction, k: int) -> dict[str, Any]:
    camera, sheet = found.adjustment.network.cameras[k], found.job.imaging.cameras[k]
    names, cov = _interior(found, k)
    corners = u_corners_px(camera, names, cov)
    return {
        "name": sheet.name,
        "lens": camera.interior.model,
        "interior_u": dict(zip(names, np.sqrt(np.diag(cov)).tolist(), strict=True)),
        "corners_u_px": corners.tolist(),
        "corner_u_px": float(corners.max(initial=0)),
    }


def _interior(found: Prediction, k: int) -> tuple[list[str], np.ndarray]:
    """Names of a camera's free parameters, and their covariance."""
    camera = found.adjustment.network.cameras[k]
    names = [n for n, free in zip(camera.interior.names, camera.unknown, strict=True) if free]
    several = len(found.adjustment.network.cameras) > 1
    prefix = f"camera:{found.job.imaging.cameras[k].name}." if several else ""
    index = found.index([prefix + name for name in names])
    return names, found.shared[np.ix_(index, index)]


def corner_px(found: Prediction) -> float:
    """The largest standard uncertainty at a corner of any camera's image, in px."""
    cameras = found.adjustment.network.cameras
    return max(float(u_corners_px(c, *_interior(found, k)).max(initial=0)) for k, c in enumerate(cameras))


def u_corners_px(camera: Camera, names: list[str], covariance: np.ndarray) -> np.ndarray:
    """(4,) standard uncertainties, root of both axes' sum, with which the image's corners are known.

    A turn of the camera is no error of it: what the rotation takes up that explains most over the image is left out, as
    the scorecard does (`score/camera.py`). Corners outside the lens' domain are 0.
    """
    interior = camera.interior
    right, bottom = interior.width_px - 1, interior.height_px - 1
    x, y = np.meshgrid(np.linspace(0, right, GRID[0]), np.linspace(0, bottom, GRID[1]))
    places = np.vstack([np.column_stack([x.ravel(), y.ravel()]), interior.corners_px])
    rays = directions(interior, places)
    good = np.isfinite(rays).all(axis=1)
    _, by_interior, by_ray = camera_jacobian(interior, np.where(good[:, None], rays, [0, 0, 1]))
    chosen = [interior.names.index(name) for name in names]
    J, T = by_interior[:, :, chosen], -by_ray @ cross_matrix(np.where(good[:, None], rays, [0, 0, 1]))
    on = good.copy()
    on[-4:] = False
    turn = np.linalg.lstsq(T[on].reshape(-1, 3), J[on].reshape(-1, len(chosen)), rcond=None)[0]
    left = (J - T @ turn)[-4:]
    squares = np.einsum("nij,jk,nik->n", left, covariance, left)
    return np.sqrt(np.where(good[-4:], squares, 0))


def _boards(found: Prediction) -> dict[str, Any]:
    sheets, rows = found.job.field.boards, []
    board = found.adjustment.network.point_board[found.adjustment.network.point]
    for k, b in enumerate(found.planned.boards):
        own = found.adjustment.network.image[board == k]
        index = found.index([f"board:{sheets[b].name}.{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")])
        row: dict[str, Any] = {
            "name": sheets[b].name,
            "images": len(np.unique(own)),
            "marks_seen": len(own),
            "u_position_mm": None,
            "u_turn_mrad": None,
            "mark_shift_u_mm": None,
        }
        if len(index) == 6:
            cov = found.shared[np.ix_(index, index)]
            xy = sheets[b].marks.xy_mm @ found.adjustment.network.boards.R[k][:, :2].T
            moved = np.concatenate([-cross_matrix(xy), np.broadcast_to(np.eye(3), (len(xy), 3, 3))], axis=2)
            row |= {
                "u_position_mm": float(np.sqrt(np.trace(cov[3:, 3:]))),
                "u_turn_mrad": float(1e3 * np.sqrt(np.trace(cov[:3, :3]))),
                "mark_shift_u_mm": float(np.sqrt(np.einsum("nij,jk,nik->n", moved, cov, moved).mean())),
            }
        rows.append(row)
    shifts = [row["mark_shift_u_mm"] for row in rows if row["mark_shift_u_mm"] is not None]
    return {"pose_rms_mm": float(np.sqrt(np.mean(np.square(shifts)))) if shifts else 0.0, "boards": rows}


def _points(found: Prediction) -> dict[str, Any]:
    check = np.flatnonzero(found.is_check)
    world = found.job.world
    expected = int(((world.marks.role == 2) & (world.marks.board < 0)).sum())
    u = found.u_mm
    card: dict[str, Any] = {
        "method": found.job.scene.measure.reconstructor,
        "weights": found.points.weights,
        "expected": expected,
        "measured": len(check),
        "u_rms_mm": None,
        "u_worst_mm": None,
        "rmse_mm": None,
        "relative_accuracy": None,
    }
    if len(check):
        size = np.sqrt((u[check] ** 2).sum(axis=1))
        card |= {
            "u_rms_mm": float(np.sqrt((u[check] ** 2).mean())),
            "u_worst_mm": float(size.max()),
            "worst_code": int(found.code[check[size.argmax()]]),
        }
    if len(check) >= 3:
        rmse = found.points.take(check).rms_after(rigid_basis(found.xyz_mm[check]))
        card |= {"rmse_mm": rmse, "relative_accuracy": world.field_diagonal_mm / rmse}
    blocks = found.blocks
    card["axes"] = weak_axes(found)
    card["points"] = [
        {
            "code": int(found.code[k]),
            "role": "check" if found.is_check[k] else "bar",
            "xyz_mm": found.xyz_mm[k].tolist(),
            "u_mm": u[k].tolist(),
            "cov_xyz_mm2": blocks[k].tolist(),
            "rays": int(found.rays[k]),
            "angle_deg": float(found.angle_deg[k]),
        }
        for k in range(len(found.code))
    ]
    return card


def _lengths(found: Prediction) -> dict[str, Any]:
    bars = []
    for bar in found.job.field.scale_bars:
        row: dict[str, Any] = {"name": bar.name, "role": bar.role, "certified_mm": bar.length_mm}
        ends = found.rows(bar.codes)
        row |= {"u_certified_mm": bar.u_length_mm, "u_measured_mm": None}
        if ends is not None:
            row["u_measured_mm"] = float(found.points.u_lengths_mm(ends[None], found.xyz_mm)[0])
        bars.append(row)
    lines = []
    for line in found.job.field.measuring_lines:
        for code, length in zip(line.codes[1:], line.length_mm, strict=True):
            ends = found.rows((line.codes[0], code))
            u = None if ends is None else float(found.points.u_lengths_mm(ends[None], found.xyz_mm)[0])
            pair = [line.codes[0], code]
            lines.append({"line": line.name, "codes": pair, "length_mm": length, "u_measured_mm": u})
    return {"bars": bars, "lines": lines, "over_length": over_length(found)}


def over_length(found: Prediction) -> list[dict[str, float]]:
    """How uncertainty grows with the distance of two check points: classes of length with the rms and the largest."""
    check = np.flatnonzero(found.is_check)
    n = len(check)
    if n < 2:
        return []
    if n * (n - 1) // 2 <= PAIRS:
        a, b = np.triu_indices(n, 1)
    else:
        rng = generator(found.job.scene.seed, "plan/pairs")
        a = rng.integers(0, n, PAIRS)
        b = (a + rng.integers(1, n, PAIRS)) % n
    ends = np.column_stack([check[a], check[b]])
    length = np.linalg.norm(found.xyz_mm[ends[:, 0]] - found.xyz_mm[ends[:, 1]], axis=1)
    u = found.points.u_lengths_mm(ends, found.xyz_mm)
    edges = np.linspace(0, length.max() * (1 + 1e-9), CLASSES + 1)
    rows = []
    for low, high in itertools.pairwise(edges):
        here = (length >= low) & (length < high)
        if here.any():
            rms, most = float(np.sqrt((u[here] ** 2).mean())), float(u[here].max())
            mean = float(length[here].mean())
            rows.append({"length_mm": mean, "u_rms_mm": rms, "u_most_mm": most, "pairs": int(here.sum())})
    return rows


def scale_of(found: Prediction) -> dict[str, Any]:
    """What the scale rests on: every source with its redundancy, and the smallest error of it that would be noticed."""
    network = found.adjustment.network
    sources: list[dict[str, Any]] = []
    if network.scale_free:
        at = Layout.of(network).scale
        left = float(np.sqrt(found.adjustment.covariance[at, at]))
        r = 1 - (left / network.u_scale) ** 2
        found_ppm = detectable(1e6 * network.u_scale, r)
        sources.append(
            {"source": "prints", "u_ppm": 1e6 * network.u_scale, "redundancy": r, "detectable_ppm": found_ppm}
        )
    for name, ends, length, u in zip(
        found.planned.bars,
        network.distances.ends,
        network.distances.length_mm,
        network.distances.u_mm,
        strict=True,
    ):
        d = network.point_mm[ends[0]] - network.point_mm[ends[1]]
        direction = np.concatenate([d, -d]) / np.linalg.norm(d)
        var = float(direction @ found.adjustment.cov.points(ends) @ direction)
        r = 1 - var / u**2 if u > 0 else 0.0
        ppm = 1e6 * u / length
        sources.append({"source": name, "u_ppm": ppm, "redundancy": r, "detectable_ppm": detectable(ppm, r)})
    for bar in found.job.field.scale_bars:
        rows = found.rows(bar.codes)
        if bar.role == "check" and rows is not None:
            u = float(np.hypot(found.points.u_lengths_mm(rows[None], found.xyz_mm)[0], bar.u_length_mm))
            ppm = 1e6 * u / bar.length_mm
            sources.append({"source": bar.name, "u_ppm": ppm, "redundancy": 1.0, "detectable_ppm": detectable(ppm)})
    seen = [s for s in sources if s["detectable_ppm"] is not None]
    best = min(seen, key=lambda s: s["detectable_ppm"], default=None)
    return {
        "sources": sources,
        "smallest_detectable_ppm": best and best["detectable_ppm"],
        "shown_by": best and best["source"],
    }
