"""What a case of the study of grey methods renders and measures: exposures of one scene, or runs of the design."""

from dataclasses import replace
from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.chain.trials import reexposed
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.measure.pipeline import measure
from testfield.score.detection import score_detection
from testfield.score.points import score_points
from testfield.seeds import seed_of
from testfield.targets.field import Field
from testfield.uncertainty.certificates import draw_certificates
from testfield_studies.truth import exact_calibration


def expose_again(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """Errors of every dot's centre against the truth in some exposures of one rendered scene."""
    assert run is not None
    options = case.options
    run_stage(run, "render")
    run = _with(run, options["read_noise_e"], options["centroid"])
    rows = []
    for number in options["exposures"]:
        found = reexposed(run, seed_of(run.scene.seed, f"grey exposure/{number}"))
        score = score_detection(run.world, run.views, found)
        for station, mark, (x, y) in zip(score.station, score.mark, score.error_px, strict=True):
            rows.append(
                {
                    "exposure": number,
                    "station": int(station),
                    "mark": int(mark),
                    "error_x_px": float(x),
                    "error_y_px": float(y),
                }
            )
    return rows


def measure_runs(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """Check points' errors in those runs of the design that share one picture.

    Each has noise and a workshop of its own: `bar_off_mm` is how much longer its sheet says the bar is than it is. A
    run that cannot be measured gives a row that says why, and no figures. The pictures are not kept: there are
    hundreds of them, and the rows are.
    """
    assert run is not None
    run_stage(run, "render")
    sheet, exact = sheet_of(run.field, case.options), exact_calibration(run.world)
    rows = [_run_row(run, entry, sheet, exact) for entry in case.options["runs"]]
    for name in run.stations:
        (run.folder / f"radiance/{name}.exr").unlink(missing_ok=True)
    return rows


def sheet_of(field: Field, workshop: dict[str, Any]) -> Field:
    """The field sheet with what the workshop is said to be good for."""
    boards = tuple(replace(board, u_xy_mm=workshop["print_mm"]) for board in field.boards)
    bars = tuple(replace(bar, u_length_mm=workshop["bar_mm"]) for bar in field.scale_bars)
    return replace(field, boards=boards, scale_bars=bars, u_scale=1e-6 * workshop["scale_ppm"])


def _run_row(run: Run, entry: dict[str, Any], sheet: Field, exact: Calibration) -> dict[str, Any]:
    row = {key: value for key, value in entry.items() if key != "unit"}
    row |= {f"unit {k}": float(value) for k, value in enumerate(entry["unit"])}
    run = _with(run, entry["read_noise_e"], run.scene.measure.centroid)
    scene, name = run.scene, f"grey run/{entry['run']}"
    figures = {"rmse_mm": np.nan, "worst_mm": np.nan, "measured": 0, "centre_rms_px": np.nan, "bar_off_mm": np.nan}
    try:
        found = reexposed(run, seed_of(scene.seed, f"{name}/noise"))
        error_px = score_detection(run.world, run.views, found).error_px
        figures["centre_rms_px"] = float(np.sqrt((error_px**2).mean())) if len(error_px) else np.nan
        found, sheet = draw_certificates(found, exact, sheet, seed_of(scene.seed, f"{name}/workshop"))
        figures["bar_off_mm"] = sheet.scale_bars[0].length_mm - run.field.scale_bars[0].length_mm
        measured = measure(found, sheet, recipe_of(scene))
        card = score_points(run.world, measured.calibration, measured.points).card()
    except TestfieldError as error:
        return row | figures | {"lost": error.sentence()}
    if card["measured"] < 3:
        return row | figures | {"lost": f"only {card['measured']} check points were measured"}
    return row | figures | {key: card[key] for key in ("rmse_mm", "worst_mm", "measured")} | {"lost": ""}


def _with(run: Run, read_noise_e: float, centroid: str) -> Run:
    """The run with another sensor noise and centroid estimator; its pictures are the same."""
    scene = run.scene
    sensor = scene.sensor.model_copy(update={"read_noise_e": read_noise_e})
    measure = scene.measure.model_copy(update={"centroid": centroid})
    return replace(run, scene=scene.model_copy(update={"sensor": sensor, "measure": measure}))
