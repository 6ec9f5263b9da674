"""The same scene gives the same figures on every processor: LLVM targets of 4, 8 and the machine's own lanes."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testfield.chain.run import Run, resume
from testfield.chain.trials import reexposed
from testfield.registry import find
from testfield.render.jit_core import VARIABLE
from testfield.score.scorecard import plain, scorecard

SCENES = Path(__file__).parents[1] / "scenes"
TARGETS = ("x86-64-v2", "x86-64-v3", "native")


def numbers(card: Any, name: str = "") -> dict[str, float]:
    """All numbers of a scorecard under their dotted names."""
    if isinstance(card, dict):
        return {k: v for key, item in card.items() for k, v in numbers(item, f"{name}.{key}").items()}
    if isinstance(card, list):
        return {k: v for key, item in enumerate(card) for k, v in numbers(item, f"{name}.{key}").items()}
    number = isinstance(card, (int, float)) and not isinstance(card, bool)
    return {name: float(card)} if number else {}


def another_draw(run: Run, seed: int, folder: Path) -> dict[str, float]:
    """The scorecard of new noise on the run's radiance."""
    measure, camera = run.scene.measure, run.scene.camera
    observations = reexposed(run, seed)
    calibration = find("calibrators", measure.calibrator)(
        observations, run.field, camera.width_px, camera.height_px, measure.lens or camera.lens, measure.hold
    )
    points = find("reconstructors", measure.reconstructor)(observations, calibration, run.field)
    paths = [folder / name for name in ("observations.parquet", "calibration.json", "points.parquet")]
    for what, path in zip((observations, calibration, points), paths, strict=True):
        what.save(path)
    return numbers(plain(scorecard(run.world, run.views, *paths)))


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "draws"), [("quick", 8), ("stitched_wall", 4)])
def test_scorecards_agree_between_processors_to_a_hundredth_of_their_uncertainty(
    scene: str, draws: int, tmp_path: Path
) -> None:
    cards = {}
    for target in TARGETS:
        path, out = SCENES / f"{scene}.toml", tmp_path / target
        choice = {} if target == "native" else {VARIABLE: target}
        environment = {name: value for name, value in os.environ.items() if name != VARIABLE} | choice
        subprocess.run([sys.executable, "-m", "testfield", "run", path, "--out", out], check=True, env=environment)
        card = json.loads((tmp_path / target / "scorecard.json").read_text())
        cards[target] = numbers({key: value for key, value in card.items() if key != "time_s"})
    run = resume(tmp_path / "native", 1)
    others = [another_draw(run, seed, tmp_path) for seed in range(draws)]
    off = {}
    for name, value in cards["native"].items():
        values = [other[name] for other in others if name in other]
        u = np.std(values, ddof=1) if len(values) == draws else 0.0
        worst = max(abs(cards[target][name] - value) for target in TARGETS)
        if worst > 0.01 * u + 1e-12 * abs(value):
            off[name] = (worst, u)
    assert not off, off
