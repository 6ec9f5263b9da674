"""What photographs gave, as files and as a page: the report of a run without whatever needs the truth."""

import base64
import csv
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from testfield.calibrate.calibration import AXES, Calibration
from testfield.calibrate.one_of_several import of_camera
from testfield.calibrate.rejections import lossy
from testfield.calibrate.ties import point_name
from testfield.detect.observations import MEASURED
from testfield.measure.doubts import doubts_of
from testfield.measure.photographs import Measurement
from testfield.report import figures
from testfield.report.measured_figures import coverage, residual_vectors, smooth_part
from testfield.report.measured_parts import boards_of, residual_rows, stations_of, unused_of
from testfield.report.pages import page
from testfield.report.style import ACCENT, INK, WARM, figure, svg_of
from testfield.store.atomic import whole
from testfield.store.stamp import stamp
from testfield.store.text import write_text
from testfield.targets.field import TIME
from testfield.targets.field_file import FieldFile

PICTURE_WIDTH = 1240
K_95 = 2.4477
"""Of a plane's ellipse of 95 %."""


def write_measurement(result: Measurement, field: FieldFile, folder: Path, images: tuple[str, ...]) -> dict:
    """`observations.parquet`, `calibration.json`, `points.parquet`, `points.csv`, `measurement.json`, `report.html`;
    returns what `measurement.json` holds."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, save in (
        ("observations.parquet", result.observations.save),
        ("calibration.json", result.calibration.save),
        ("points.parquet", result.points.save),
    ):
        with whole(folder / name) as path:
            save(path)
    points = result.points
    u = np.sqrt(np.diag(points.cov_xyz_mm2)).reshape(points.xyz_mm.shape)
    with whole(folder / "points.csv") as path, path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("point", "x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm", "rays", "residual_rms_px"))
        for k in range(len(points)):
            numbers = [f"{v:.5f}" for v in (*points.xyz_mm[k], *u[k])]
            table.writerow(
                (spoken_point(int(points.code[k])), *numbers, points.rays[k], f"{points.residual_rms_px[k]:.4f}")
            )
    summary = stamp() | {
        "field": field.name,
        "images": list(result.observations.stations),
        "joined": list(result.calibration.station_names),
        "unread": list(result.unread),
        "datum": result.datum,
        "figures": _figures(result),
        "interior": result.calibration.interior.without_modes.to_json(),
        "interior_u": _interior_u(result.calibration),
        **_several(result.calibration),
        "reprojection_rms_px": result.calibration.reprojection_rms_px,
        "sigma0": result.calibration.sigma0,
        "lens_misfit": result.calibration.misfit or None,
        "halves": asdict(result.halves),
        "points": len(points),
        "uncoded": result.uncoded,
        "lengths": [asdict(length) for length in result.lengths],
        "rejected": list(result.calibration.rejected),
        "rejections": list(result.calibration.rejections),
        "certificates": list(result.calibration.certificates),
        "failures": list(result.calibration.failures),
        "passed": not result.calibration.failures,
        "doubts": list(doubts_of(result)),
        "notes": list(result.calibration.notes),
    }
    with whole(folder / "measurement.json") as path:
        write_text(path, json.dumps(summary, indent=1))
    with whole(folder / "report.html") as path:
        write_text(path, _page(result, field, folder, images, u, summary))
    return summary


def spoken_point(code: int) -> str:
    """A point as a person calls it, on a moved board with its arrangement."""
    return f"code {code % TIME} (arrangement {code // TIME + 1})" if code > TIME else point_name(code)


def _several(calibration: Calibration) -> dict[str, Any]:
    """What there is of several cameras: each one's interior orientation, and relative orientations."""
    if not calibration.more_cameras:
        return {}
    each = {name: of_camera(calibration, k) for k, name in enumerate(calibration.camera_names)}
    cameras = {
        name: {"interior": one.interior.without_modes.to_json(), "interior_u": _interior_u(one)}
        for name, one in each.items()
    }
    return {"cameras": cameras, "rigs": [one | _rig_u(calibration, one) for one in calibration.rigs]}


def _rig_u(calibration: Calibration, one: dict[str, Any]) -> dict[str, float]:
    """Standard uncertainties of a relative orientation, roots of the axes' sums of squares."""
    index = calibration.index([f"member:{one['rig']}/{one['camera']}.{axis}" for axis in AXES])
    u2 = np.diag(calibration.covariance)[index]
    return {"u_turn_rad": float(np.sqrt(u2[:3].sum())), "u_mm": float(np.sqrt(u2[3:].sum()))}


def _interior_u(c: Calibration) -> dict[str, float]:
    own = [name for name in c.interior.without_modes.names if name in c.labels]
    return {name: float(np.sqrt(c.covariance[k, k])) for name, k in zip(own, c.index(own), strict=True)}


def _figures(result: Measurement) -> list[tuple[str, str]]:
    c, points = result.calibration, result.points
    o = result.observations
    seen = int((o.status == MEASURED).sum())
    rows = [
        ("images joined, of those given", f"{len(c.station_names)} of {len(o.stations) + len(result.unread)}"),
        ("targets measured; used", f"{seen}; {c.used}"),
        ("reprojection, rms", f"{c.reprojection_rms_px:.4f} px"),
        ("scatter over claim (sigma0)", f"{c.sigma0:.2f}"),
        ("focal length", ", ".join(f"{interior.fx:.2f}" for interior in c.interiors) + " px"),
    ]
    if len(points):
        u = np.sqrt(np.diag(points.cov_xyz_mm2)).reshape(points.xyz_mm.shape)
        extent = float(np.linalg.norm(np.ptp(points.xyz_mm, axis=0)))
        mean = float(np.sqrt((u**2).mean()))
        rows += [
            ("points: coded; uncoded", f"{len(points) - result.uncoded}; {result.uncoded}"),
            ("claimed u of a coordinate, rms", f"{mean:.4f} mm"),
            ("the field's diagonal over that", f"1 : {extent / max(mean, 1e-12):,.0f}"),
        ]
    rows += [difference.sentence for difference in result.halves.differences]
    if result.halves.note:
        rows.append(("halves of the images", result.halves.note))
    worst = [length for length in result.lengths if length.en is not None and length.role == "check"]
    if worst:
        length = max(worst, key=lambda item: abs(item.en or 0))
        off, en = length.measured_mm - length.certified_mm, length.en or 0.0
        verdict = "passed" if abs(en) <= 1 else "FAILED"
        both = float(np.hypot(length.u_measured_mm, length.u_certified_mm))
        rows.append(
            ("check distance, measured minus certified", f"{off:+.4f} mm (u {both:.2g} mm), {verdict}: E_n {en:+.2f}")
        )
    doubts = len(doubts_of(result))
    doubtful = f"doubtful, for {doubts} reason{'s' * (doubts > 1)}" if doubts else "nothing failed"
    rows.append(("verdict", f"NOT passed: {len(c.failures)} failure(s)" if c.failures else doubtful))
    return rows


def _page(
    result: Measurement, field: FieldFile, folder: Path, images: tuple[str, ...], u: np.ndarray, summary: dict
) -> str:
    o, c, points = result.observations, result.calibration, result.points
    best = o.stations[int(np.bincount(o.measured.station, minlength=len(o.stations)).argmax())]
    cameras = [
        _camera_part(name, of_camera(c, k)) for k, name in enumerate(c.camera_names if c.more_cameras else ("",))
    ]
    used = residual_rows(result)
    rows = [
        (
            spoken_point(int(points.code[k])),
            *points.xyz_mm[k],
            *(1000 * u[k]),
            int(points.rays[k]),
            float(points.residual_rms_px[k]),
        )
        for k in range(len(points))
    ]
    statuses, counts = np.unique(o.status.astype(str), return_counts=True)
    return page(
        "measured.html",
        field=field,
        result=result,
        figures=summary["figures"],
        best=best,
        notes=c.notes,
        picture=_picture(folder / f"{best}.png"),
        plan=_svg(point_plan(result)) if len(points) else None,
        cameras=cameras,
        rigs=summary.get("rigs"),
        stations=stations_of(result, used),
        boards=boards_of(result, field, used),
        unused=unused_of(result, used, folder),
        verdict=verdict_of(result),
        counts=sorted(zip(statuses.tolist(), counts.tolist(), strict=True), key=lambda row: -row[1]),
        rejected=c.rejected,
        points=rows,
        images=images,
        failures=c.failures,
        doubts=doubts_of(result),
        groups=lossy(c.rejections),
        certificates=c.certificates,
    )


def _camera_part(name: str, c: Calibration) -> dict[str, Any]:
    """A camera's name, parameters and residuals."""
    u = _interior_u(c)
    rows = [
        (name, ("{:.3f}" if k < 4 else "{:.6g}").format(c.interior.parameters[k]), u.get(name))
        for k, name in enumerate(c.interior.without_modes.names)
    ]
    covered, parts = coverage(c)
    smooth, left = smooth_part(c)
    return {
        "name": name,
        "interior": rows,
        "coverage": _svg(covered),
        "covered": parts,
        "residuals": _svg(residual_vectors(c)),
        "smooth": _svg(smooth),
        "left": left,
    }


def verdict_of(result: Measurement) -> list[str]:
    """What a reader must know first, in sentences."""
    c, points = result.calibration, result.points
    said = [
        f"{len(c.station_names)} of {len(result.observations.stations)} photographs joined; {c.used} observations fit "
        f"to {c.reprojection_rms_px:.3f} px rms, {c.sigma0:.2f} times what detection claims."
    ]
    if len(points):
        u = np.sqrt(np.diag(points.cov_xyz_mm2))
        unit = "units of an arbitrary scale" if "ARBITRARY" in result.datum else "mm"
        said.append(
            f"{len(points)} points, a coordinate's standard uncertainty {np.sqrt((u**2).mean()):.3g} {unit} rms."
        )
    else:
        said.append(f"The focal length is {', '.join(f'{interior.fx:.2f}' for interior in c.interiors)} px.")
    checks = [length for length in result.lengths if length.role == "check" and length.en is not None]
    if checks:
        worst = max(checks, key=lambda one: abs(one.en or 0))
        said.append(
            f"Of {len(checks)} check distance{'s' if len(checks) > 1 else ''} the worst is "
            f"{worst.measured_mm - worst.certified_mm:+.4f} mm off (E_n {worst.en:+.2f})."
        )
    elif len(points) and "ARBITRARY" not in result.datum:
        said.append("No check distance tells whether the scale and its uncertainty are true.")
    return said


def point_plan(result: Measurement) -> bytes:
    """Points from above and from the side in their own frame, with enlarged ellipses of 95 %."""
    points = result.points
    span = max(float(np.ptp(points.xyz_mm, axis=0).max()), 1e-9)
    size = float(np.median(np.sqrt(np.diag(points.cov_xyz_mm2))))
    factor = figures._round_up(0.006 * span / (K_95 * max(size, 1e-12)))
    coded = points.code > 0
    with figure(6.1, 7.4, rows=2) as (drawing, both):
        for axes, plane, title in zip(both, ((0, 1), (0, 2)), ("along z", "along y"), strict=True):
            at = points.xyz_mm[:, plane]
            for mask, colour, label in ((coded, ACCENT, "coded"), (~coded, WARM, "uncoded")):
                axes.scatter(*at[mask].T, s=7, color=colour, lw=0, label=label, zorder=5)
            for k in range(len(points)):
                block = points.covariance_of(np.array([k]))
                ring = figures._ellipse(block[np.ix_(plane, plane)], K_95 * factor) + at[k]
                axes.plot(*ring.T, color=INK, lw=0.5, alpha=0.6)
            margin = 0.06 * span
            axes.set_xlim(at[:, 0].min() - margin, at[:, 0].max() + margin)
            axes.set_ylim(at[:, 1].min() - margin, at[:, 1].max() + margin)
            axes.set_aspect("equal")
            axes.set_xlabel(f"{'xyz'[plane[0]]}, mm")
            axes.set_ylabel(f"{'xyz'[plane[1]]}, mm")
            axes.set_title(f"{title}; ellipses of 95 %, {factor:g} times enlarged", loc="left")
        both[0].legend(loc="upper right", framealpha=0.9)
        return svg_of(drawing)


def _picture(path: Path) -> str | None:
    if not path.is_file():  # measured from observations alone
        return None
    picture = np.asarray(cv2.imread(str(path)))
    scale = min(1.0, PICTURE_WIDTH / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode()}"


def _svg(content: bytes) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(content).decode()}"
