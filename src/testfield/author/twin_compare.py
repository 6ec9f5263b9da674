"""A measured job and its twin side by side: residuals, what is stated, and the twin's actual errors."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.similarity import similarity
from testfield.detect.observations import MEASURED, Observations
from testfield.reconstruct.points import Points
from testfield.scene.build import build_world
from testfield.scene.schema import SceneFile

ALIKE, UNLIKE = 1.5, 0.3
"""A ratio up to which two scatters are alike, and a difference of correlations beyond which there is a reason."""
MOST_MARKS = 1_000_000
"""More than any board has: numbers of marks, board by board."""
PLACES = 6
"""Decimals of a pixel by which a residual finds its observation."""


@dataclass(frozen=True)
class Measured:
    """What a folder of `testfield measure` holds."""

    calibration: Calibration
    points: Points
    observations: Observations

    @staticmethod
    def load(folder: Path) -> "Measured":
        """Raises `TestfieldError` where a file is not there or not whole."""
        return Measured(
            Calibration.load(folder / "calibration.json"),
            Points.load(folder / "points.parquet"),
            Observations.load(folder / "observations.parquet"),
        )


@dataclass(frozen=True)
class Row:
    """One figure of both; `ratio` the job's over the twin's, None where it means nothing."""

    title: str
    job: str
    twin: str
    ratio: float | None = None


def residuals_of(measured: Measured) -> tuple[np.ndarray, np.ndarray]:
    """(k,) rows of the observations that were adjusted, and (k, 2) their residuals in px."""
    o, c = measured.observations, measured.calibration
    known = {tuple(np.round(at, PLACES)): k for k, at in enumerate(c.residual_at_px)}
    pairs = [
        (row, found)
        for row in np.flatnonzero(o.status == MEASURED)
        if (found := known.get(tuple(np.round(o.xy_px[row], PLACES)))) is not None
    ]
    rows, residual = np.array([p[0] for p in pairs], int), np.array([p[1] for p in pairs], int)
    return rows, c.residual_px[residual]


def compared(job: Measured, twin: Measured, scene: SceneFile) -> list[Row]:
    """Figures of both, residuals first. Where the job has codes, residuals are those of codes, which both have."""
    coded = bool((job.points.code > 0).any())
    rows = [_of_residuals(job, twin, coded)]
    claims = [_claimed(one, coded) for one in (job, twin)]
    scatter = [one.calibration.sigma0 for one in (job, twin)]
    implied = [u * s for u, s in zip(claims, scatter, strict=True)]
    rows += [
        _row("standard deviation that residuals imply", [f"{v:.4f} px" for v in implied], implied[0] / implied[1]),
        _row("what detection claims of it, rms", [f"{v:.4f} px" for v in claims]),
        _row("scatter over these claims (sigma0)", [f"{v:.2f}" for v in scatter]),
        _row("correlation of neighbours in an image", [f"{likeness(one):.2f}" for one in (job, twin)]),
    ]
    rows.append(Row("targets adjusted", str(_adjusted(job, coded)), str(_adjusted(twin, coded))))
    for k in range(min(len(job.calibration.interiors), len(twin.calibration.interiors))):
        camera = f"{job.calibration.camera_names[k]}: " if job.calibration.more_cameras else ""
        for name in ("fx", "cx", "cy"):
            rows.append(_row(f"{camera}{name} ± u, px", [_parameter(one.calibration, k, name) for one in (job, twin)]))
        rows.append(_focal_error(twin, scene, k, camera))
    if coded:
        rows += _of_points(job, twin, scene)
    return rows


def reasons(job: Measured, twin: Measured) -> list[str]:
    """What makes the job's residuals other than the twin's, as far as both show it; empty where they are alike."""
    coded = bool((job.points.code > 0).any())
    raw = _rms(job, coded) / _rms(twin, coded)
    a, b = (_claimed(one, coded) * one.calibration.sigma0 for one in (job, twin))
    implied = a / b
    said = []
    if max(implied, 1 / implied) > ALIKE:
        if implied < 1:
            said.append(
                "the twin scatters more than the photographs: its noise, blur or contrast was taken for worse than it "
                "is; compare the images"
            )
        elif likeness(job) - likeness(twin) > UNLIKE:
            said.append(
                "residuals of neighbours go together in the photographs and not in the twin: something smooth differs "
                "from image to image (a target that bends, focus, motion), and a twin holds still"
            )
        else:
            said.append(
                "the photographs have errors that the twin does not: look at their sharpening, light and targets"
            )
    elif max(raw, 1 / raw) > ALIKE:
        said.append(
            "corrected for redundancy both scatter alike; the residuals differ because other targets control the codes "
            "in the photographs and in the twin"
        )
    return said


def _row(title: str, both: list[str], ratio: float | None = None) -> Row:
    job, twin = both
    return Row(title, job, twin, ratio)


def _rms(measured: Measured, coded: bool) -> float:
    rows, residual = residuals_of(measured)
    chosen = measured.observations.code[rows] > 0 if coded else np.ones(len(rows), bool)
    return float(np.sqrt(np.mean(residual[chosen] ** 2))) if chosen.any() else float("nan")


def _claimed(measured: Measured, coded: bool) -> float:
    """Root mean square of the standard uncertainties of adjusted coordinates, as detection claims them."""
    rows, _ = residuals_of(measured)
    chosen = rows[measured.observations.code[rows] > 0] if coded else rows
    cov = measured.observations.cov_px2[chosen]
    return float(np.sqrt(np.trace(cov, axis1=1, axis2=2).mean() / 2)) if len(chosen) else float("nan")


def _of_residuals(job: Measured, twin: Measured, coded: bool) -> Row:
    a, b = _rms(job, coded), _rms(twin, coded)
    title = "residual of a coordinate, rms, of codes" if coded else "residual of a coordinate, rms"
    return Row(title, f"{a:.4f} px", f"{b:.4f} px", a / b if b else None)


def _adjusted(measured: Measured, coded: bool) -> int:
    rows, _ = residuals_of(measured)
    return int((measured.observations.code[rows] > 0).sum()) if coded else len(rows)


def likeness(measured: Measured) -> float:
    """Correlation of the residuals of neighbouring marks in one image, what each mark's residuals share over all images
    taken out: 0 where only noise is left, near 1 where something smooth differs from image to image."""
    rows, residual = residuals_of(measured)
    o, own = measured.observations, residual.copy()
    mark_of = np.where(o.point[rows] >= 0, o.point[rows] + MOST_MARKS * np.maximum(o.board[rows], 0), -1)
    for mark in np.unique(mark_of):
        same = mark_of == mark
        if mark >= 0 and same.sum() > 2:
            own[same] -= own[same].mean(axis=0)
    products, squares = 0.0, 0.0
    for station in np.unique(o.station[rows]):
        here = np.flatnonzero(o.station[rows] == station)
        if len(here) > 2:
            near = cKDTree(o.xy_px[rows[here]]).query(o.xy_px[rows[here]], k=2)[1][:, 1]
            products += float((own[here] * own[here][near]).sum())
            squares += float((own[here] ** 2).sum())
    return products / squares if squares else 0.0


def _parameter(calibration: Calibration, camera: int, name: str) -> str:
    inner = calibration.interiors[camera]
    label = calibration.interior_unknowns(camera)[inner.names.index(name)]
    u = float("nan")
    if calibration.states([label]):
        k = int(calibration.index([label])[0])
        u = float(np.sqrt(calibration.covariance[k, k]))
    return f"{getattr(inner, name):.2f} ± {u:.2f}"


def _focal_error(twin: Measured, scene: SceneFile, camera: int, head: str) -> Row:
    part = scene.camera
    if scene.cameras:
        part = next(one for one in scene.cameras if one.name == twin.calibration.camera_names[camera])
    true = 1000 * part.focal_length_mm / part.pixel_pitch_um
    return Row(
        f"{head}actual error of the focal length", "unknown", f"{twin.calibration.interiors[camera].fx - true:+.3f} px"
    )


def _of_points(job: Measured, twin: Measured, scene: SceneFile) -> list[Row]:
    """Stated uncertainty of the codes' coordinates, and the twin's actual errors after a fit of seven parameters."""
    world = build_world(scene)
    true = dict(zip(world.marks.code.tolist(), world.mark_world_mm, strict=True))
    true.pop(0, None)
    both = [k for k in range(len(twin.points)) if int(twin.points.code[k]) in true]
    rows = [_row("stated u of a code's coordinate, rms", [f"{_stated(one.points):.4f} mm" for one in (job, twin)])]
    if len(both) < 4:
        return rows
    found = twin.points.xyz_mm[both]
    target = np.array([true[int(twin.points.code[k])] for k in both])
    error = fitted(found, target) - target
    rows.append(
        Row("actual error of a coordinate, rms, fitted", "unknown", f"{float(np.sqrt((error**2).mean())):.4f} mm")
    )
    return rows


def _stated(points: Points) -> float:
    coded = np.flatnonzero(points.code > 0)
    return float(np.sqrt(np.diag(points.covariance_of(coded)).mean()))


def fitted(found: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(n, 3) `found` moved, turned and scaled onto `target` by least squares (Umeyama 1991)."""
    scale, R, t = similarity(found, target)
    return np.asarray(scale * found @ R.T + t)
