"""Whether claimed covariances are true: NEES and coverage of camera, boards and check points over independent trials.

Two experiments, because an error of a run has two sources. What the images' noise does is new in every exposure; what
the workshop did (print errors of the boards, the true lengths of the bars) is drawn once for a world.

`over_exposures` exposes one rendered world again and again, and runs the whole chain each time. Its errors share the
world's workshop, so their NEES against the full claim is that of one draw of it, however many exposures there are: it
has no band of its own. What can be tested is the noise: the scatter about the mean over exposures, set against the
scatter that the claimed covariances of the pixels alone give through the same calibration and reconstruction.

`over_worlds` draws worlds with workshop and noise anew, by another seed each. To need no rendering, their pixels are
drawn from the truth at the physical bound (`testfield.bench.drawn`). There NEES per degree of freedom is 1 and its band
follows from chi-squared; detection alone is left out, and that is what the first experiment is for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from testfield.bench.drawn import draw_observations
from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import rotation_vector
from testfield.chain.files import digest
from testfield.chain.run import Run, with_seed
from testfield.chain.trials import Trials, reexposed
from testfield.detect.observations import Observations
from testfield.reconstruct.points import Points
from testfield.registry import find
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.points import score_points
from testfield.seeds import generator, seed_of
from testfield.targets.field import Field
from testfield.uncertainty.certificates import draw_pixels
from testfield.uncertainty.consistency import nees_band

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
        observations = draw_observations(scene, world, see(world), generator(scene.seed, "claims/pixels"))
        calibration, points = _measured(observations, world.field, scene)
        found.append(errors_of(world, calibration, points))
        score = score_points(world, calibration, points)
        accuracy.append([np.sqrt((score.error_mm**2).mean()), np.sqrt((score.u_mm**2).mean())])
        sigma0.append(calibration.sigma0)
        tell(f"world {k + 1} of {worlds}")
    rmse, u = np.sqrt(np.mean(np.square(accuracy), axis=0))
    return {
        "worlds": worlds, "rmse_mm": float(rmse), "mean_u_mm": float(u), "rmse_over_u": float(rmse / u),
        "sigma0": float(np.mean(sigma0)),
        **{group: _summary([errors[group] for errors in found], independent=True) for group in GROUPS},
    }  # fmt: skip


def over_exposures(run: Run, exposures: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """NEES, coverage and scatter over new exposures of a run's radiance; finished ones are kept in its folder."""
    found: list[dict[str, Errors]] = []
    shaken: list[dict[str, Errors]] = []
    trials = Trials(run, "exposure")
    for k in range(exposures):
        for kind, into in (("exposure", found), ("pixels", shaken)):
            name = f"claims/{kind}/{k:04d}.parquet"
            run.ledger.make(name, digest(trials.key, kind, k), partial(_again, trials, kind, k))
            calibration, points = _measured(Observations.load(run.folder / name), run.field, run.scene)
            into.append(errors_of(run.world, calibration, points))
        tell(f"exposure {k + 1} of {exposures}")
    answer: dict[str, Any] = {"exposures": exposures}
    for group in GROUPS:
        of_group, of_pixels = ([errors[group] for errors in part] for part in (found, shaken))
        answer[group] = _summary(of_group, independent=False) | _noise(of_group, of_pixels)
    return answer


def _again(trials: Trials, kind: str, number: int, path: Path) -> None:
    name = f"claims/{kind}/{number}"
    seed = trials.run.scene.seed
    if kind == "exposure":
        reexposed(trials.run, seed_of(seed, name)).save(path)
    else:
        draw_pixels(trials.observations, generator(seed, name)).save(path)


def _measured(observations: Observations, field: Field, scene: SceneFile) -> tuple[Calibration, Points]:
    measure, camera = scene.measure, scene.camera
    calibration = find("calibrators", measure.calibrator)(
        observations, field, camera.width_px, camera.height_px, measure.lens or camera.lens, measure.hold
    )
    return calibration, find("reconstructors", measure.reconstructor)(observations, calibration, field)


def _summary(trials: list[Errors], independent: bool) -> dict[str, Any]:
    nees, d = np.array([t.nees for t in trials]), len(trials[0].error)
    covered = np.concatenate([t.covered for t in trials])
    answer: dict[str, Any] = {
        "degrees_of_freedom": d, "nees": float(nees.mean()), "nees_each": nees.tolist(),
        "coverage_95": float(covered.mean()), "regions": len(covered),
    }  # fmt: skip
    if independent:
        answer["nees_band_95"] = list(nees_band(sum(len(t.error) for t in trials)))
    return answer


def _noise(exposed: list[Errors], shaken: list[Errors]) -> dict[str, Any]:
    """Scatter about the mean, both kinds in units of the full claim, and their ratio with its standard deviation."""
    common = min(len(t.error) for t in exposed + shaken)
    same = [[t for t in part if len(t.error) == len(exposed[0].error)] for part in (exposed, shaken)]
    if min(len(part) for part in same) < 2 or common == 0:
        return {}
    root = np.linalg.cholesky(same[0][0].cov)
    scatter, spectrum = [], np.zeros(0)
    for part in same:
        white = np.linalg.solve(root, np.array([t.error for t in part]).T).T
        off = white - white.mean(axis=0)
        scatter.append((off**2).sum() / (len(part) - 1) / white.shape[1])
        spectrum = np.linalg.svd(off, compute_uv=False) ** 2
    # Of a weighted sum of chi-squared variables, as many degrees as its own mean and variance say.
    effective = (len(shaken) - 1) * spectrum.sum() ** 2 / (spectrum**2).sum()
    ratio = float(scatter[0] / scatter[1])
    return {
        "noise_share_exposed": float(scatter[0]), "noise_share_claimed": float(scatter[1]), "noise_ratio": ratio,
        "noise_ratio_sigma": float(ratio * np.sqrt(4 / effective)),
    }  # fmt: skip


def _camera(world: World, calibration: Calibration) -> Errors:
    alike = calibration.interior.model == world.interior.model
    free = [name for name in calibration.interior.names if alike and name in calibration.labels]
    chosen = [calibration.interior.names.index(name) for name in free]
    index = calibration.index(free)
    error = (calibration.interior.parameters - world.interior.parameters)[chosen] if free else np.zeros(0)
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
