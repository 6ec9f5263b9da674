"""What a comparison measures of one setup, one draw of noise and one recipe: scorecard, times, and every error."""

from enum import Enum
from typing import Any

from testfield.calibrate.settled import NOT_CONVERGED
from testfield.camera.images import Frame
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.evaluate.compared_columns import camera_columns, centre_columns, ground_mm, length_columns, point_columns
from testfield.evaluate.failures import KIND, Kind, failure_columns
from testfield.evaluate.known_rows import known_row
from testfield.evaluate.measured import flat, frames_of
from testfield.measure.aside import clocks, spent
from testfield.measure.pipeline import calibrate, detect, reconstruct
from testfield.measure.recipe import Recipe
from testfield.measure.results import recipe_at
from testfield.score.camera import score_boards
from testfield.score.detection import EXPECTED_PX, DetectionScore, score_detection
from testfield.score.points import score_lengths, score_points
from testfield.score.scorecard import plain
from testfield.score.several import score_cameras
from testfield.store.digests import digest
from testfield.store.memory import peak_memory
from testfield.store.threads import one_blas_thread


class Until(Enum):
    """The last stage that is done: whoever compares centres need not calibrate."""

    DETECT = "detect"
    CALIBRATE = "calibrate"
    RECONSTRUCT = "reconstruct"


def compared_row(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """One row: the scorecard by its paths; seconds of each stage (`time_detect_s`, and of the processor
    `cpu_detect_s` ...) and the memory that they took beyond what was there before (`memory_mb`); and as lists every
    error (`compared_columns`).

    Where the recipe fails, at whatever stage, the row says why and at which, and has the figures of the stages before.
    With the option `sanity` it is one of the two rows whose figures are known (`known_rows`). Raises `TestfieldError`
    where the case has no scene, or its images cannot be made.
    """
    if run is None:
        raise TestfieldError("this case has no scene to measure", str(case.labels), "give it one")
    ground = {"ground_mm_per_px": ground_mm(run.world, run.views)}
    if "sanity" in case.options:
        return [known_row(run, case.options["sanity"]) | ground]
    recipe = case.recipe or recipe_of(run.scene)
    recipe.check(recipe.name)
    frames = _frames(case, run)
    asked = recipe
    try:
        recipe = recipe_at(recipe, frames)
    except TestfieldError as error:  # results of other images are a failure of the recipe, which missed everything
        return [_nothing_found(run, None) | failure_columns(error, Until.DETECT.value) | ground]
    until = Until(case.options.get("until", Until.RECONSTRUCT.value))
    with one_blas_thread():
        _warm_up(asked, frames, run, recipe, until)
        with peak_memory() as memory:
            row = _measured(frames, run, recipe, until)
    return [row | ground | {"memory_mb": memory.mb}]


def _measured(frames: list[Frame], run: Run, recipe: Recipe, until: Until) -> dict[str, Any]:
    """The row's figures, as far as the recipe comes."""
    row: dict[str, Any] = {}
    spent()  # what a case that failed left behind is none of this one's
    stage, begun = Until.DETECT, clocks()

    def done() -> None:
        nonlocal begun
        ours = spent()
        for clock, now in clocks().items():
            row[f"{clock}_{stage.value}_s"] = now - begun[clock] - ours[clock]
        if ours["time"] > 0:
            row["time_naming_s"] = ours["time"]
        begun = clocks()

    score: DetectionScore | None = None
    try:
        seen = Observations.join([detect(frame, run.field, recipe) for frame in frames], run.stations)
        done()
        seen = run.truth.by_cameras(seen)
        score = score_detection(run.world, run.views, seen.at_times(run.world.field.moving))
        row |= flat(plain({"detection": score.card()})) | centre_columns(score, run.views)
        if until is Until.DETECT:
            return row
        stage, begun = Until.CALIBRATE, clocks()
        calibration = calibrate(seen, run.field, recipe)
        done()
        cameras = run.truth.cameras or {"": run.world}
        card = {"calibration": {"method": calibration.method} | score_cameras(cameras, calibration)}
        row |= flat(plain(card | {"boards": score_boards(run.world, calibration)})) | camera_columns(
            cameras, calibration
        )
        if any(NOT_CONVERGED in note for note in calibration.notes):
            row[KIND] = Kind.NOT_CONVERGED.value
        if until is Until.CALIBRATE:
            return row
        stage, begun = Until.RECONSTRUCT, clocks()
        points = reconstruct(seen, calibration, run.field, recipe)
        done()
        of_points = score_points(run.world, calibration, points)
        row |= point_columns(of_points) | length_columns(of_points)
        card = {"points": {"method": points.method} | of_points.card()}
        card |= {"lengths": score_lengths(run.world, calibration, points)}
        return row | flat(plain(card))
    except MemoryError:
        raise
    except Exception as error:  # whatever somebody's algorithm does, the others are compared
        return row | _nothing_found(run, score) | failure_columns(error, stage.value)


def _nothing_found(run: Run, score: DetectionScore | None) -> dict[str, Any]:
    """Where detection itself failed, all that was expected was missed."""
    if score is not None:
        return {}
    expected = int(((run.views.visible == 1) & (run.views.diameter_px >= EXPECTED_PX)).sum())
    return {"detection.expected": expected, "detection.missed": expected, "detection.found_fraction": 0.0}


_kept: tuple[tuple[str, int | None], list[Frame]] | None = None
_warm: set[str] = set()


def _frames(case: Case, run: Run) -> list[Frame]:
    """The frames of a case; those of the last one are kept, for all recipes meet the same."""
    global _kept
    key = (str(run.folder), case.noise_seed)
    if _kept is None or _kept[0] != key:
        _kept = None
        _kept = key, frames_of(case, run)
    return _kept[1]


def _warm_up(asked: Recipe, frames: list[Frame], run: Run, recipe: Recipe, until: Until) -> None:
    """Do all that will be timed once before, where this process has not yet done it by the recipe `asked` for: what is
    loaded and compiled at first use is nobody's time. What fails fails again where failures are counted."""
    key = digest(asked, until.value)
    if key not in _warm:
        _warm.add(key)
        _measured(frames, run, recipe, until)
