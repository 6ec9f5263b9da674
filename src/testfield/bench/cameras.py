"""Several cameras together against each one alone, on the same images of a run."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.one_of_several import of_camera
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.pipeline import measure
from testfield.score.camera import score_camera
from testfield.score.points import score_points
from testfield.targets.field import Field


def together_and_alone(run: Run) -> list[dict[str, Any]]:
    """Of every camera two rows, `together` with the others and `alone`: error at the image's worst corner and where
    there are data, with what is stated of the latter, NEES of the interior orientation; and the RMSE of check points.

    A camera that cannot be calibrated alone has a row that says why. Raises `TestfieldError` for a run of one camera.
    """
    observations = Observations.load(run.need("observations.parquet", "detect"))
    joint = Calibration.load(run.need("calibration.json", "calibrate"))
    if not joint.more_cameras:
        raise TestfieldError("this run has one camera", str(run.folder), "give the run of a scene with several")
    rows = []
    whole = measure(observations, run.field, recipe_of(run.scene))
    rmse = score_points(run.world, whole.calibration, whole.points).card()["rmse_mm"]
    for k, name in enumerate(joint.camera_names):
        world = run.truth.cameras[name]
        rows.append(_row(name, "together", score_camera(world, of_camera(whole.calibration, k))) | {"rmse_mm": rmse})
        try:
            seen, field = only(observations, run.field, name)
            found = measure(seen, field, recipe_of(run.scene))
            points = score_points(run.world, found.calibration, found.points).card()["rmse_mm"]
            rows.append(_row(name, "alone", score_camera(world, found.calibration)) | {"rmse_mm": points})
        except TestfieldError as error:
            rows.append({"camera": name, "calibrated": "alone", "failed": error.what})
    return rows


def only(observations: Observations, field: Field, camera: str) -> tuple[Observations, Field]:
    """What one camera saw, and the field sheet without the others; a bar that moves is its bar at each time."""
    times = 1 + max(observations.times, default=0)
    observations, field = observations.at_times(field.moving), field.at_times(times)
    images = np.array([name == camera for name in observations.cameras])
    number = np.cumsum(images) - 1
    rows = observations.take(images[observations.station])
    names = tuple(name for name, own in zip(observations.stations, images, strict=True) if own)
    alone = replace(rows, stations=names, station=number[rows.station], cameras=(), places=(), times=())
    cameras = tuple(one for one in field.cameras if one.name == camera)
    return alone, replace(field, cameras=cameras, rigs=())


def _row(name: str, how: str, card: dict[str, Any]) -> dict[str, Any]:
    keys = ("corner_error_px", "imaging_error_px", "imaging_u_px", "interior_anees")
    return {"camera": name, "calibrated": how} | {key: card[key] for key in keys}


def lines(figures: dict[str, Any]) -> Iterator[str]:
    """A table of what `together_and_alone` found, under "cameras"."""
    titles = f"{'corner, px':>11}{'in images, px':>15}{'stated u':>10}{'NEES':>7}{'RMSE, mm':>10}"
    yield f"{'camera':<12}{'calibrated':<12}{titles}"
    for row in figures["cameras"]:
        head = f"{row['camera']:<12}{row['calibrated']:<12}"
        if "failed" in row:
            yield f"{head}  {row['failed']}"
            continue
        yield (
            f"{head}{row['corner_error_px']:>11.4f}{row['imaging_error_px'] or float('nan'):>15.4f}"
            f"{row['imaging_u_px'] or float('nan'):>10.4f}{row['interior_anees']:>7.2f}{row['rmse_mm']:>10.4f}"
        )
