"""Monte Carlo over a run: trials in three depths, kept in the run's folder as long as their inputs are the same.

`rays`: pixels and calibration drawn from their covariances, the points met again. `calibration`: noise on every pixel
and certificates drawn anew, then the whole calibration and reconstruction. `exposure`: new noise on the same radiance,
certificates drawn anew, then detection, calibration and reconstruction. Every trial has a seed of its own by name.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.chain.keys import board_modules, lens_modules
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.pipeline import measure
from testfield.measure.weights import weighed_by
from testfield.reconstruct.points import Points
from testfield.registry import module_of
from testfield.seeds import seed_of
from testfield.store.code import code_digest
from testfield.store.digests import digest, file_digest
from testfield.store.threads import one_blas_thread

DEPTHS = ("rays", "calibration", "exposure")
BLOCK = 10_000
"""Trials in a file of the depth `rays`."""


@dataclass(frozen=True)
class Trials:
    """Trials of a run in one depth, made when asked for."""

    run: Run
    depth: str

    @cached_property
    def observations(self) -> Observations:
        """The run's observations, weighed as its points were."""
        return weighed_by(Observations.load(self.run.need("observations.parquet", "detect")), self.calibration)

    @cached_property
    def calibration(self) -> Calibration:
        """The run's calibration. Raises `TestfieldError` where it states no covariance: there is nothing to draw."""
        path = self.run.need("calibration.json", "calibrate")
        found = Calibration.load(path)
        if not found.states_u:
            raise TestfieldError(
                f"'{found.method}' states no covariance, and trials are drawn from it",
                str(path),
                "choose a calibrator that states one",
            )
        return found

    @cached_property
    def points(self) -> Points:
        """The run's points: the estimate whose uncertainty is in question."""
        return Points.load(self.run.need("points.parquet", "reconstruct"))

    @cached_property
    def key(self) -> str:
        """Digest of everything the trials depend on but their number."""
        run, asked = self.run, self.run.scene.measure
        inputs = [run.need(name, maker) for name, maker in _INPUTS]
        modules = {"testfield.chain.trials", module_of("reconstructors", asked.reconstructor)}
        names: list[str] = []
        if self.depth == "rays":
            modules |= {"testfield.uncertainty.rays"}
        else:
            modules |= {"testfield.uncertainty.certificates", module_of("calibrators", asked.calibrator)}
        if self.depth == "exposure":
            modules |= {"testfield.sensor.expose", "testfield.detect.detect"}
            inputs += [run.need(f"radiance/{name}.exr", "render") for name in run.stations]
            for part in run.truth.parts:
                sensor = {**part.scene.sensor.model_dump(), "exposure": part.scene.exposure.model_dump()}
                names += [repr(sensor), repr(part.scene.camera.model_dump())]
        code = code_digest(*sorted(modules), *lens_modules(run.scene), *board_modules(run.field))
        files = [file_digest(path) for path in inputs]
        return digest(code, files, run.field, run.scene.seed, asked.model_dump(), names)

    def block(self, number: int) -> np.ndarray:
        """(BLOCK, n, 3) positions of one block of the depth `rays`."""
        from testfield.uncertainty.rays import RayTrials

        def write(path: Path) -> None:
            method = self.run.scene.measure.reconstructor
            ready = RayTrials.of(self.observations, self.calibration, self.run.field, method)
            if not np.array_equal(ready.code, self.points.code):
                raise TestfieldError(
                    "the points are not those of these observations",
                    str(self.run.folder / "points.parquet"),
                    f"make them again with `testfield reconstruct {self.run.folder}`",
                )
            trials = range(number * BLOCK, (number + 1) * BLOCK)
            drawn = ready.draw(trials, seed_of(self.run.scene.seed, "uncertainty/rays"))
            # Deviations need fewer digits than positions.
            _save(path, (drawn - self.points.xyz_mm).astype(np.float32))

        return self._kept(f"uncertainty/rays/{number:04d}.npy", write)

    def trial(self, number: int) -> np.ndarray:
        """(n, 3) positions of one trial of the other depths; NaN for a point that it did not find."""
        return self._kept(self.name(number), partial(self.write, number))

    def name(self, number: int) -> str:
        """The file of one trial of the other depths."""
        return f"uncertainty/{self.depth}/{number:04d}.npy"

    def write(self, number: int, path: Path) -> None:
        """Make one trial of the other depths, and write how far off its points are."""
        found = self._again(number)
        row = {int(code): k for k, code in enumerate(found.code)}
        off = np.full(self.points.xyz_mm.shape, np.nan)
        for k, code in enumerate(self.points.code):
            if int(code) in row:
                off[k] = found.xyz_mm[row[int(code)]] - self.points.xyz_mm[k]
        _save(path, off)

    def _kept(self, name: str, write: Callable[[Path], None]) -> np.ndarray:
        with one_blas_thread():
            self.run.ledger.make(name, self.key, write)
        return self.points.xyz_mm + np.load(self.run.folder / name)

    def _again(self, number: int) -> Points:
        from testfield.uncertainty.certificates import draw_certificates, draw_pixels

        run = self.run
        seed = seed_of(run.scene.seed, f"uncertainty/{self.depth}/{number}")
        if self.depth == "calibration":
            observations = draw_pixels(self.observations, run.field, seed)
        else:
            observations = reexposed(run, seed_of(run.scene.seed, f"uncertainty/exposure/{number}/noise"))
        observations, field = draw_certificates(observations, self.calibration, run.field, seed)
        return measure(observations, field, recipe_of(run.scene)).points


def reexposed(run: Run, seed: int) -> Observations:
    """Observations of new frames of the run's radiance, their noise drawn from `seed`. The frames are not kept.

    The sensor's fixed patterns are the run's own: it is the same camera.
    """
    from testfield.camera.images import Radiance
    from testfield.measure.pipeline import detect
    from testfield.scene.exposure import sensor_of
    from testfield.sensor.expose import expose

    parts = []
    for part, _, _, name in run.truth.images():
        radiance = Radiance.load(run.need(f"radiance/{name}.exr", "render"))
        frame = expose(radiance, sensor_of(part.scene), part.sensor_seed, noise_seed=seed)
        parts.append(detect(frame, run.field, recipe_of(run.scene)))
    return run.truth.by_cameras(Observations.join(parts, run.stations))


_INPUTS = (("observations.parquet", "detect"), ("calibration.json", "calibrate"), ("points.parquet", "reconstruct"))


def _save(path: Path, values: np.ndarray) -> None:
    with path.open("wb") as file:
        np.save(file, values)
