"""The report: one self-contained HTML page, pictures first, then tables, then provenance."""

import base64
from pathlib import Path
from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.one_of_several import of_camera
from testfield.calibrate.rejections import lossy
from testfield.camera.images import Frame
from testfield.detect.observations import MEASURED, Observations
from testfield.reconstruct.points import Points
from testfield.report import figures
from testfield.report.pages import page
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.score.detection import score_detection
from testfield.score.floor import floor_of
from testfield.score.points import score_points
from testfield.score.scorecard import load_scorecard, ten_figures
from testfield.store.text import write_text

MOST_BYTES = 6_500_000
"""Of all pictures that one may choose: with the figures, the page stays below 8 MB."""
WIDTHS = {1240: 12, 900: 30, 640: 80, 480: 1000}
"""Width in px of pictures of stations, and of how many at most."""


def write_report(
    world: World,
    views: Views,
    scene: SceneFile,
    folder: Path,
    notes: dict[str, Any],
    path: Path,
    cameras: dict[str, World] | None = None,
) -> None:
    """Write the page of a run's folder; `cameras` are the worlds as several cameras see them, by name."""
    card = load_scorecard(folder / "scorecard.json")
    observations = Observations.load(folder / "observations.parquet").at_times(world.field.moving)
    calibration = Calibration.load(folder / "calibration.json")
    found = score_detection(world, views, observations)
    points = score_points(world, calibration, Points.load(folder / "points.parquet"))
    name = _telling_station(observations)
    others = _other_pictures(folder, name, observations)
    html = page(
        "page.html",
        scene=scene,
        card=card,
        ten=ten_figures(card),
        notes=notes,
        station=name,
        picture=_picture(folder, name, observations, figures.PICTURE_WIDTH),
        others=others,
        stations=[other for other in observations.stations if other == name or other in others],
        plan=_inline(figures.field_plan(world, calibration, points)) if len(points.code) else None,
        centres=_inline(figures.centre_errors(found)),
        claimed=_inline(figures.claimed_against_actual(points)) if np.isfinite(points.u_mm).any() else None,
        cameras=_camera_parts(cameras or {"": world}, calibration, card["calibration"]),
        check=_check_rows(points),
        graph=_graph_rows(calibration),
        board_quality=calibration.board_quality,
        test=calibration.test,
        certificates=calibration.certificates,
        groups=lossy(calibration.rejections),
        failures=card["verdict"]["failures"],
        rejected=calibration.rejected,
        counts=_status_rows(observations),
        certificate=floor_of(folder),
        images=_making_rows(notes.get("images", {})),
    )
    write_text(path, html)


def _picture(folder: Path, station: str, observations: Observations, width_px: int) -> str:
    frame = Frame.load(folder / f"frames/{station}.png", station)
    return _data(figures.detections(frame, observations, width_px), "image/jpeg")


def _other_pictures(folder: Path, chosen: str, observations: Observations) -> dict[str, str]:
    """Pictures of all stations but the one that is shown first, the wider the fewer they are, so that the page stays
    below its size; of very many only the first ones."""
    names = [name for name in observations.stations if name != chosen and (folder / f"frames/{name}.png").is_file()]
    width = next((w for w, most in WIDTHS.items() if len(names) <= most), min(WIDTHS))
    pictures: dict[str, str] = {}
    for name in names:
        picture = _picture(folder, name, observations, width)
        if sum(map(len, pictures.values())) + len(picture) > MOST_BYTES:
            break
        pictures[name] = picture
    return pictures


def _making_rows(images: dict[str, dict]) -> list[str]:
    """A sentence for each way that images were made, with the names of those that were; nothing is said of old runs."""
    groups: dict[str, list[str]] = {}
    for name, made in images.items():
        groups.setdefault(made["mode"], []).append(name)
    rows = []
    for mode, names in groups.items():
        sampled = [images[name] for name in names if images[name]["samples"]]
        said = f"{mode}: {', '.join(names)}"
        if sampled:
            noise = [made["noise"] for made in sampled]
            said += (
                f"; {np.mean([made['samples'] for made in sampled]):.0f} samples a pixel, standard error "
                f"{100 * min(noise):.2f} to {100 * max(noise):.2f} % of white (rms over what was sampled), "
                f"{100 * max(made['over_target'] for made in sampled):.2f} % of the pixels above the target at most"
            )
        rows.append(said)
    return rows


def _telling_station(observations: Observations) -> str:
    """The station with the most measured targets."""
    return observations.stations[
        int(np.bincount(observations.measured.station, minlength=len(observations.stations)).argmax())
    ]


def _data(content: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _inline(svg: bytes) -> str:
    return _data(svg, "image/svg+xml")


def _camera_parts(cameras: dict[str, World], calibration: Calibration, card: dict) -> list[dict[str, Any]]:
    """Of each camera its name (none where it is alone), its parameters and its residuals."""
    if not calibration.more_cameras:
        rows = _interior_rows(next(iter(cameras.values())), calibration, card)
        return [{"name": "", "interior": rows, "residuals": _inline(figures.residual_map(calibration))}]
    parts = []
    for k, name in enumerate(calibration.camera_names):
        own = of_camera(calibration, k)
        rows = _interior_rows(cameras[name], own, card["cameras"][name])
        parts.append({"name": name, "interior": rows, "residuals": _inline(figures.residual_map(own))})
    return parts


def _interior_rows(world: World, calibration: Calibration, card: dict) -> list[tuple]:
    """Name, true and found value, error, claimed uncertainty; without the truth where the models differ."""
    u = card["interior_u"]
    alike = calibration.interior.model == world.interior.model
    rows = []
    for k, name in enumerate(calibration.interior.without_modes.names):
        form = "{:.4f}" if k < 4 else "{:.6g}"
        found = calibration.interior.parameters[k]
        true = world.interior.parameters[k] if alike else None
        shown = "–" if true is None else form.format(true)
        rows.append((name, shown, form.format(found), None if true is None else found - true, u.get(name)))
    return rows


def _check_rows(points: Any) -> list[tuple]:
    order = np.argsort(-np.linalg.norm(points.error_mm, axis=1))
    return [
        (int(points.code[k]), *points.true_mm[k], *(1000 * points.error_mm[k]), *(1000 * points.u_mm[k])) for k in order
    ]


def _graph_rows(calibration: Calibration) -> list[tuple]:
    """For each board: its name, and of each station that saw it the joint's marks, residuals and redundancy."""
    seen = {
        (station, board): {"marks": n, "rms_px": None, "redundancy": None} for station, board, n in calibration.graph
    }
    seen |= {(joint["station"], joint["board"]): joint for joint in calibration.joints}
    return [
        (board, [seen.get((station, board)) for station in calibration.station_names])
        for board in calibration.board_names
    ]


def _status_rows(observations: Observations) -> list[tuple[str, int]]:
    names, counts = np.unique(observations.status.astype(str), return_counts=True)
    order = np.argsort(-counts)
    rows = [(str(names[k]), int(counts[k])) for k in order]
    return sorted(rows, key=lambda row: row[0] != MEASURED)
