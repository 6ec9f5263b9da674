"""The stages in order. Each keeps what it made as long as everything it was made from is the same."""

import time
from collections.abc import Callable
from pathlib import Path

from testfield.chain.belongs import check_truth, world_of
from testfield.chain.frame_work import detect_one
from testfield.chain.keys import (
    calibrate_key,
    detect_key,
    reconstruct_key,
    report_key,
    score_key,
)
from testfield.chain.progress import bar
from testfield.chain.recipe import recipe_of
from testfield.chain.rendering import expose, frames_of_others, render
from testfield.chain.run import Run
from testfield.chain.stage_work import Made, each_item
from testfield.store.digests import file_digest
from testfield.store.threads import one_blas_thread


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
    parts = list(each_item(run, "detect", detect_one, work, "frames"))
    observations = run.truth.by_cameras(Observations.join(parts, run.stations))
    return int(run.ledger.make("observations.parquet", key, observations.save, world=world)), 1


def calibrate(run: Run) -> Made:
    """Camera, stations and boards."""
    from testfield.detect.observations import Observations
    from testfield.measure.pipeline import calibrate

    _take_over_csv(run)
    source = run.need("observations.parquet", "detect")
    key = calibrate_key(run.scene, run.field, file_digest(source))

    def write(path: Path) -> None:
        seen = Observations.load(source, run.field, run.truth.largest_px)
        calibrate(seen, run.field, recipe_of(run.scene)).save(path)

    world = world_of(run, ["observations.parquet"])
    return int(run.ledger.make("calibration.json", key, write, [source], world)), 1


def _take_over_csv(run: Run) -> None:
    """Observations that somebody put into the run's folder as CSV, where there are no others."""
    from testfield.detect.observations import Observations
    from testfield.store.atomic import whole

    target, source = (run.folder / f"observations.{kind}" for kind in ("parquet", "csv"))
    if source.is_file() and not target.exists():
        seen = Observations.load(source, run.field, run.truth.largest_px)
        with whole(target) as path:
            run.truth.by_cameras(seen).save(path)


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
