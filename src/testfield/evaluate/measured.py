"""What a case measures if nobody says otherwise: its run's images, by its recipe, against the truth."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from testfield.camera.images import Frame, Radiance
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.measure.pipeline import measure
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
    found = measure(_frames(case, run), run.field, recipe)
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("observations.parquet", "calibration.json", "points.parquet")]
        for result, path in zip((found.observations, found.calibration, found.points), paths, strict=True):
            result.save(path)
        return [flat(plain(scorecard(run.world, run.views, *paths)))]


def flat(card: dict[str, Any], before: str = "") -> dict[str, Any]:
    """The numbers, texts and truths of nested tables by their path, joined by dots; lists do not come along."""
    row: dict[str, Any] = {}
    for name, value in card.items():
        if isinstance(value, dict):
            row |= flat(value, f"{before}{name}.")
        elif not isinstance(value, list):
            row[before + name] = value
    return row


def _frames(case: Case, run: Run) -> list[Frame]:
    """The run's frames, or those that the case's noise gives."""
    run_stage(run, "render")
    if case.noise_seed is None:
        run_stage(run, "expose")
        return [Frame.load(run.need(f"frames/{name}.png", "expose"), name) for name in run.stations]
    sensor = sensor_of(run.scene)
    radiance = (Radiance.load(run.need(f"radiance/{name}.exr", "render")) for name in run.stations)
    return [expose(one, sensor, run.scene.seed, noise_seed=case.noise_seed) for one in radiance]
