"""The two stages that make images: radiance of every station, and digital frames of it."""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from testfield.camera.images import Radiance
from testfield.chain.belongs import exposed_world, rendered_world, world_of
from testfield.chain.frame_work import expose_one
from testfield.chain.keys import (
    RenderKeys,
    expose_key,
    render_keys,
)
from testfield.chain.progress import bar
from testfield.chain.run import Run
from testfield.chain.stage_work import Made, each_item
from testfield.errors import TestfieldError
from testfield.scene.parts import ScenePart
from testfield.scene.world import World
from testfield.seeds import seed_of
from testfield.store.atomic import part_path
from testfield.store.digests import file_digest

if TYPE_CHECKING:
    from testfield.render.irradiance import Irradiance
    from testfield.render.stage import Stage
    from testfield.render.view import Making


def render(run: Run) -> Made:
    """Radiance of every station, and the light on every panel that they share."""
    shown, todo = rendered_world(run.scene), []
    for part, world in zip(run.truth.parts, run.truth.worlds, strict=True):
        made_from = render_keys(part.scene, world)
        stale = []
        for k, name in enumerate(world.station_name):
            if run.ledger.fresh(f"radiance/{name}.exr", made_from.images[name]):
                run.ledger.shows(f"radiance/{name}.exr", shown)
            else:
                stale.append(k)
        if stale:
            todo.append((part, world, made_from, stale))
    count = sum(len(stale) for *_, stale in todo)
    if count:
        with bar("render", count, "views") as move:
            for part, world, made_from, stale in todo:
                _render_part(run, part, world, made_from, stale, move)
    return count, len(run.stations)


def _render_part(
    run: Run,
    part: ScenePart,
    world: World,
    made_from: RenderKeys,
    stale: list[int],
    move: Callable[[float], None],
) -> None:
    """Radiance of those images of a part that are `stale`."""
    settings, keys, shown = run.scene.render, made_from.images, rendered_world(run.scene)
    light_file = f"radiance/light-t{part.time:02d}.npz" if part.time else "radiance/light.npz"

    from testfield.render.irradiance import Irradiance, compute_irradiance
    from testfield.render.stage import build_stage
    from testfield.render.view import fast_carries

    stage = build_stage(world)
    light = Irradiance.even(len(world.panels), 0.0)  # not asked for where every image is path traced
    if settings.mode == "fast" and fast_carries(world):
        seed = seed_of(world.seed, "light") & 0x7FFFFFFF
        with bar("light", 1, "scene") as lighten:
            run.ledger.make(
                light_file,
                made_from.light,
                lambda path: compute_irradiance(
                    stage, settings.light_spacing_mm, settings.light_paths, seed, lighten
                ).save(path),
            )
        light = Irradiance.load(run.folder / light_file)
    for k, written, making in _images(run, stage, light, stale, move):
        name = world.station_name[k]
        run.ledger.place({f"radiance/{name}.exr": written}, keys[name], world=shown)
        run.ledger.note(images=run.ledger.notes.get("images", {}) | {name: asdict(making)})


def _images(
    run: Run, stage: "Stage", light: "Irradiance", stale: list[int], move: Callable[[float], None]
) -> Iterator[tuple[int, Path, "Making"]]:
    """Each of the stations `stale`, the part of a file that holds its image, and how that was made."""
    from testfield.render.view import FAST, Making, fast_carries, render_reference, render_view
    from testfield.render.views import fast_views

    settings, world = run.scene.render, stage.world
    seeds = [seed_of(world.seed, f"path/{world.station_name[k]}") & 0x7FFFFFFF for k in stale]
    keep = partial(_written, run.folder / "radiance")
    if settings.mode == "fast" and fast_carries(world) and world.gloss is None:
        parts = fast_views(stage, light, stale, seeds, settings.cells, settings.blur_shots, keep, move)
        for k, part in zip(stale, parts, strict=True):
            yield k, part, Making(FAST)
        return
    for k, seed in zip(stale, seeds, strict=True):
        if settings.mode == "fast":
            image, making = render_view(
                stage,
                light,
                k,
                settings.cells,
                settings.noise_target,
                settings.most_samples,
                seed,
                move,
                settings.blur_shots,
            )
        else:
            image, making = render_reference(stage, k, settings.samples, seed, move)
        yield k, keep(image), making


def _written(folder: Path, image: Radiance) -> Path:
    """The part of a file that holds an image."""
    part = part_path(folder / f"{image.station}.exr")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        image.save(part)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return part


def expose(run: Run) -> Made:
    """A digital frame of every station. Raises `TestfieldError` where somebody has put one of their own."""
    from testfield.scene.exposure import sensor_of

    refuse_frames_of_others(run)
    work = []
    for part, _, _, name in run.truth.images():
        scene = part.scene
        sensor, size = sensor_of(scene), (scene.camera.height_px, scene.camera.width_px)
        source = run.need(f"radiance/{name}.exr", "render")
        key = expose_key(scene, name, file_digest(source), part.sensor_seed)
        pair = frame_names(name)
        rendered = world_of(run, [f"radiance/{name}.exr"])
        world = exposed_world(run.scene, rendered) if rendered else ""
        if all(run.ledger.fresh(file, key) for file in pair):
            for file in pair:
                run.ledger.shows(file, world)
        else:
            seeds = (part.sensor_seed, scene.seed if scene.noise_seed is None else scene.noise_seed)
            work.append((source, run.folder / pair[0], size, sensor, seeds, pair, key, world))
    for parts, key, world in each_item(run, "expose", expose_one, work, "frames"):
        run.ledger.place(parts, key, world=world)
    return len(work), len(run.stations)


def frame_names(station: str) -> tuple[str, str]:
    """A station's image in a run's folder, and its sensor's sheet."""
    return f"frames/{station}.png", f"frames/{station}.json"


def frames_of_others(run: Run) -> list[str]:
    """Images and sensor sheets in frames/ that are sound and were not made by this run.

    Where the ledger was damaged nobody knows yet; a file that is made again with other bytes is refused when it comes.
    """
    if run.ledger.damaged:
        return []
    return [file for name in run.stations for file in frame_names(name) if run.ledger.foreign(file)]


def refuse_frames_of_others(run: Run) -> None:
    """Raise `TestfieldError` where a frame of somebody's own lies in the place of one that would be made."""
    for file in frames_of_others(run):
        raise TestfieldError(
            "this file was not made by the run, or was changed since",
            str(run.folder / file),
            f"`testfield detect {run.folder}` and the stages after it use it; for a rendered one move it away",
        )
