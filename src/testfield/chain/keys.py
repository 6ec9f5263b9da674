"""What each stage depends on: one digest of all of it, computed without making anything.

A file of a run is made again when its key has changed. `chain/stages.py` asks for the keys of a run; a test asks for
those of every change that a scene's schema allows. Other stages' files enter by the digests of their bytes.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace

from testfield.chain.recipe import recipe_of
from testfield.registry import module_of
from testfield.scene.exposure import sensor_of
from testfield.scene.schema import SceneFile
from testfield.scene.world import World
from testfield.store.code import code_digest
from testfield.store.digests import digest
from testfield.targets.field import Field


@dataclass(frozen=True)
class RenderKeys:
    """Keys of the light that all views of the fast mode share, and of each station's radiance by its name."""

    light: str
    images: dict[str, str]


def render_keys(scene: SceneFile, world: World) -> RenderKeys:
    """Keys of `radiance/light.npz` and of every `radiance/STATION.exr`."""
    settings = scene.render
    renderers = ("view", "irradiance", "stage")
    modules = [*(f"testfield.render.{name}" for name in renderers), "testfield.seeds"]
    code = code_digest(*modules, module_of("lenses", world.interior.model))
    codes = world.field.codes or world.field.bits
    shapes = (world.panels, world.marks, world.dirt, world.prints, codes, world.meshes)
    materials = (world.retro, world.gloss, world.luminous_radiance)
    lights = (world.lights, world.point_lights, world.ambient_radiance, world.sky)
    surroundings = (shapes, lights, materials)
    # Only what is sampled depends on how far and with which random numbers.
    sampling = (settings.noise_target, settings.most_samples, world.seed) if world.gloss else ()
    device = os.environ.get("TESTFIELD_VARIANT", "") + os.environ.get("TESTFIELD_LLVM_TARGET", "")
    light_key = digest(code, device, surroundings, settings.light_spacing_mm, settings.light_paths, world.seed)
    fast = settings.mode == "fast"
    keys = {}
    for k, name in enumerate(world.station_name):
        lens = (world.interior, world.psf_sigma_px, world.optics, world.flash)
        view = (lens, world.camera_from_world[slice(k, k + 1)], world.motion if world.motion.moves else None)
        how = (
            (light_key, settings.cells, settings.blur_shots, sampling, world.seed if world.flash else 0)
            if fast
            else (surroundings, settings.samples, world.seed)
        )
        keys[name] = digest(code, device, settings.mode, view, how)
    return RenderKeys(light_key, keys)


def pipeline_code() -> str:
    """Digest of the pipeline that calls detector, calibrator and reconstructor, without what it calls."""
    return code_digest(
        "testfield.measure.pipeline", without=("testfield.detect", "testfield.calibrate", "testfield.reconstruct")
    )


def lens_modules(scene: SceneFile) -> list[str]:
    """The modules of the lens models that a scene's cameras have and that it calibrates."""
    calibrated = recipe_of(scene).lens
    models = {camera.lens for camera in scene.cameras or (scene.camera,)} | ({calibrated} if calibrated else set())
    return sorted(module_of("lenses", name) for name in models)


def truth_modules(scene: SceneFile, world: World) -> list[str]:
    """The modules that make the truth of a scene."""
    return ["testfield.scene.build", "testfield.scene.truth", *lens_modules(scene), *board_modules(world.field)]


def board_modules(field: Field) -> list[str]:
    """The modules of the kinds of boards in a field."""
    kinds = {board.pattern.kind for board in field.boards if board.pattern is not None}
    return sorted(module_of("boards", kind) for kind in kinds)


def expose_key(scene: SceneFile, station: str, radiance: str, sensor_seed: int | None = None) -> str:
    """Key of a station's frame, from radiance of these bytes, by a sensor whose fixed patterns are of a seed of their
    own where it is not the only one."""
    noise = scene.seed if scene.noise_seed is None else scene.noise_seed
    seeds = (noise, scene.seed if sensor_seed is None else sensor_seed)
    return digest(code_digest("testfield.sensor.expose"), radiance, sensor_of(scene), seeds, station)


def detect_key(scene: SceneFile, field: Field, frames: list[str]) -> str:
    """Key of `observations.parquet`, from frames and their sheets of these bytes."""
    from testfield.detect.detect import ROUGH

    recipe = recipe_of(scene)
    modules = {module_of("centroids", name) for name in (recipe.centroid.name, ROUGH)}
    code = pipeline_code() + code_digest("testfield.detect.detect", *sorted(modules), *board_modules(field))
    return digest(code, frames, without_cameras(field), recipe.centroid, recipe.smallest_diameter_px)


def without_cameras(field: Field) -> Field:
    """What detection and reconstruction use of a field sheet: which camera it was, only the calibration asks."""
    return replace(field, cameras=(), rigs=())


def calibrate_key(scene: SceneFile, field: Field, observations: str) -> str:
    """Key of `calibration.json`, from observations of these bytes."""
    recipe = recipe_of(scene)
    modules = [*lens_modules(scene), *board_modules(field)]
    code = pipeline_code() + code_digest(module_of("calibrators", recipe.calibrator.name), *modules)
    return digest(code, observations, field, recipe.calibrator)


def reconstruct_key(scene: SceneFile, field: Field, observations: str, calibration: str) -> str:
    """Key of `points.parquet`, from observations and a calibration of these bytes."""
    method = recipe_of(scene).reconstructor
    modules = [*lens_modules(scene), *board_modules(field)]
    code = pipeline_code() + code_digest(module_of("reconstructors", method.name), *modules)
    return digest(code, observations, calibration, without_cameras(field), method)


def score_key(scene: SceneFile, world: World, measured: list[str], times: Mapping[str, float]) -> str:
    """Key of `scorecard.json`, from measured files of these bytes, and the times that it repeats."""
    code = code_digest("testfield.score.scorecard", *truth_modules(scene, world))
    return digest(code, measured, scene.model_dump(), world.meshes, times)


def report_key(scene: SceneFile, world: World, files: list[str], certificate: str) -> str:
    """Key of `report.html`, from a run's files and a certificate of these bytes (empty for none)."""
    code = code_digest("testfield.report.page", *truth_modules(scene, world))
    return digest(code, files, scene.model_dump(), world.meshes, certificate)
