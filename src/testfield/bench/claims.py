"""Whether claimed covariances are true: NEES and coverage of camera, boards and check points over independent trials.

An error of a run has two sources: the noise of the images, and what the workshop did (print errors of the boards, the
true lengths of the bars), which the sheets know with an uncertainty only. Both must be drawn anew for every trial, or
the trials are not independent and their NEES has no band.

`over_worlds` draws worlds by another seed each. To need no rendering, their pixels are drawn from the truth at the
physical bound (`testfield.bench.drawn`); detection is left out.

`over_exposures` exposes one rendered world again and again, and runs the whole chain on the new frames. The workshop
is drawn anew without new pictures: each mark that was measured is shifted by the difference, mostly of thousandths of
a pixel, between its true images in the drawn world and in the rendered one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from testfield.bench.drawn import draw_observations
from testfield.calibrate.calibration import Calibration
from testfield.camera.circle import disc_image
from testfield.camera.pose import rotation_vector
from testfield.camera.project import project
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run, with_seed
from testfield.chain.trials import Trials, reexposed
from testfield.detect.observations import Observations
from testfield.measure.pipeline import measure
from testfield.reconstruct.points import Points
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.points import score_points
from testfield.seeds import seed_of
from testfield.statistics.consistency import nees_band
from testfield.store.digests import digest

GROUPS = ("camera", "boards", "check_points")
P = 0.95


@dataclass(frozen=True)
class Errors:
    """Errors of one trial and what was claimed of them: `error` (d,), `cov` (d, d), in parts of `size`, each
    with a coverage region of its own."""

    error: np.ndarray
    cov: np.ndarray
    size: int

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of all together, per degree of freedom."""
        return float(self.error @ np.linalg.solve(self.cov, self.error)) / max(len(self.error), 1)

    @property
    def covered(self) -> np.ndarray:
        """Whether each part lies in its own region at `P`."""
        parts = [slice(k, k + self.size) for k in range(0, len(self.error), self.size)]
        radius = [self.error[s] @ np.linalg.solve(self.cov[s, s], self.error[s]) for s in parts]
        return np.array(radius) <= chi2.ppf(P, self.size)


def errors_of(world: World, calibration: Calibration, points: Points) -> dict[str, Errors]:
    """Errors of interior orientation, board poses and check points in the datum frame, by group."""
    return {
        "camera": _camera(world, calibration), "boards": _boards(world, calibration),
        "check_points": _points(world, calibration, points),
    }  # fmt: skip


def over_worlds(text: str, source: Path, worlds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """NEES and coverage over worlds that differ by the scene's seed, with pixels drawn from the truth."""
    found: list[dict[str, Errors]] = []
    accuracy, sigma0 = [], []
    first = parse_scene(text, str(source), source.parent).seed
    for k in range(worlds):
        scene = parse_scene(with_seed(text, seed_of(first, f"claims/{k}") >> 33), str(source), source.parent)
        world = build_world(scene)
        observations = draw_observations(scene, world, see(world), seed_of(scene.seed, "claims/pixels"))
        measured = measure(observations, world.field, recipe_of(scene))
        calibration, points = measured.calibration, measured.points
        found.append(errors_of(world, calibration, points))
        score = score_points(world, calibration, points)
        accuracy.append([np.sqrt((score.error_mm**2).mean()), np.sqrt((score.u_mm**2).mean())])
        sigma0.append(calibration.sigma0)
        tell(f"world {k + 1} of {worlds}")
    rmse, u = np.sqrt(np.mean(np.square(accuracy), axis=0))
    return {
        "worlds": worlds, "rmse_mm": float(rmse), "mean_u_mm": float(u), "rmse_over_u": float(rmse / u),
        "sigma0": float(np.mean(sigma0)),
        **{group: _summary([errors[group] for errors in found]) for group in GROUPS},
    }  # fmt: skip


def over_exposures(run: Run, exposures: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """NEES and coverage over new exposures of a run's radiance, each with a workshop of its own; finished ones are kept
    in the run's folder."""
    found: list[dict[str, Errors]] = []
    trials = Trials(run, "exposure")
    rendered = _true_px(run.world)
    for k in range(exposures):
        name = f"claims/{k:04d}.parquet"
        run.ledger.make(name, digest(trials.key, k), partial(_again, run, k))
        world = build_world(run.scene, workshop=seed_of(run.scene.seed, f"claims/{k}/workshop"))
        observations = _moved(Observations.load(run.folder / name), run.world, _true_px(world) - rendered)
        again = measure(observations, world.field, recipe_of(run.scene))
        found.append(errors_of(world, again.calibration, again.points))
        tell(f"exposure {k + 1} of {exposures}")
    return {"exposures": exposures} | {
        group: _summary([errors[group] for errors in found]) for group in GROUPS
    }  # fmt: skip


def _again(run: Run, number: int, path: Path) -> None:
    reexposed(run, seed_of(run.scene.seed, f"claims/{number}")).save(path)


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


def _summary(trials: list[Errors]) -> dict[str, Any]:
    nees, d = np.array([t.nees for t in trials]), len(trials[0].error)
    covered = np.concatenate([t.covered for t in trials])
    return {
        "degrees_of_freedom": d, "nees": float(nees.mean()), "nees_each": nees.tolist(),
        "coverage_95": float(covered.mean()), "regions": len(covered),
        "nees_band_95": list(nees_band(sum(len(t.error) for t in trials))),
    }  # fmt: skip


def _camera(world: World, calibration: Calibration) -> Errors:
    alike = calibration.interior.model == world.interior.model
    free = [name for name in calibration.interior.without_modes.names if alike and name in calibration.labels]
    chosen = [calibration.interior.names.index(name) for name in free]
    index = calibration.index(free)
    error = (calibration.interior.without_modes.parameters - world.interior.parameters)[chosen] if free else np.zeros(0)
    return Errors(error, calibration.covariance[np.ix_(index, index)], max(len(free), 1))


def _boards(world: World, calibration: Calibration) -> Errors:
    _, true = true_in_datum(world, calibration.board_names)
    error, names = [], []
    for b, name in enumerate(calibration.board_names[1:], start=1):
        turn = rotation_vector((calibration.boards.R[b] @ true.R[b].T)[None])[0]
        error += [turn, calibration.boards.t_mm[b] - true.t_mm[b]]
        names += [f"board:{name}.{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")]
    index = calibration.index(names)
    return Errors(np.concatenate([np.zeros(0), *error]), calibration.covariance[np.ix_(index, index)], 6)


def _points(world: World, calibration: Calibration, points: Points) -> Errors:
    score = score_points(world, calibration, points)
    return Errors(score.error_mm.ravel(), score.cov_mm2, 3)
