"""The stages in order. Each keeps what it made as long as everything it was made from is the same."""

import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from testfield.chain.belongs import check_truth, exposed_world, rendered_world, world_of
from testfield.chain.keys import (
    RenderKeys,
    calibrate_key,
    detect_key,
    expose_key,
    reconstruct_key,
    render_keys,
    report_key,
    score_key,
)
from testfield.chain.progress import bar
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.errors import TestfieldError
from testfield.scene.parts import ScenePart
from testfield.scene.world import World
from testfield.seeds import seed_of
from testfield.store.digests import file_digest
from testfield.store.threads import one_blas_thread
from testfield.store.work import each

Made = tuple[int, int]
"""How many of a stage's items were made, and how many there are."""


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
    settings, keys = run.scene.render, made_from.images
    fast, shown = settings.mode == "fast", rendered_world(run.scene)
    light_file = f"radiance/light-t{part.time:02d}.npz" if part.time else "radiance/light.npz"

    from testfield.render.irradiance import Irradiance, compute_irradiance
    from testfield.render.stage import build_stage
    from testfield.render.view import fast_carries, render_reference, render_view

    stage = build_stage(world)
    light = Irradiance.even(len(world.panels), 0.0)  # not asked for where every image is path traced
    if fast and fast_carries(world):
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
    for k in stale:
        name = world.station_name[k]
        seed = seed_of(world.seed, f"path/{name}") & 0x7FFFFFFF
        if fast:
            image, making = render_view(
                stage, light, k, settings.cells, settings.noise_target, settings.most_samples, seed, move,
                settings.blur_shots,
            )  # fmt: skip
        else:
            image, making = render_reference(stage, k, settings.samples, seed, move)
        run.ledger.make(f"radiance/{name}.exr", keys[name], image.save, world=shown)
        run.ledger.note(images=run.ledger.notes.get("images", {}) | {name: asdict(making)})


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
    for parts, key, world in _each(run, "expose", _expose_one, work, "frames"):
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
            "this file was not made by the run, or was changed since", str(run.folder / file),
            f"`testfield detect {run.folder}` and the stages after it use it; for a rendered one move it away",
        )  # fmt: skip


def _expose_one(work: tuple) -> tuple[dict[str, Path], str, str]:
    """Write a frame's two parts; only the process that keeps the ledger puts them in their places."""
    import testfield.sensor.expose as sensor_room
    from testfield.camera.images import Radiance
    from testfield.store.atomic import part_path

    source, target, size, sensor, (sensor_seed, seed), (image, sheet), key, world = work
    part = part_path(target)
    part.parent.mkdir(parents=True, exist_ok=True)
    radiance = Radiance.load(source)
    if (radiance.station, radiance.values.shape) != (source.stem, size):
        raise TestfieldError(
            f"an image of '{radiance.station}' of {radiance.values.shape[1]} x {radiance.values.shape[0]} px, and "
            f"'{source.stem}' of {size[1]} x {size[0]} px is wanted", str(source), "render again",
        )  # fmt: skip
    sensor_room.expose(radiance, sensor, sensor_seed, noise_seed=seed).save(part)
    return {image: part, sheet: part.with_suffix(".json")}, key, world


def detect(run: Run) -> Made:
    """Observations of all frames together."""
    from testfield.detect.observations import Observations

    recipe = recipe_of(run.scene)
    sources = [run.need(f"frames/{name}.png", "expose") for name in run.stations]
    sheets = [run.need(f"frames/{name}.json", "expose") for name in run.stations]
    key = detect_key(run.scene, run.field, [file_digest(path) for path in sources + sheets])
    world = world_of(run, [f"frames/{name}.png" for name in run.stations])
    if run.ledger.fresh("observations.parquet", key):
        run.ledger.shows("observations.parquet", world)
        return 0, 1
    work = [
        (source, name, run.field, recipe, (part.scene.camera.width_px, part.scene.camera.height_px))
        for source, (part, _, _, name) in zip(sources, run.truth.images(), strict=True)
    ]
    parts = list(_each(run, "detect", _detect_one, work, "frames"))
    observations = run.truth.by_cameras(Observations.join(parts, run.stations))
    return int(run.ledger.make("observations.parquet", key, observations.save, world=world)), 1


def _detect_one(work: tuple) -> Any:
    from testfield.camera.images import Frame
    from testfield.measure.pipeline import detect

    source, name, field, recipe, (width, height) = work
    frame = Frame.load(source, name)
    if frame.pixels_dn.shape != (height, width):
        found = f"{frame.pixels_dn.shape[1]} x {frame.pixels_dn.shape[0]}"
        raise TestfieldError(
            f"the image is {found} px and the camera {width} x {height}", str(source), "all frames are of one camera"
        )
    return detect(frame, field, recipe)


def calibrate(run: Run) -> Made:
    """Camera, stations and boards."""
    from testfield.detect.observations import Observations
    from testfield.measure.pipeline import calibrate

    source = run.need("observations.parquet", "detect")
    key = calibrate_key(run.scene, run.field, file_digest(source))

    def write(path: Path) -> None:
        seen = Observations.load(source, run.field, run.truth.largest_px)
        calibrate(seen, run.field, recipe_of(run.scene)).save(path)

    world = world_of(run, ["observations.parquet"])
    return int(run.ledger.make("calibration.json", key, write, [source], world)), 1


def reconstruct(run: Run) -> Made:
    """Scale-bar ends and check targets."""
    from testfield.calibrate.calibration import Calibration
    from testfield.detect.observations import Observations
    from testfield.measure.pipeline import reconstruct

    observations, calibration = run.need("observations.parquet", "detect"), run.need("calibration.json", "calibrate")
    key = reconstruct_key(run.scene, run.field, file_digest(observations), file_digest(calibration))

    def write(path: Path) -> None:
        camera = Calibration.load(calibration)
        seen = Observations.load(observations, run.field, run.truth.largest_px)
        reconstruct(seen, camera, run.field, recipe_of(run.scene)).save(path)

    world = world_of(run, ["observations.parquet", "calibration.json"])
    return int(run.ledger.make("points.parquet", key, write, [observations, calibration], world)), 1


def score(run: Run) -> Made:
    """Everything measured against the truth."""
    from testfield.chain.truth_files import write_truth
    from testfield.score.scorecard import scorecard, write_scorecard

    check_truth(run)
    inputs = [run.need(name, maker) for name, maker in MEASURED]
    write_truth(run)
    times = {
        name: run.ledger.notes.get("time_s", {}).get(name, 0.0) for name in STAGES if name not in ("score", "report")
    }
    key = score_key(run.scene, run.world, [file_digest(path) for path in inputs], times)

    def write(path: Path) -> None:
        observations, calibration, points = inputs
        card = scorecard(
            run.world, run.views, observations, calibration, points, cameras=run.truth.cameras, rigs=run.scene.rigs
        )
        noise = {} if run.scene.noise_seed is None else {"noise_seed": run.scene.noise_seed}
        write_scorecard(card | noise | {"time_s": times}, path)

    return int(run.ledger.make("scorecard.json", key, write, inputs)), 1


def report(run: Run) -> Made:
    """The page for people."""
    from testfield.report.page import write_report

    check_truth(run)
    inputs = [run.need(name, maker) for name, maker in MEASURED] + [run.need("scorecard.json", "score")]
    frames = [run.need(f"frames/{name}.png", "expose") for name in run.stations]
    certificate = run.folder.parent / "certificate.json"
    ruler = file_digest(certificate) if certificate.is_file() else ""
    key = report_key(run.scene, run.world, [file_digest(path) for path in inputs + frames], ruler)

    def write(path: Path) -> None:
        write_report(run.world, run.views, run.scene, run.folder, run.ledger.notes, path, run.truth.cameras)

    with bar("report", 1, "page") as move:
        made = run.ledger.make("report.html", key, write)
        move(1)
    return int(made), 1


MEASURED = (("observations.parquet", "detect"), ("calibration.json", "calibrate"), ("points.parquet", "reconstruct"))
STAGES: dict[str, Callable[[Run], Made]] = {
    "render": render,
    "expose": expose,
    "detect": detect,
    "calibrate": calibrate,
    "reconstruct": reconstruct,
    "score": score,
    "report": report,
}


def run_stage(run: Run, name: str) -> bool:
    """Run one stage and note how long it takes as a whole; returns whether it made anything.

    A stage that made only what was missing leaves the time of its whole as it was; where none is known, the time is
    that of the part in proportion.
    """
    start = time.perf_counter()
    with one_blas_thread():
        made, whole = STAGES[name](run)
    seconds = time.perf_counter() - start
    times = run.ledger.notes.get("time_s", {})
    if made == whole or (made and name not in times):
        run.ledger.note(time_s=times | {name: round(seconds * whole / made, 2)})
    return made > 0


def remarks(run: Run) -> list[str]:
    """What a reader of a run's results should know of its files, one sentence each."""
    own = [f"{file} was not made by this run and is used as it is" for file in frames_of_others(run)]
    return own + stale_inputs(run)


def stale_inputs(run: Run) -> list[str]:
    """Files of a run that were made from another version of what lies beside them now, one sentence each."""
    sentences = []
    for name, maker in (*MEASURED[1:], ("scorecard.json", "score")):
        entry = run.ledger.files.get(name)
        for source, sha in (entry.inputs if entry else {}).items():
            path = run.folder / source
            if path.is_file() and file_digest(path) != sha:
                sentences.append(
                    f"{name} was made from another {source}; renew it with `testfield {maker} {run.folder}`"
                )
    return sentences


def _each(run: Run, title: str, function: Callable, work: list, unit: str) -> Iterable[Any]:
    """Results in order, from several processes where there is enough to do."""
    with bar(title, len(work), unit) as move:
        yield from each(function, work, run.jobs, alone=2, moved=lambda _: move(1))
