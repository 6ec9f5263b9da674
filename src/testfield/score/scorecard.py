"""All figures of a run under stable keys."""

import json
import math
from pathlib import Path
from typing import Any

from pydantic import model_validator

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.rejections import failed_checks
from testfield.detect.observations import Observations
from testfield.errors import speaking
from testfield.reconstruct.points import Points
from testfield.scene.camera_parts import RigPart
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.score.camera import score_boards
from testfield.score.detection import score_detection
from testfield.score.points import score_lengths, score_points
from testfield.score.several import score_cameras, score_rigs
from testfield.store.sheets import Count, Finite, OpenSheet, checked, read_json
from testfield.store.stamp import stamp
from testfield.store.text import write_text

TEN = (
    ("targets found of those expected", "detection.found_fraction", "{:.2%}"),
    ("wrong codes", "detection.wrong_code", "{:d}"),
    ("centre error, rms", "detection.centre_rms_px", "{:.4f} px"),
    ("reprojection, rms", "calibration.reprojection_rms_px", "{:.4f} px"),
    ("interior orientation, worst corner", "calibration.corner_error_px", "{:.4f} px"),
    ("board poses, rms", "boards.pose_rms_mm", "{:.4f} mm"),
    ("check points, RMSE after a 6-parameter fit", "points.rmse_mm", "{:.4f} mm"),
    ("relative accuracy, field diagonal / RMSE", "points.relative_accuracy", "1 : {:,.0f}"),
    ("check points, NEES per degree of freedom", "points.anees", "{:.2f}"),
    ("check bar, measured minus true", "lengths.check_error_mm", "{:+.4f} mm"),
)
"""The ten figures that matter: title, key, format."""


def scorecard(
    world: World,
    views: Views,
    observations: Path,
    calibration: Path,
    points: Path,
    cameras: dict[str, World] | None = None,
    rigs: tuple[RigPart, ...] = (),
) -> dict[str, Any]:
    """Score a run's files against the truth; of several cameras, `cameras` are the worlds that they see, by name."""
    found, camera, targets = Observations.load(observations), Calibration.load(calibration), Points.load(points)
    return score_measured(world, views, found, camera, targets, cameras, rigs)


def score_measured(
    world: World,
    views: Views,
    observations: Observations,
    camera: Calibration,
    targets: Points,
    cameras: dict[str, World] | None = None,
    rigs: tuple[RigPart, ...] = (),
) -> dict[str, Any]:
    """Score what was measured against the truth, as `scorecard` does files."""
    detection = score_detection(world, views, observations.at_times(world.field.moving))
    lengths = score_lengths(world, camera, targets)
    checks = [(bar["name"], bar.get("en")) for bar in lengths["bars"] if bar["role"] == "check"]
    failures = [*camera.failures, *failed_checks(checks)]
    return {
        "scene": world.name,
        "seed": world.seed,
        "verdict": {"passed": not failures, "failures": failures},
        "detection": detection.card(),
        "calibration": {"method": camera.method} | score_cameras(cameras or {"": world}, camera),
        "boards": score_boards(world, camera),
        "points": {"method": targets.method} | score_points(world, camera, targets).card(),
        "lengths": lengths,
    } | ({"rigs": score_rigs(rigs, camera)} if camera.rigs else {})


def write_scorecard(card: dict[str, Any], path: Path) -> None:
    """Write as JSON; a figure that does not exist is null."""
    write_text(path, json.dumps(stamp() | plain(card), indent=1, allow_nan=False))


Figure = Finite | None


class _Detection(OpenSheet):
    expected: Count
    found: Count
    found_fraction: Finite
    missed: Count
    missed_reasons: dict[str, Count]
    false: Count
    wrong_code: Count
    wrong_dot: Count
    centre_rms_px: Figure
    centre_bias_x_px: Figure
    centre_bias_y_px: Figure
    centre_worst_px: Figure
    centre_anees: Figure


class _Camera(OpenSheet):
    method: str
    reprojection_rms_px: Figure
    sigma0: Figure
    observations: Count
    rejected: Count
    corner_error_px: Figure
    corner_errors_px: list[Figure]
    interior_u: dict[str, Figure]
    interior_anees: Figure
    notes: list[str]


class _Boards(OpenSheet):
    joined: Count
    pose_rms_mm: Figure
    names: list[str]
    mark_shift_rms_mm: list[Figure]
    translation_error_mm: list[Figure]
    rotation_error_mrad: list[Figure]
    anees: Figure

    @model_validator(mode="after")
    def _as_many(self) -> "_Boards":
        for name in ("mark_shift_rms_mm", "translation_error_mm", "rotation_error_mrad"):
            if len(getattr(self, name)) != len(self.names):
                raise ValueError(f"{name} has not one figure a board")
        return self


class _Points(OpenSheet):
    method: str
    expected: Count
    measured: Count
    fit: str
    rmse_mm: Figure
    rmse_unfitted_mm: Figure
    relative_accuracy: Figure
    relative_accuracy_largest_distance: Figure
    anees: Figure
    anees_fitted: Figure
    anees_band_95: tuple[Finite, Finite] | None
    anees_note: str

    @model_validator(mode="after")
    def _of_what_was_measured(self) -> "_Points":
        if self.measured and self.anees_band_95 is None:
            raise ValueError("anees_band_95 is missing")
        return self


class _Bar(OpenSheet):
    name: str
    role: str
    note: str = ""


class _MeasuredBar(_Bar):
    certified_mm: Finite
    true_mm: Finite
    measured_mm: Finite
    error_mm: Finite
    u_measured_mm: Finite
    en: Figure


class _Lengths(OpenSheet):
    check_error_mm: Figure
    scale_error_ppm: Figure
    u_scale_ppm: Figure
    bars: list[_MeasuredBar | _Bar]


class _Verdict(OpenSheet):
    passed: bool
    failures: list[str]


class _Card(OpenSheet):
    scene: str
    verdict: _Verdict
    detection: _Detection
    calibration: _Camera
    boards: _Boards
    points: _Points
    lengths: _Lengths
    time_s: dict[str, Finite]


@speaking("scorecard")
def load_scorecard(path: Path) -> dict[str, Any]:
    """A run's scorecard. Raises `TestfieldError` where a figure that is shown is missing, or is none."""
    card = read_json(path)
    checked(_Card, card)
    return card


def figure(card: dict[str, Any], key: str) -> Any:
    """The figure under a dotted key."""
    value: Any = card
    for part in key.split("."):
        value = value[part]
    return value


def ten_figures(card: dict[str, Any]) -> list[tuple[str, str]]:
    """The ten figures that matter: title and formatted value."""
    rows = []
    for title, key, form in TEN:
        value = figure(card, key)
        if value is None and key == "points.anees":  # a free network: only fitted points can be compared
            title, value = f"{title}, after the fit", figure(card, "points.anees_fitted")
        said = "not measured" if value is None else form.format(value)
        if key == "lengths.check_error_mm" and any(abs(bar.get("en") or 0) > 1 for bar in card["lengths"]["bars"]):
            said += ", FAILED"
        rows.append((title, said))
    return rows


def plain(value: Any) -> Any:
    """The same as JSON can hold it: no NumPy, and null for a number that is not one."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
