"""Drawn observations of several cameras, whose truth is known."""

from conftest import SCENES

from testfield.chain.truth import Truth
from testfield.detect.observations import Observations
from testfield.scene.load import load_scene
from testfield.scene.schema import SceneFile
from testfield.simulate.observations import draw_observations


def fewer(scene: SceneFile, places: int) -> SceneFile:
    """The scene with fewer places of its rig."""
    parts = tuple(part.model_copy(update={"count": places}) for part in scene.stations)
    return scene.model_copy(update={"stations": parts}).in_folder(scene.folder)


def drawn(truth: Truth, seed: int) -> Observations:
    """Observations of all images at the physical bound."""
    each = []
    for part, world, views in zip(truth.parts, truth.worlds, truth.views_of_parts, strict=True):
        seen = draw_observations(part.scene, world, views, seed)
        each += [seen.take(seen.station == k) for k in range(len(world.station_name))]
    return truth.by_cameras(Observations.join(each, truth.world.station_name))


def stereo(places: int) -> tuple[Truth, Observations]:
    """The truth of scenes/stereo_rig.toml with so many places, and what is seen of it."""
    truth = Truth.of(fewer(load_scene(SCENES / "stereo_rig.toml"), places), "stereo_rig")
    return truth, drawn(truth, 3)
