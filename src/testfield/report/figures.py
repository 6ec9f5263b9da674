"""The report's figures, each a function of the run's data that returns an SVG or PNG as bytes."""

import cv2
import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Frame
from testfield.detect.observations import MEASURED, Observations
from testfield.report.plan import ELEVATION, PLAN, draw_field
from testfield.report.style import ACCENT, INK, WARM, figure, shown, svg_of
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.detection import DetectionScore
from testfield.score.points import PointScore

PICTURE_WIDTH = 1240
UNTOLD_PX2 = 4.0
"""Second moments with which a target is drawn whose size nobody states."""


def detections(frame: Frame, observations: Observations, width_px: int = PICTURE_WIDTH) -> bytes:
    """A frame of `width_px` at most, as JPEG, with what detection found drawn in: plain dots, codes with their numbers,
    and what was turned down."""
    image: np.ndarray = frame.pixels_dn.astype(np.float32) - frame.sheet.black_level_dn
    scale = min(1.0, width_px / image.shape[1])
    if scale < 1:
        image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.float32)
    colour = cv2.cvtColor((255 * shown(image)).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    station = observations.stations.index(frame.station)
    for row in np.flatnonzero(observations.station == station):
        x, y = scale * (observations.xy_px[row] + 0.5) - 0.5
        if observations.status[row] != MEASURED:
            if observations.status[row] == "partly hidden or disturbed":
                cv2.drawMarker(colour, (round(x), round(y)), (60, 60, 230), cv2.MARKER_TILTED_CROSS, 16, 2, cv2.LINE_AA)
            continue
        moments = observations.moments_px2[row]
        values, vectors = np.linalg.eigh(moments if np.isfinite(moments).all() else UNTOLD_PX2 * np.eye(2))
        axes = 2 * scale * np.sqrt(values[::-1])
        angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
        code = int(observations.code[row])
        tint = (40, 160, 240) if code else ((210, 150, 30) if observations.board[row] >= 0 else (160, 160, 160))
        cv2.ellipse(colour, ((float(x), float(y)), (2 * axes[0] + 7, 2 * axes[1] + 7), angle), tint, 2, cv2.LINE_AA)
        if code:
            place = (round(x + 3.2 * axes[0]), round(y - 1.5 * axes[0]))
            size = 0.75 if scale == 1 else 0.5
            cv2.putText(colour, str(code), place, cv2.FONT_HERSHEY_SIMPLEX, size, tint, 2, cv2.LINE_AA)
    return cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()


def residual_map(calibration: Calibration) -> bytes:
    """Mean residual of the calibration in cells of the image, exaggerated: what the model leaves unexplained."""
    interior = calibration.interior
    columns = 24
    cell = interior.width_px / columns
    rows = round(interior.height_px / cell)
    index = (calibration.residual_at_px // cell).astype(int).clip(0, [columns - 1, rows - 1]) @ [1, columns]
    count = np.bincount(index, minlength=rows * columns)
    with np.errstate(invalid="ignore"):
        mean = np.stack(
            [
                np.bincount(index, weights=calibration.residual_px[:, k], minlength=rows * columns) / count
                for k in (0, 1)
            ],
            -1,
        )
    enough = count >= 3
    x, y = (
        (np.arange(rows * columns) % columns + 0.5) * cell,
        (np.arange(rows * columns) // columns + 0.5) * cell,
    )
    enough &= np.isfinite(mean).all(axis=1)
    with figure(6.1, 6.1 * interior.height_px / interior.width_px + 0.55) as (drawing, axes):
        if enough.any():
            unit = _round_up(np.percentile(np.linalg.norm(mean[enough], axis=1), 90))
            arrows = axes.quiver(
                x[enough],
                y[enough],
                *mean[enough].T,
                angles="xy",
                scale_units="xy",
                scale=unit / cell,
                color=ACCENT,
                width=0.0028,
            )
            axes.quiverkey(arrows, 0.86, 1.03, unit, f"{unit:g} px", labelpos="E")
        axes.set_xlim(0, interior.width_px)
        axes.set_ylim(interior.height_px, 0)
        axes.set_aspect("equal")
        axes.set_xlabel("x, px")
        axes.set_ylabel("y, px")
        return svg_of(drawing)


def field_plan(world: World, calibration: Calibration, score: PointScore) -> bytes:
    """Plan and elevation with the check points' 95 % ellipses and their actual errors, both exaggerated."""
    datum, _ = true_in_datum(world, calibration.board_names)
    R, t = datum.R[0], datum.t_mm[0]
    true, error = score.true_mm @ R.T + t, score.error_mm @ R.T
    span = np.ptp(true, axis=0).max() if len(true) else 1000.0
    stated = np.isfinite(score.u_mm).all()
    size = np.sqrt(((score.u_mm if stated else error) ** 2).mean()) if len(true) else 1.0
    factor = _round_up(0.02 * span / (2.45 * size))
    # Both parts are wide, so they stand one above the other on the same axis.
    with figure(6.1, 7.4, rows=2, sharex=True) as (drawing, both):
        for axes, plane, title in zip(both, (ELEVATION, PLAN), ("elevation", "plan"), strict=True):
            draw_field(axes, world, plane, stations=False)
            for k in range(len(true)):
                if stated:
                    covariance = R @ score.covariance(k) @ R.T
                    ring = _ellipse(covariance[np.ix_(plane, plane)], 2.4477 * factor) + true[k][list(plane)]
                    axes.plot(*(ring / 1000).T, color=ACCENT, lw=0.9, zorder=7)
                axes.plot(
                    *((true[k] + np.outer([0, factor], error[k]))[:, plane] / 1000).T,
                    color=WARM,
                    lw=1.3,
                    zorder=8,
                )
            low, high = (f(world.mark_world_mm[:, plane] / 1000, axis=0) for f in (np.min, np.max))
            axes.set_xlim(low[0] - 0.35, high[0] + 0.35)
            axes.set_ylim(low[1] - 0.35, high[1] + 0.35)
            what = "ellipses (95 %) and errors" if stated else "errors, no uncertainty stated,"
            axes.set_title(f"{title}: {what} {factor:g} times enlarged", loc="left")
        return svg_of(drawing)


def centre_errors(score: DetectionScore) -> bytes:
    """Histogram of centre errors, and of the same in units of what was claimed, with the normal law."""
    error = score.error_px.ravel()
    with figure(6.1, 2.7, 2) as (drawing, (left, right)):
        reach = max(4 * float(np.median(np.abs(error))) / 0.6745, 1e-9)
        left.hist(error.clip(-reach, reach), bins=61, range=(-reach, reach), color=ACCENT, alpha=0.85)
        left.locator_params(axis="x", nbins=5)
        left.set_xlabel("centre error, px (x and y)")
        left.set_ylabel("number")
        size = np.sqrt(score.nees[np.isfinite(score.nees)])
        stated = len(size) > 0
        right.hist(size.clip(0, 5), bins=50, range=(0, 5), density=stated, color=ACCENT, alpha=0.85, label="observed")
        r = np.linspace(0, 5, 200)
        right.plot(r, r * np.exp(-r * r / 2), color=WARM, lw=1.5, label="claimed")
        right.set_xlabel("error in units of its claimed sigma")
        right.legend(frameon=False)
        return svg_of(drawing)


def claimed_against_actual(score: PointScore) -> bytes:
    """Each coordinate's error against its claimed uncertainty, with the lines of one and two sigma."""
    with figure(6.1, 3.1) as (drawing, axes):
        u, error = 1000 * score.u_mm, 1000 * np.abs(score.error_mm)
        top = 1.1 * max(error.max(initial=0), 2 * u.max(initial=1e-6))
        right = 1.1 * u.max(initial=1e-6)
        line = np.array([0, right])
        axes.fill_between(line, 0, line, color=ACCENT, alpha=0.13, lw=0)
        axes.fill_between(line, line, 2 * line, color=ACCENT, alpha=0.06, lw=0)
        for k, (name, marker) in enumerate(zip("xyz", "os^", strict=True)):
            axes.scatter(u[:, k], error[:, k], s=13, marker=marker, color=(ACCENT, WARM, INK)[k], lw=0, label=name)
        axes.text(right, right, " 1 sigma", va="center")
        axes.text(right, 2 * right, " 2 sigma", va="center")
        axes.set_xlim(0, right)
        axes.set_ylim(0, top)
        axes.set_xlabel("claimed standard uncertainty, µm")
        axes.set_ylabel("actual error, µm")
        axes.legend(frameon=False, loc="upper left")
        return svg_of(drawing)


def _ellipse(covariance: np.ndarray, k: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 60)
    values, vectors = np.linalg.eigh(covariance)
    return k * (np.column_stack([np.cos(angle), np.sin(angle)]) * np.sqrt(np.maximum(values, 0))) @ vectors.T


def _round_up(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten; 1 of nothing."""
    if not 0 < value < np.inf:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)) * power)
