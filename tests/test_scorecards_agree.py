"""The same scene gives the same figures on every processor: LLVM targets of 4, 8 and the machine's own lanes."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import testfield.render.llvm
from testfield.chain.run import Run, resume
from testfield.chain.trials import reexposed
from testfield.registry import find
from testfield.score.scorecard import plain, scorecard

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
CHOICE, TARGETS = "TESTFIELD_LLVM_TARGET", ("x86-64-v2", "x86-64-v3", "native")
DRAWS = 8


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
def test_scorecards_agree_between_processors_to_a_hundredth_of_their_uncertainty(tmp_path: Path) -> None:
    source = Path(testfield.render.llvm.__file__).parent
    if not any(CHOICE in path.read_text() for path in source.glob("*.py")):
        pytest.skip(f"{CHOICE} chooses nothing here")
    cards = {}
    for target in TARGETS:
        command = [sys.executable, "-m", "testfield", "run", str(QUICK), "--out", str(tmp_path / target), "--jobs", "1"]
        subprocess.run(command, check=True, env=os.environ | {CHOICE: target}, capture_output=True)
        card = json.loads((tmp_path / target / "scorecard.json").read_text())
        cards[target] = numbers({key: value for key, value in card.items() if key != "time_s"})
    run = resume(tmp_path / "native", 1)
    draws = [another_draw(run, seed, tmp_path) for seed in range(DRAWS)]
    off = {}
    for name, value in cards["native"].items():
        values = [draw[name] for draw in draws if name in draw]
        u = np.std(values, ddof=1) if len(values) == DRAWS else 0.0
        worst = max(abs(cards[target][name] - value) for target in TARGETS)
        if worst > 0.01 * u + 1e-12 * abs(value):
            off[name] = (worst, u)
    assert not off, off
