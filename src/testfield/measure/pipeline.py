"""The one way from frames to results: detect, calibrate, reconstruct. Everybody who measures calls it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from inspect import signature

from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Frame
from testfield.detect.detect import detect as detect_frame
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.blame import blamed
from testfield.measure.recipe import Recipe
from testfield.measure.stated import taken_calibration, taken_observations, taken_points
from testfield.measure.weights import calibrated, weighed_by
from testfield.reconstruct.points import Points
from testfield.registry import find
from testfield.targets.field import Field


@dataclass(frozen=True)
class Measured:
    """What frames gave: observations, the calibration, points of targets that belong to no board."""

    observations: Observations
    calibration: Calibration
    points: Points


def measure(seen: Observations | Sequence[Frame], field: Field, recipe: Recipe) -> Measured:
    """Everything that a recipe makes of frames, or of observations that are there already.

    `field` is what the measuring side is told, cameras included. Raises `TestfieldError` where the frames or the field
    do not determine the result.
    """
    observations = seen if isinstance(seen, Observations) else detect_all(seen, field, recipe)
    calibration = calibrate(observations, field, recipe)
    return Measured(observations, calibration, reconstruct(observations, calibration, field, recipe))


def detect_all(frames: Sequence[Frame], field: Field, recipe: Recipe) -> Observations:
    """Observations of all frames together."""
    return Observations.join([detect(frame, field, recipe) for frame in frames], tuple(f.station for f in frames))


def detect(frame: Frame, field: Field, recipe: Recipe) -> Observations:
    """Observations of one frame; a covariance need not be stated."""
    name = recipe.centroid.name
    with blamed("centroids", name):
        found = detect_frame(frame, field, name, recipe.smallest_diameter_px, recipe.centroid.options)
        return taken_observations(found, name)


def calibrate(observations: Observations, field: Field, recipe: Recipe) -> Calibration:
    """Cameras, exterior orientations and boards, with as much of a covariance as the calibrator states.

    Raises `TestfieldError` where a calibrator cannot do the field.
    """
    observations, field = by_time(observations, field)
    name, options = recipe.calibrator.name, dict(recipe.calibrator.options)
    cameras = tuple(replace(camera, lens=recipe.lens or camera.lens) for camera in field.cameras)
    if not cameras:
        raise TestfieldError(
            "the field sheet lists no camera", "field.json, cameras", "list the cameras that took the images"
        )
    options = {"lens": cameras[0].lens, "hold": recipe.hold} | options
    if len(cameras) > 1 or field.rigs:
        if not takes_cameras(name):
            raise TestfieldError(
                f"'{name}' calibrates one camera, and the field sheet lists {len(cameras)}",
                "measure.calibrator",
                "choose one that takes several, as stitched",
            )
        options["cameras"] = cameras
    function = find("calibrators", name)
    with blamed("calibrators", name):
        return calibrated(
            observations,
            lambda seen: taken_calibration(function(seen, field, *cameras[0].size_px, **options), name),
        )


def by_time(observations: Observations, field: Field) -> tuple[Observations, Field]:
    """Observations and field in which a target that moves is another one at every time."""
    times = 1 + max(observations.times, default=0)
    return observations.at_times(field.moving), field.at_times(times)


def reconstruct(observations: Observations, calibration: Calibration, field: Field, recipe: Recipe) -> Points:
    """Targets that belong to no board, with their joint covariance where the reconstructor states one."""
    method = recipe.reconstructor
    observations, field = by_time(weighed_by(observations, calibration), field)
    with blamed("reconstructors", method.name):
        found = find("reconstructors", method.name)(observations, calibration, field, **method.options)
        return taken_points(found, method.name)


def takes_cameras(calibrator: str) -> bool:
    """Whether a calibrator can do several cameras."""
    return "cameras" in signature(find("calibrators", calibrator)).parameters
