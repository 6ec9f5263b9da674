"""No stage becomes several times slower unseen: its processor time over that of fixed work, in the same process."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.chain.run import Run, resume
from testfield.chain.stages import run_stage
from testfield.render.variant import mitsuba

MADE = {
    "render": "radiance/*",
    "expose": "frames/*",
    "detect": "observations.parquet",
    "calibrate": "calibration.json",
    "reconstruct": "points.parquet",
    "score": "scorecard.json",
    "report": "report.html",
}
USUAL = {
    "render": 2.7,
    "expose": 3.0,
    "detect": 6.4,
    "calibrate": 4.4,
    "reconstruct": 0.33,
    "score": 0.3,
    "report": 9.8,
}
"""Times of the fixed work that each stage of the tiny scene takes; among processors they differ by a half."""
SLOWER = 2.5
TIMES = 2


def fixed_work() -> None:
    """What the stages are made of: filters over an image, linear algebra, many small operations."""
    rng = np.random.default_rng(0)
    image = rng.random((1024, 1280), np.float32)
    for _ in range(6):
        image = cv2.GaussianBlur(image, (0, 0), 2.0)
    normal = rng.random((300, 300))
    for _ in range(3):
        np.linalg.eigh(normal @ normal.T)
    place = np.zeros(3)
    for k in range(8000):
        place = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]) @ place + k
    np.sort(rng.random(500_000))


def fixed_kernel() -> None:
    """What rendering is made of: one large kernel, as wide as this processor's vectors."""
    import drjit as dr

    mi = mitsuba()
    x = dr.arange(mi.Float, 1 << 22) * 1e-6
    y = x
    for _ in range(60):
        y = dr.sqrt(dr.abs(dr.sin(y) * dr.cos(x) + y))
    dr.eval(dr.sum(y))
    dr.sync_thread()


def least_s(work: Callable[[], object], before: Callable[[], object] = lambda: None) -> float:
    """Processor time of a piece of work, the least of several."""
    times = []
    for _ in range(TIMES):
        before()
        begun = time.process_time()
        work()
        times.append(time.process_time() - begun)
    return min(times)


@pytest.mark.parametrize("stage", MADE)
def test_a_stage_takes_no_longer_than_it_did(stage: str, tiny: Run, tmp_path: Path) -> None:
    shutil.copytree(tiny.folder, tmp_path / "tiny")
    run = resume(tmp_path / "tiny", 1)

    def without() -> None:
        for path in run.folder.glob(MADE[stage]):
            path.unlink()

    fixed = fixed_kernel if stage == "render" else fixed_work
    unit = least_s(fixed)
    taken = least_s(lambda: run_stage(run, stage), without)
    ratio = taken / min(unit, least_s(fixed)) / USUAL[stage]
    assert ratio < SLOWER, f"{stage} takes {taken:.2f} s, {ratio:.2f} times what is usual"
    assert ratio > 1 / SLOWER / 2, f"{stage} became {1 / ratio:.1f} times faster: write its new time here"
