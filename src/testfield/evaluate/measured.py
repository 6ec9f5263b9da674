"""What a case measures if nobody says otherwise: its run's images, by its recipe, against the truth."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from testfield.camera.images import Frame, Radiance
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.measure.pipeline import Measured, detect, measure
from testfield.measure.results import recipe_at
from testfield.scene.exposure import sensor_of
from testfield.score.scorecard import plain, scorecard
from testfield.sensor.expose import expose


def scorecard_row(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """One row: every number and text of the scorecard by its path, `points.rmse_mm`.

    Images are rendered once for all cases of a scene; noise and recipe are the case's own. Raises `TestfieldError`
    where the case has no scene, or its images do not determine the result.
    """
    if run is None:
        raise TestfieldError("this case has no scene to measure", str(case.labels), "give it one, or a work of its own")
    recipe = case.recipe or recipe_of(run.scene)
    recipe.check(recipe.name)
    frames = frames_of(case, run)
    recipe = recipe_at(recipe, frames)
    seen = Observations.join([detect(frame, run.field, recipe) for frame in frames], run.stations)
    found = measure(run.truth.by_cameras(seen), run.field, recipe)
    return [flat(plain(_scorecard(found, run)))]


def _scorecard(found: Measured, run: Run) -> dict[str, Any]:
    with TemporaryDirectory() as folder:
        observations, calibration, points = (Path(folder) / name for name in ("o.parquet", "c.json", "p.parquet"))
        found.observations.save(observations)
        found.calibration.save(calibration)
        found.points.save(points)
        return scorecard(
            run.world, run.views, observations, calibration, points, cameras=run.truth.cameras, rigs=run.scene.rigs
        )


def flat(card: dict[str, Any], before: str = "") -> dict[str, Any]:
    """The numbers, texts and truths of nested tables by their path, joined by dots; lists do not come along."""
    row: dict[str, Any] = {}
    for name, value in card.items():
        if isinstance(value, dict):
            row |= flat(value, f"{before}{name}.")
        elif not isinstance(value, list):
            row[before + name] = value
    return row


def frames_of(case: Case, run: Run) -> list[Frame]:
    """The run's frames, or those that the case's noise gives."""
    run_stage(run, "render")
    if case.noise_seed is None:
        run_stage(run, "expose")
        return [Frame.load(run.need(f"frames/{name}.png", "expose"), name) for name in run.stations]
    return [
        expose(
            Radiance.load(run.need(f"radiance/{name}.exr", "render")),
            sensor_of(part.scene),
            part.sensor_seed,
            noise_seed=case.noise_seed,
        )
        for part, _, _, name in run.truth.images()
    ]
