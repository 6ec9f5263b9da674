"""The one way from frames to results: detect, calibrate, reconstruct. Everybody who measures calls it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature

from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Frame
from testfield.detect.detect import detect as detect_frame
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.blame import blamed
from testfield.measure.calibrator import calibrated_by_files, calibrated_by_program
from testfield.measure.detector import by_program, from_files
from testfield.measure.outside import Program, Results
from testfield.measure.recipe import Algorithm, Recipe
from testfield.measure.reconstructor import points_by_program, points_from_files
from testfield.measure.results import recipe_at
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
    if not isinstance(seen, Observations):
        recipe = recipe_at(recipe, seen)
    observations = seen if isinstance(seen, Observations) else detect_all(seen, field, recipe)
    calibration = calibrate(observations, field, recipe)
    return Measured(observations, calibration, reconstruct(observations, calibration, field, recipe))


def detect_all(frames: Sequence[Frame], field: Field, recipe: Recipe) -> Observations:
    """Observations of all frames together."""
    return Observations.join([detect(frame, field, recipe) for frame in frames], tuple(f.station for f in frames))


def detect(frame: Frame, field: Field, recipe: Recipe) -> Observations:
    """Observations of one frame, by whatever the recipe detects with; a covariance need not be stated."""
    recipe.prepare()
    own = recipe.detector
    if isinstance(own, Program):
        return taken_observations(by_program(frame, field, own), own.name)
    if isinstance(own, Results):
        return taken_observations(from_files(frame, field, own), str(own.folder))
    if own is not None:
        with blamed("detectors", own.name):
            return taken_observations(find("detectors", own.name)(frame, field, **own.options), own.name)
    parts = {"finder": _part("finders", recipe.finder), "decoder": _part("decoders", recipe.decoder)}
    given = {name: part for name, part in parts.items() if part is not None}
    # Whose crash it is cannot be told from where it surfaces: the part that is somebody's own is named.
    blame = next(((f"{name}s", getattr(recipe, name).name) for name in given), ("centroids", recipe.centroid.name))
    with blamed(*blame):
        found = detect_frame(
            frame, field, recipe.centroid.name, recipe.smallest_diameter_px, recipe.centroid.options, **given
        )
        return taken_observations(found, recipe.centroid.name)


def _part(stage: str, part: Algorithm | None) -> partial | None:
    return None if part is None else partial(find(stage, part.name), **part.options)


def calibrate(observations: Observations, field: Field, recipe: Recipe) -> Calibration:
    """Cameras, exterior orientations and boards, with as much of a covariance as the calibrator states.

    Raises `TestfieldError` where a calibrator cannot do the field.
    """
    recipe.prepare()
    observations, field = by_time(observations, field)
    own = recipe.calibrated_by
    if isinstance(own, Program):
        return taken_calibration(calibrated_by_program(observations, field, own), own.name)
    if own is not None:
        return taken_calibration(calibrated_by_files(observations, field, own), str(own.folder))
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
    recipe.prepare()
    own, method = recipe.points_from, recipe.reconstructor
    if isinstance(own, Results):
        return taken_points(points_from_files(own), str(own.folder))
    observations, field = by_time(weighed_by(observations, calibration), field)
    if own is not None:
        return taken_points(points_by_program(observations, calibration, field, own), own.name)
    with blamed("reconstructors", method.name):
        found = find("reconstructors", method.name)(observations, calibration, field, **method.options)
        return taken_points(found, method.name)


def takes_cameras(calibrator: str) -> bool:
    """Whether a calibrator can do several cameras."""
    return "cameras" in signature(find("calibrators", calibrator)).parameters
