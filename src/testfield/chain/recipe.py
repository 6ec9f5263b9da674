"""The recipe that a scene asks for."""

from typing import Any

from testfield.measure.recipe import Algorithm, Recipe
from testfield.scene.schema import SceneFile


def recipe_of(scene: SceneFile) -> Recipe:
    """The recipe in a scene's [measure]."""
    asked = scene.measure
    options: dict[str, Any] = {"hold": asked.hold}
    options |= {"lens": asked.lens} if asked.lens else {}
    options |= {"board": asked.board} if asked.board else {}
    return Recipe(
        name=scene.name,
        centroid=Algorithm(asked.centroid, asked.centroid_options),
        calibrator=Algorithm(asked.calibrator, options | asked.calibrator_options),
        reconstructor=Algorithm(asked.reconstructor, asked.reconstructor_options),
        smallest_diameter_px=asked.smallest_diameter_px,
    )
