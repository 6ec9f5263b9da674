"""What a comparison measures of one scene, one draw of noise and one recipe: the scorecard, times, and every centre."""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.evaluate.measured import flat, frames_of
from testfield.measure.pipeline import calibrate, detect, reconstruct
from testfield.score.detection import DetectionScore, score_detection
from testfield.score.scorecard import plain, score_measured

TRUTH, BROKEN = "the truth itself", "broken on purpose"
SHIFT_PX = 0.5
"""By which the broken one's centres are off in x: what half a pixel's mistake in conventions does."""


def compared_row(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """One row: the scorecard by its paths; `time_detect_s`, `time_calibrate_s`, `time_reconstruct_s`; and as lists
    `station`, `mark`, `dx_px`, `dy_px`, the error of every centre.

    With the option `sanity` the centres are the true ones, or broken: such a row has figures of detection alone. Raises
    `TestfieldError` where the case has no scene, or its images do not determine the result.
    """
    if run is None:
        raise TestfieldError("this case has no scene to measure", str(case.labels), "give it one")
    recipe = case.recipe or recipe_of(run.scene)
    recipe.check(recipe.name)
    frames = frames_of(case, run)
    begun = time.perf_counter()
    seen = Observations.join([detect(frame, run.field, recipe) for frame in frames], run.stations)
    detected = time.perf_counter()
    seen = run.truth.by_cameras(seen)
    if "sanity" in case.options:
        score = _scored(_sanity(seen, run, case.options["sanity"]), run)
        return [flat(plain({"detection": score.card()})) | _centres(score)]
    calibration = calibrate(seen, run.field, recipe)
    calibrated = time.perf_counter()
    points = reconstruct(seen, calibration, run.field, recipe)
    ended = time.perf_counter()
    score = _scored(seen, run)
    card = score_measured(
        run.world,
        run.views,
        seen,
        calibration,
        points,
        cameras=run.truth.cameras,
        rigs=run.scene.rigs,
        detection=score,
    )
    times = {
        "time_detect_s": detected - begun,
        "time_calibrate_s": calibrated - detected,
        "time_reconstruct_s": ended - calibrated,
    }
    return [flat(plain(card)) | times | _centres(score)]


def _scored(seen: Observations, run: Run) -> DetectionScore:
    return score_detection(run.world, run.views, seen.at_times(run.world.field.moving))


def _centres(score: DetectionScore) -> dict[str, Any]:
    return {
        "station": score.station.tolist(),
        "mark": score.mark.tolist(),
        "dx_px": score.error_px[:, 0].tolist(),
        "dy_px": score.error_px[:, 1].tolist(),
    }


def _sanity(seen: Observations, run: Run, kind: str) -> Observations:
    """Observations whose centres are the true ones, or those shifted."""
    score = _scored(seen, run)
    xy = seen.xy_px.copy()
    xy[score.row] -= score.error_px
    if kind == BROKEN:
        xy[score.row] += [SHIFT_PX, 0.0]
    status = np.full(len(xy), "left out", object)
    status[score.row] = MEASURED
    return replace(seen, xy_px=xy, status=status)
