"""Planning put to the test: its time and memory, its networks against random ones, its uncertainties against what
rendered and measured scenes scatter."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError
from testfield.plan.candidates import candidates_of
from testfield.plan.design import propose
from testfield.plan.goals import Goal
from testfield.plan.job import Job
from testfield.plan.predict import predict_scene
from testfield.plan.subsets import Choice
from testfield.scene.load import load_scene
from testfield.scene.shipped import find_scene
from testfield.seeds import generator

PARTS = ("time", "design", "rendered")
SIZES = ((2000, 60), (5000, 100))
"""Targets and stations of the networks that are timed."""
FIELDS = ("quick", "on_a_hull", "vdi2634")
"""Three fields: a few boards, a body that hides, lengths through a volume."""
STATIONS, RANDOM, PLACES = 6, 2000, 60
SCENES = ("quick", "on_a_hull", "hand_held", "full_board", "retro_flash", "fitting_point")
TRIALS = 20
LEAST_TRIALS = 5
OUTLYING = 4.0


def bench_plan(
    only: str | None, scenes: tuple[str, ...], trials: int, out: Path, tell: Callable[[str], None]
) -> dict[str, Any]:
    """All parts, or `only` one of `PARTS`. `scenes` are rendered into folders of `out` and exposed `trials` times; what
    is finished there is kept."""
    answer: dict[str, Any] = {}
    if only in (None, "time"):
        for targets, stations in SIZES:
            tell(f"{targets} targets, {stations} stations")
            answer.setdefault("time", []).append(timed(targets, stations))
    if only in (None, "design"):
        for name in FIELDS:
            tell(f"{RANDOM} random networks of {name}")
            answer.setdefault("design", []).append(against_random(name))
    if only in (None, "rendered"):
        for name in scenes:
            tell(f"{name}: {trials} exposures")
            answer.setdefault("rendered", []).append(against_rendered(name, trials, out, tell))
    return answer


def said(found: dict[str, Any]) -> list[str]:
    """The figures as lines."""
    lines = [
        f"{row['targets']} targets, {row['stations']} stations, {row['observations']} observations: "
        f"{row['processor_s']:.1f} s of a processor, {row['peak_gb']:.2f} GB; points weighed by {row['weights']}"
        for row in found.get("time", [])
    ]
    lines += [
        f"{row['field']}: {row['stations']} of {row['candidates']} candidates; proposed {row['greedy_mm']:.5f} mm, "
        f"best of {row['random']} random ones {row['best_random_mm']:.5f} mm (median {row['median_random_mm']:.5f}): "
        f"{row['ratio']:.3f}"
        for row in found.get("design", [])
    ]
    lines += [
        f"{row['scene']}: actual over predicted {row['ratio']:.3f} ({row['low']:.3f} to {row['high']:.3f}), "
        f"stated over predicted {row['stated']:.3f}; {row['points']} points, {row['trials']} exposures, "
        f"{row['outlying']} outlying"
        for row in found.get("rendered", [])
    ]
    return lines


def timed(targets: int, stations: int) -> dict[str, Any]:
    """Processor time and peak memory of a process that predicts a large field, imports included."""
    code = (
        "import json, resource\n"
        "from testfield.bench.plan import large_here\n"
        f"found = large_here({targets}, {stations})\n"
        "used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print(json.dumps(found | {'processor_s': used.ru_utime + used.ru_stime, 'peak_gb': used.ru_maxrss / 1e6}))"
    )
    environment = dict(os.environ) | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise TestfieldError(f"planning failed: {(done.stderr.strip().splitlines() or ['it was ended'])[-1]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def large_here(targets: int, stations: int) -> dict[str, Any]:
    """Predict a large field in this process."""
    from testfield.bench.plan_scenes import large_field
    from testfield.plan.card import card_of
    from testfield.store.pool import end_with_parent

    end_with_parent()
    job = Job.of(large_field(targets, stations), "large field")
    card = card_of(predict_scene(job))
    return {
        "targets": targets,
        "stations": card["images"],
        "observations": len(job.expected),
        "measured": card["points"]["measured"],
        "weights": card["points"]["weights"],
    }


def against_random(name: str) -> dict[str, Any]:
    """The greedy network of `STATIONS` stations on a shipped field, from scratch, and `RANDOM` networks of as many of
    the same candidates: the goal's figure of the best of those that determine every target, and how many do."""
    path = find_scene(Path(name))
    job = Job.of(load_scene(path), name)
    choice, goal = Choice(job, candidates_of(job, places=PLACES)), Goal("u_rms_mm")
    greedy = propose(choice, goal, most=STATIONS, keep=())
    rng = generator(1, f"bench/plan/{name}")
    scores = []
    for _ in range(RANDOM):
        chosen = choice.stations + rng.choice(len(choice.candidates), STATIONS, replace=False)
        scores.append(goal.score(choice.predict(chosen.tolist())))
    values = np.array(scores)
    whole = values < job.world.field_diagonal_mm
    return {
        "field": name,
        "candidates": len(choice.candidates),
        "stations": STATIONS,
        "random": RANDOM,
        "random_that_see_all": int(whole.sum()),
        "greedy_mm": greedy.value,
        "greedy_misses": len(job.field.loose) - len(greedy.found.code),
        "best_random_mm": float(values.min()) if whole.any() else None,
        "median_random_mm": float(np.median(values[whole])) if whole.any() else None,
        "ratio": greedy.value / float(values.min()) if whole.any() else None,
    }


def against_rendered(name: str, trials: int, out: Path, tell: Callable[[str], None]) -> dict[str, Any]:
    """Actual over predicted standard deviation of a scene's points: rendered once, then exposed anew again and again,
    each time with certificates drawn anew, detected, calibrated and reconstructed.

    `ratio` is the root of the mean, over all coordinates of all points, of the scatter's variance over the predicted
    one; its 95 % band `low` to `high` comes from a jackknife over exposures. `stated` is the same of what the run
    itself states, which one exposure tells. `outlying` exposures, which miss by more than `OUTLYING` standard
    deviations on the whole, are counted and left out: there the chain turned a certificate down, and said so.
    """
    from testfield.chain.complete import complete
    from testfield.chain.trials import Trials
    from testfield.store.threads import one_blas_thread

    run, _ = complete(Path(name), out / name, None, None, 1, False, lambda warnings: None)
    found = predict_scene(Job.of(run.scene, name))
    measured = Trials(run, "exposure")
    rows = [found.rows((int(code),)) for code in measured.points.code]
    met = np.array([row is not None for row in rows])
    u = found.u_mm[np.array([row[0] for row in rows if row is not None])]
    stated = np.sqrt(np.diag(measured.points.cov_xyz_mm2)).reshape(-1, 3)[met]
    off = []
    with one_blas_thread():
        for k in range(trials):
            off.append((measured.trial(k) - measured.points.xyz_mm)[met] / u)
            tell(f"{name}: exposure {k + 1} of {trials}")
    stated_ratio = float(np.sqrt(np.mean((stated / u) ** 2)))
    about = {"scene": name, "trials": trials, "points": int(met.sum()), "stated": stated_ratio}
    return about | ratio_of(np.array(off))


def ratio_of(off: np.ndarray) -> dict[str, float]:
    """Root mean square scatter of deviations (t, n, 3) in units of their predicted standard deviations, points that a
    trial did not find left out, with its jackknife band; outlying trials apart."""
    size = np.sqrt(np.nanmean(off**2, axis=(1, 2)))
    trials, off = len(off), off[size < OUTLYING]
    whole = _scatter(off)
    parts = np.array([_scatter(np.delete(off, k, axis=0)) for k in range(len(off))])
    error = float(np.sqrt((len(off) - 1) / len(off) * ((parts - parts.mean()) ** 2).sum()))
    return {
        "ratio": whole,
        "low": whole - 1.96 * error,
        "high": whole + 1.96 * error,
        "outlying": trials - len(off),
    }


def _scatter(off: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.nanvar(off, axis=0, ddof=1))))
