"""The stages in order. Each keeps what it made as long as everything it was made from is the same."""

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from testfield.chain.files import file_digest
from testfield.chain.keys import (
    calibrate_key,
    detect_key,
    expose_key,
    reconstruct_key,
    render_keys,
    report_key,
    score_key,
)
from testfield.chain.progress import bar
from testfield.chain.run import Run
from testfield.errors import TestfieldError
from testfield.seeds import seed_of

Made = tuple[int, int]
"""How many of a stage's items were made, and how many there are."""


def render(run: Run) -> Made:
    """Radiance of every station, and the light on every panel that they share."""
    world, settings = run.world, run.scene.render
    fast = settings.mode == "fast"
    made_from = render_keys(run.scene, world)
    light_key, keys = made_from.light, made_from.images
    stale = [k for k, name in enumerate(run.stations) if not run.ledger.fresh(f"radiance/{name}.exr", keys[name])]
    if not stale:
        return 0, len(keys)

    from testfield.render.irradiance import Irradiance, compute_irradiance
    from testfield.render.stage import build_stage
    from testfield.render.view import fast_carries, render_reference, render_view

    stage = build_stage(world)
    light = Irradiance.even(len(world.panels), 0.0)  # not asked for where every image is path traced
    if fast and fast_carries(world):
        seed = seed_of(world.seed, "light") & 0x7FFFFFFF
        with bar("light", 1, "scene") as move:
            run.ledger.make(
                "radiance/light.npz",
                light_key,
                lambda path: compute_irradiance(
                    stage, settings.light_spacing_mm, settings.light_paths, seed, move
                ).save(path),
            )
        light = Irradiance.load(run.folder / "radiance/light.npz")
    with bar("render", len(stale), "views") as move:
        for k in stale:
            name = run.stations[k]
            seed = seed_of(world.seed, f"path/{name}") & 0x7FFFFFFF
            if fast:
                image, making = render_view(
                    stage, light, k, settings.cells, settings.noise_target, settings.most_samples, seed, move,
                    settings.blur_shots,
                )  # fmt: skip
            else:
                image, making = render_reference(stage, k, settings.samples, seed, move)
            run.ledger.make(f"radiance/{name}.exr", keys[name], image.save)
            run.ledger.note(images=run.ledger.notes.get("images", {}) | {name: asdict(making)})
    return len(stale), len(keys)


def expose(run: Run) -> Made:
    """A digital frame of every station."""
    from testfield.scene.exposure import sensor_of

    scene = run.scene
    sensor = sensor_of(scene)
    work = []
    for name in run.stations:
        source = run.need(f"radiance/{name}.exr", "render")
        key = expose_key(scene, name, file_digest(source))
        target = f"frames/{name}.png"
        if not (run.ledger.fresh(target, key) and run.ledger.fresh(f"frames/{name}.json", key)):
            run.ledger.keep_foreign(target)
            work.append((source, run.folder / target, sensor, scene.seed, target, key))
    for target, key in _each(run, "expose", _expose_one, work, "frames"):
        run.ledger.enter(target, key)
        run.ledger.enter(str(Path(target).with_suffix(".json")), key)
    return len(work), len(run.stations)


def _expose_one(work: tuple) -> tuple[str, str]:
    import testfield.sensor.expose as sensor_room
    from testfield.camera.images import Radiance
    from testfield.chain.files import whole

    source, target, sensor, seed, name, key = work
    frame = sensor_room.expose(Radiance.load(source), sensor, seed)
    with whole(target) as path:
        frame.save(path)
        path.with_suffix(".json").replace(target.with_suffix(".json"))
    return name, key


def detect(run: Run) -> Made:
    """Observations of all frames together."""
    from testfield.detect.observations import Observations

    measure, camera = run.scene.measure, run.scene.camera
    sources = [run.need(f"frames/{name}.png", "expose") for name in run.stations]
    sheets = [run.need(f"frames/{name}.json", "expose") for name in run.stations]
    settings = (measure.centroid, measure.smallest_diameter_px)
    key = detect_key(run.scene, run.field, [file_digest(path) for path in sources + sheets])
    if run.ledger.fresh("observations.parquet", key):
        return 0, 1
    size = (camera.width_px, camera.height_px)
    work = [(source, run.field, *settings, size) for source in sources]
    parts = list(_each(run, "detect", _detect_one, work, "frames"))
    observations = Observations.join(parts, run.stations)
    return int(run.ledger.make("observations.parquet", key, observations.save)), 1


def _detect_one(work: tuple) -> Any:
    from testfield.camera.images import Frame
    from testfield.detect.detect import detect as detect_frame

    source, field, centroid, smallest, (width, height) = work
    frame = Frame.load(source)
    if frame.pixels_dn.shape != (height, width):
        found = f"{frame.pixels_dn.shape[1]} x {frame.pixels_dn.shape[0]}"
        raise TestfieldError(
            f"the image is {found} px and the camera {width} x {height}", str(source), "all frames are of one camera"
        )
    return detect_frame(frame, field, centroid, smallest)


def calibrate(run: Run) -> Made:
    """Camera, stations and boards."""
    from testfield.detect.observations import Observations
    from testfield.registry import find

    source = run.need("observations.parquet", "detect")
    camera, method = run.scene.camera, run.scene.measure.calibrator
    lens, hold = run.scene.measure.lens or camera.lens, run.scene.measure.hold
    options = {"board": run.scene.measure.board} if run.scene.measure.board else {}
    key = calibrate_key(run.scene, run.field, file_digest(source))

    def write(path: Path) -> None:
        observations = Observations.load(source)
        size = (camera.width_px, camera.height_px)
        find("calibrators", method)(observations, run.field, *size, lens, hold, **options).save(path)

    return int(run.ledger.make("calibration.json", key, write, [source])), 1


def reconstruct(run: Run) -> Made:
    """Scale-bar ends and check targets."""
    from testfield.calibrate.calibration import Calibration
    from testfield.detect.observations import Observations
    from testfield.registry import find

    observations, calibration = run.need("observations.parquet", "detect"), run.need("calibration.json", "calibrate")
    method = run.scene.measure.reconstructor
    key = reconstruct_key(run.scene, run.field, file_digest(observations), file_digest(calibration))

    def write(path: Path) -> None:
        found = find("reconstructors", method)(
            Observations.load(observations), Calibration.load(calibration), run.field
        )
        found.save(path)

    return int(run.ledger.make("points.parquet", key, write, [observations, calibration])), 1


def score(run: Run) -> Made:
    """Everything measured against the truth."""
    from testfield.chain.truth_files import write_truth
    from testfield.score.scorecard import scorecard, write_scorecard

    inputs = [run.need(name, maker) for name, maker in MEASURED]
    write_truth(run)
    times = {
        name: run.ledger.notes.get("time_s", {}).get(name, 0.0) for name in STAGES if name not in ("score", "report")
    }
    key = score_key(run.scene, run.world, [file_digest(path) for path in inputs], times)

    def write(path: Path) -> None:
        write_scorecard(scorecard(run.world, run.views, *inputs) | {"time_s": times}, path)

    return int(run.ledger.make("scorecard.json", key, write, inputs)), 1


def report(run: Run) -> Made:
    """The page for people."""
    from testfield.report.page import write_report

    inputs = [run.need(name, maker) for name, maker in MEASURED] + [run.need("scorecard.json", "score")]
    frames = [run.need(f"frames/{name}.png", "expose") for name in run.stations]
    certificate = run.folder.parent / "certificate.json"
    ruler = file_digest(certificate) if certificate.is_file() else ""
    key = report_key(run.scene, run.world, [file_digest(path) for path in inputs + frames], ruler)

    def write(path: Path) -> None:
        write_report(run.world, run.views, run.scene, run.folder, run.ledger.notes, path)

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
    made, whole = STAGES[name](run)
    seconds = time.perf_counter() - start
    times = run.ledger.notes.get("time_s", {})
    if made == whole or (made and name not in times):
        run.ledger.note(time_s=times | {name: round(seconds * whole / made, 2)})
    return made > 0


def stale_inputs(run: Run) -> list[str]:
    """Files of a run that were made from another version of what lies beside them now, one sentence each."""
    sentences = []
    for name, maker in (*MEASURED[1:], ("scorecard.json", "score")):
        entry = run.ledger.files.get(name)
        for source, sha in (entry or {}).get("inputs", {}).items():
            path = run.folder / source
            if path.is_file() and file_digest(path) != sha:
                sentences.append(
                    f"{name} was made from another {source}; renew it with `testfield {maker} {run.folder}`"
                )
    return sentences


def _each(run: Run, title: str, function: Callable, work: list, unit: str) -> Iterable[Any]:
    """Results in order, from several processes where there is enough to do."""
    with bar(title, len(work), unit) as move:
        if run.jobs <= 1 or len(work) <= 2:
            for item in work:
                yield function(item)
                move(1)
            return
        # Spawned, not forked: the renderer's threads do not survive a fork.
        # An interrupt is the parent's to handle; workers would only add their own complaints.
        quiet = (signal.SIGINT, signal.SIG_IGN)
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(run.jobs, context, initializer=signal.signal, initargs=quiet) as pool:
            try:
                for result in pool.map(function, work):
                    yield result
                    move(1)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
