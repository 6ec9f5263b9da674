"""Whether claimed covariances are true: NEES and coverage of cameras, rigs, boards and check points over independent
trials.

An error of a run has two sources: the noise of the images, and what the workshop did (print errors of the boards, the
true lengths of the bars), which the sheets know with an uncertainty only. Both must be drawn anew for every trial, or
the trials are not independent and their NEES has no band.

`over_worlds` draws worlds by another seed each. To need no rendering, their pixels are drawn from the truth at the
physical bound (`testfield.simulate.observations`); detection is left out.

`over_exposures` exposes one rendered world again and again, and runs the whole chain on the new frames. The workshop
is drawn anew without new pictures: each mark that was measured is shifted by the difference, mostly of thousandths of
a pixel, between its true images in the drawn world and in the rendered one.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.bench.claim_errors import GROUPS, errors_of
from testfield.bench.claim_figures import Errors, Tally, claim_checks, summary
from testfield.camera.circle import disc_image
from testfield.camera.project import project
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run, resume, with_seed
from testfield.chain.trials import Trials, reexposed
from testfield.chain.truth import Truth
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.evaluate.execute import execute
from testfield.evaluate.failures import FAILURE
from testfield.measure.pipeline import measure
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.world import World
from testfield.score.points import score_points
from testfield.seeds import seed_of
from testfield.simulate.observations import draw_observations
from testfield.store.work import Pool


@dataclass(frozen=True)
class Trial:
    """What one world gave: its `errors` by group, `rmse_mm` and mean claimed `u_mm` of its check points, `sigma0`."""

    errors: dict[str, Errors]
    rmse_mm: float
    u_mm: float
    sigma0: float


def over_worlds(
    text: str, source: Path, worlds: int, folder: Path, jobs: int = 1, pool: Pool | None = None
) -> dict[str, Any]:
    """NEES and coverage over worlds that differ by the scene's seed, with pixels drawn from the truth; finished ones
    are kept in a folder. Raises `TestfieldError` where a world cannot be measured."""
    options = {"text": text, "source": str(source.resolve())}
    cases = [Case({"world": k}, f"{__name__}:world_rows", options=options) for k in range(worlds)]
    table = _table(cases, folder, jobs, pool)
    rmse, u, sigma0 = (table.groupby("world")[name].first() for name in ("rmse_mm", "u_mm", "sigma0"))
    rmse, u = (float(np.sqrt(np.mean(np.square(values)))) for values in (rmse, u))
    return {
        "worlds": worlds,
        "rmse_mm": rmse,
        "mean_u_mm": u,
        "rmse_over_u": rmse / u,
        "sigma0": float(sigma0.mean()),
    } | figures_of(errors_in(table, "world"))


def world_rows(case: Case, _: Run | None) -> list[dict[str, Any]]:
    """A row for each group of errors of one drawn world."""
    trial = _drawn_world(case.options["text"], Path(case.options["source"]), case.labels["world"])
    same = {"rmse_mm": trial.rmse_mm, "u_mm": trial.u_mm, "sigma0": trial.sigma0}
    return [row | same for row in error_rows(trial.errors)]


def drawn_worlds(text: str, source: Path, worlds: int) -> list[Trial]:
    """What worlds that differ by the scene's seed give, with pixels drawn from the truth."""
    return [_drawn_world(text, source, k) for k in range(worlds)]


def _drawn_world(text: str, source: Path, number: int) -> Trial:
    first = parse_scene(text, str(source), source.parent).seed
    scene = parse_scene(with_seed(text, seed_of(first, f"claims/{number}") >> 33), str(source), source.parent)
    truth = Truth.of(scene, str(source))
    measured = measure(draw_pixels(truth, seed_of(scene.seed, "claims/pixels")), truth.told, recipe_of(scene))
    score = score_points(truth.world, measured.calibration, measured.points)
    return Trial(
        errors=errors_of(truth.world, truth.cameras, scene.rigs, measured.calibration, measured.points),
        rmse_mm=float(np.sqrt((score.error_mm**2).mean())),
        u_mm=float(np.sqrt((score.u_mm**2).mean())),
        sigma0=measured.calibration.sigma0,
    )


def draw_pixels(truth: Truth, seed: int) -> Observations:
    """Observations of all images of all cameras at the physical bound."""
    if not truth.several:
        return draw_observations(truth.scene, truth.world, truth.views, seed)
    images = []
    for part, world, views in zip(truth.parts, truth.worlds, truth.views_of_parts, strict=True):
        seen = draw_observations(part.scene, world, views, seed)
        images += [seen.take(seen.station == k) for k in range(len(world.station_name))]
    return truth.by_cameras(Observations.join(images, truth.world.station_name))


def over_exposures(run: Run, exposures: int, pool: Pool | None = None) -> dict[str, Any]:
    """NEES and coverage over new exposures of a run's radiance, each with a workshop of its own; finished ones are kept
    in the run's folder. Raises `TestfieldError` for a run of several cameras, whose marks cannot be moved in images,
    and where an exposure cannot be measured."""
    if run.truth.several:
        raise TestfieldError(
            "new exposures are known of one camera only",
            str(run.folder),
            "use --scene, which draws worlds of several cameras",
        )
    options = {"run": str(run.folder.resolve()), "key": Trials(run, "exposure").key}
    cases = [Case({"exposure": k}, f"{__name__}:exposure_rows", options=options) for k in range(exposures)]
    table = _table(cases, run.folder / "claims", run.jobs, pool)
    return {"exposures": exposures} | figures_of(errors_in(table, "exposure"))


def exposure_rows(case: Case, _: Run | None) -> list[dict[str, Any]]:
    """A row for each group of errors of one exposure, whose marks are those of a workshop of its own.

    Raises `TestfieldError` where the run is not the one of which this was asked.
    """
    run, key = _rendered(Path(case.options["run"]))
    number = case.labels["exposure"]
    if key != case.options["key"]:
        raise TestfieldError("this run has changed", str(run.folder), "give the command again")
    again = reexposed(run, seed_of(run.scene.seed, f"claims/{number}"))
    world = build_world(run.scene, workshop=seed_of(run.scene.seed, f"claims/{number}/workshop"))
    measured = measure(
        _moved(again, run.world, _true_px(world) - _true_px(run.world)), world.field, recipe_of(run.scene)
    )
    return error_rows(errors_of(world, {"": world}, (), measured.calibration, measured.points))


@lru_cache(maxsize=1)
def _rendered(folder: Path) -> tuple[Run, str]:
    run = resume(folder, 1)
    return run, Trials(run, "exposure").key


def _table(cases: list[Case], folder: Path, jobs: int, pool: Pool | None) -> pd.DataFrame:
    table = execute(cases, folder, jobs, "claims", pool=pool)
    if FAILURE in table:
        raise TestfieldError(str(table[FAILURE].dropna().iloc[0]))
    return table


def error_rows(errors: dict[str, Errors]) -> list[dict[str, Any]]:
    """Errors of one trial as rows, one a group."""
    return [
        {"group": group, "error": of.error.tolist(), "cov": of.cov.ravel().tolist(), "size": of.size}
        for group, of in errors.items()
    ]


def errors_in(table: pd.DataFrame, trial: str) -> list[dict[str, Errors]]:
    """Errors by group of each trial, from rows that `error_rows` made; `trial` is the column that numbers trials."""
    return [
        {row.group: _errors(row.error, row.cov, row.size) for row in rows.itertuples()}
        for _, rows in table.groupby(trial, sort=True)
    ]


def _errors(error: Any, cov: Any, size: int) -> Errors:
    error = np.asarray(error, float)
    return Errors(error, np.asarray(cov, float).reshape(len(error), len(error)), int(size))


def figures_of(found: list[dict[str, Errors]]) -> dict[str, Any]:
    """The groups' figures over trials, and the checks of their claims as plain values."""
    by_group = {group: [errors[group] for errors in found] for group in GROUPS if group in found[0]}
    checks = claim_checks({group: Tally.of(trials) for group, trials in by_group.items()})
    return {group: summary(trials) for group, trials in by_group.items()} | {"checks": [c.row() for c in checks]}


def _true_px(world: World) -> np.ndarray:
    """(stations, marks, 2) what a detector sees of each mark."""
    stations, marks = len(world.camera_from_world), len(world.marks)
    pose = world.camera_from_world[np.repeat(np.arange(stations), marks)]
    at, normal = (np.tile(values, (stations, 1)) for values in (world.mark_world_mm, world.mark_normal))
    image = disc_image(world.interior, pose, at, normal, np.tile(world.marks.diameter_mm / 2, stations))
    corner = np.tile(world.marks.corner, stations)[:, None]
    seen = np.where(corner, project(world.interior, pose, at), image.centroid_px)
    return seen.reshape(stations, marks, 2)


def _moved(observations: Observations, world: World, shift_px: np.ndarray) -> Observations:
    """Observations of a world whose marks are elsewhere by `shift_px` (stations, marks, 2)."""
    marks = world.marks
    place = {name: k for k, name in enumerate(_names(marks.board, marks.point, marks.code))}
    o = observations
    mark = np.array([place.get(name, -1) for name in _names(o.board, o.point, o.code)], int)
    station = np.array([world.station_name.index(name) for name in o.stations], int)[o.station]
    shift = np.where((mark >= 0)[:, None], shift_px[station, mark], 0)
    return replace(o, xy_px=o.xy_px + shift)


def _names(board: np.ndarray, point: np.ndarray, code: np.ndarray) -> list[tuple[int, int]]:
    """A mark's name: its board and its place there, or -1 and its code."""
    return list(zip(board.tolist(), np.where(board >= 0, point, code).tolist(), strict=True))
