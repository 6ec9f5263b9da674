"""The stages in order. Each keeps what it made as long as everything it was made from is the same."""

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from testfield.chain.files import code_digest, digest, file_digest
from testfield.chain.progress import bar
from testfield.chain.run import Run
from testfield.seeds import seed_of

SEEING = ("targets", "camera")
"""Rooms that every stage computes with."""


def render(run: Run) -> bool:
    """Radiance of every station, and the light on every panel that they share."""
    world, settings = run.world, run.scene.render
    code = code_digest(*SEEING, "render", "scene")
    surroundings = (world.panels, world.marks, world.lights, world.ambient_radiance, world.field.bits)
    light_key = digest(code, surroundings, settings.light_spacing_mm, settings.light_paths, world.seed)
    fast = settings.mode == "fast"
    keys = {}
    for k, name in enumerate(run.stations):
        view = (world.interior, world.camera_from_world[slice(k, k + 1)], world.psf_sigma_px)
        how = (light_key, settings.cells) if fast else (surroundings, settings.samples, world.seed)
        keys[name] = digest(code, settings.mode, view, how)
    stale = [k for k, name in enumerate(run.stations) if not run.ledger.fresh(f"radiance/{name}.exr", keys[name])]
    if not stale:
        return False

    from testfield.render.fast import render_fast
    from testfield.render.irradiance import Irradiance, compute_irradiance
    from testfield.render.path import render_path
    from testfield.render.stage import build_stage

    stage = build_stage(world)
    light_path = run.folder / "radiance/light.npz"
    if fast:
        with bar("light", 1, "scene") as move:
            run.ledger.make(
                "radiance/light.npz",
                light_key,
                lambda path: compute_irradiance(
                    stage,
                    settings.light_spacing_mm,
                    settings.light_paths,
                    seed_of(world.seed, "light") & 0x7FFFFFFF,
                    move,
                ).save(path),
            )
        light = Irradiance.load(light_path)
    with bar("render", len(stale), "views") as move:
        for k in stale:
            name = run.stations[k]
            if fast:
                image = render_fast(stage, light, k, settings.cells, move)
            else:
                image = render_path(stage, k, settings.samples, seed_of(world.seed, f"path/{name}") & 0x7FFFFFFF, move)
            run.ledger.make(f"radiance/{name}.exr", keys[name], image.save)
    return True


def expose(run: Run) -> bool:
    """A digital frame of every station."""
    from testfield.sensor.expose import Sensor

    scene = run.scene
    sensor = Sensor(
        pixel_pitch_um=scene.camera.pixel_pitch_um, f_number=scene.camera.f_number, time_ms=scene.exposure.time_ms,
        **scene.sensor.model_dump(),
    )  # fmt: skip
    code = code_digest(*SEEING, "sensor")
    work = []
    for name in run.stations:
        source = run.need(f"radiance/{name}.exr", "render")
        key = digest(code, file_digest(source), sensor, scene.seed, name)
        target = f"frames/{name}.png"
        if not (run.ledger.fresh(target, key) and run.ledger.fresh(f"frames/{name}.json", key)):
            work.append((source, run.folder / target, sensor, scene.seed, target, key))
    for target, key in _each(run, "expose", _expose_one, work, "frames"):
        run.ledger.enter(target, key)
        run.ledger.enter(str(Path(target).with_suffix(".json")), key)
    return bool(work)


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


def detect(run: Run) -> bool:
    """Observations of all frames together."""
    from testfield.detect.observations import Observations

    measure = run.scene.measure
    sources = [run.need(f"frames/{name}.png", "expose") for name in run.stations]
    sheets = [run.need(f"frames/{name}.json", "expose") for name in run.stations]
    key = digest(
        code_digest(*SEEING, "detect"),
        [file_digest(p) for p in sources + sheets],
        run.field,
        measure.centroid,
        measure.smallest_diameter_px,
    )
    if run.ledger.fresh("observations.parquet", key):
        return False
    work = [(source, run.field, measure.centroid, measure.smallest_diameter_px) for source in sources]
    parts = list(_each(run, "detect", _detect_one, work, "frames"))
    observations = Observations.join(parts, run.stations)
    return run.ledger.make("observations.parquet", key, observations.save)


def _detect_one(work: tuple) -> Any:
    from testfield.camera.images import Frame
    from testfield.detect.detect import detect as detect_frame

    source, field, centroid, smallest = work
    return detect_frame(Frame.load(source), field, centroid, smallest)


def calibrate(run: Run) -> bool:
    """Camera, stations and boards."""
    from testfield.detect.observations import Observations
    from testfield.registry import find

    source = run.need("observations.parquet", "detect")
    camera, method = run.scene.camera, run.scene.measure.calibrator
    code = code_digest(*SEEING, "adjust", "calibrate")
    key = digest(code, file_digest(source), run.field, method, camera.width_px, camera.height_px)

    def write(path: Path) -> None:
        find("calibrators", method)(Observations.load(source), run.field, camera.width_px, camera.height_px).save(path)

    return run.ledger.make("calibration.json", key, write)


def reconstruct(run: Run) -> bool:
    """Scale-bar ends and check targets."""
    from testfield.calibrate.calibration import Calibration
    from testfield.detect.observations import Observations
    from testfield.registry import find

    observations, calibration = (
        run.need("observations.parquet", "detect"),
        run.need("calibration.json", "calibrate"),
    )
    method = run.scene.measure.reconstructor
    code = code_digest(*SEEING, "adjust", "reconstruct")
    key = digest(code, file_digest(observations), file_digest(calibration), run.field, method)

    def write(path: Path) -> None:
        find("reconstructors", method)(Observations.load(observations), Calibration.load(calibration), run.field).save(
            path
        )

    return run.ledger.make("points.parquet", key, write)


def score(run: Run) -> bool:
    """Everything measured against the truth."""
    from testfield.chain.truth_files import write_truth
    from testfield.score.scorecard import scorecard, write_scorecard

    inputs = [run.need(name, maker) for name, maker in MEASURED]
    write_truth(run)
    times = {
        name: run.ledger.notes.get("time_s", {}).get(name, 0.0) for name in STAGES if name not in ("score", "report")
    }
    key = digest(
        code_digest(*SEEING, "scene", "score"),
        [file_digest(p) for p in inputs],
        run.scene.model_dump(),
        times,
    )
    return run.ledger.make(
        "scorecard.json",
        key,
        lambda path: write_scorecard(scorecard(run.world, run.views, *inputs) | {"time_s": times}, path),
    )


def report(run: Run) -> bool:
    """The page for people."""
    from testfield.report.page import write_report

    inputs = [run.need(name, maker) for name, maker in MEASURED] + [run.need("scorecard.json", "score")]
    frames = [run.need(f"frames/{name}.png", "expose") for name in run.stations]
    key = digest(
        code_digest(*SEEING, "scene", "score", "report"),
        [file_digest(p) for p in inputs + frames],
        run.scene.model_dump(),
    )
    with bar("report", 1, "page") as move:
        made = run.ledger.make(
            "report.html",
            key,
            lambda path: write_report(run.world, run.views, run.scene, run.folder, run.ledger.notes, path),
        )
        move(1)
    return made


MEASURED = (
    ("observations.parquet", "detect"),
    ("calibration.json", "calibrate"),
    ("points.parquet", "reconstruct"),
)
STAGES: dict[str, Callable[[Run], bool]] = {
    "render": render,
    "expose": expose,
    "detect": detect,
    "calibrate": calibrate,
    "reconstruct": reconstruct,
    "score": score,
    "report": report,
}


def run_stage(run: Run, name: str) -> bool:
    """Run one stage and note how long it took when it made anything; returns whether it did."""
    start = time.perf_counter()
    made = STAGES[name](run)
    if made:
        times = run.ledger.notes.get("time_s", {}) | {name: round(time.perf_counter() - start, 2)}
        run.ledger.note(time_s=times)
    return made


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
