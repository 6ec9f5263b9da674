"""No stage becomes several times slower unseen: its processor time over that of a fixed job in the same minute.

The job is NumPy's and OpenCV's alone, so that it is slower where the machine is. The least of a few repetitions counts,
of processor time, not of the clock: another process then costs little. Ratios differ by machine by less than the band,
and a stage that became five times slower leaves it wherever it stood.
"""

import time
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Frame, Radiance
from testfield.chain.run import Run
from testfield.detect.detect import detect
from testfield.detect.observations import Observations
from testfield.reconstruct.points import Points
from testfield.registry import find
from testfield.scene.exposure import sensor_of
from testfield.score.detection import score_detection
from testfield.score.points import score_points
from testfield.sensor.expose import expose

BAND = 2.2
"""Factor by which a ratio may be larger or smaller: less than the square root of five times noise and machines."""
RATIOS = {"expose": 1.0, "detect": 1.0, "calibrate": 1.0, "reconstruct": 1.0, "score": 1.0}
"""Processor time over the job's, as measured on an x86-64 machine with one thread."""


def least_s(work: Callable[[], object], times: int = 3) -> float:
    """Least processor time of all threads over some repetitions, in s."""
    found = []
    for _ in range(times):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return min(found)


def job() -> None:
    """Blurs, sorts, factorisations and small products: what stages do, by other people's code alone."""
    rng = np.random.default_rng(1)
    image = rng.random((1024, 1280)).astype(np.float32)
    for _ in range(6):
        image = cv2.GaussianBlur(image, (0, 0), 2.0)
        np.sort(image, axis=0)
    A = rng.random((400, 400))
    np.linalg.svd(A)
    small = rng.random((20_000, 6, 6))
    np.linalg.solve(small + 6 * np.eye(6), small)


def stages(run: Run) -> dict[str, Callable[[], object]]:
    """Each stage's work of one image, or of all where it has none of its own."""
    folder, scene = run.folder, run.scene
    name, measure, camera = run.stations[0], scene.measure, scene.camera
    radiance, frame = Radiance.load(folder / f"radiance/{name}.exr"), Frame.load(folder / f"frames/{name}.png")
    observations = Observations.load(folder / "observations.parquet")
    calibration, points = Calibration.load(folder / "calibration.json"), Points.load(folder / "points.parquet")
    calibrate, reconstruct = find("calibrators", measure.calibrator), find("reconstructors", measure.reconstructor)
    size = (camera.width_px, camera.height_px)
    world, views = run.world, run.views
    return {
        "expose": lambda: expose(radiance, sensor_of(scene), scene.seed),
        "detect": lambda: detect(frame, run.field, measure.centroid, measure.smallest_diameter_px),
        "calibrate": lambda: calibrate(observations, run.field, *size, camera.lens, measure.hold),
        "reconstruct": lambda: reconstruct(observations, calibration, run.field),
        "score": lambda: (score_detection(world, views, observations), score_points(world, calibration, points)),
    }


@pytest.mark.parametrize("stage", RATIOS)
def test_a_stage_takes_as_long_as_it_did_measured_by_a_fixed_job(quick: Run, stage: str) -> None:
    work = stages(quick)[stage]
    work()  # what is compiled or read once is not the stage's
    before = least_s(job)
    took = least_s(work)
    ratio = took / min(before, least_s(job))
    assert RATIOS[stage] / BAND < ratio < RATIOS[stage] * BAND, f"{stage}: {ratio:.3f} of the job's time"
