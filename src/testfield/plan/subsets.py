"""A job with some of its stations and some candidates: any network that could be photographed, predicted like the
scene's own."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testfield.camera.pose import Poses
from testfield.errors import TestfieldError
from testfield.plan.candidates import Candidates
from testfield.plan.job import Job
from testfield.plan.network import planned
from testfield.plan.predict import Prediction, predict
from testfield.simulate.expected import Expected


@dataclass(frozen=True)
class Choice:
    """A job of S stations and c candidates, which are numbered after them."""

    job: Job
    candidates: Candidates

    @property
    def stations(self) -> int:
        """How many stations the scene has."""
        return len(self.job.images)

    @cached_property
    def _all(self) -> tuple[Poses, tuple[str, ...], Expected, np.ndarray]:
        new = self.candidates.expected
        rows = Expected.join([self.job.expected, replace(new, station=new.station + self.stations)])
        order = np.argsort(rows.station, kind="stable")
        rows = rows.take(order)
        places = self.candidates.poses.origin_mm
        names = (
            *self.job.images,
            *(f"proposed at ({x:.0f}, {y:.0f}, {z:.0f}) [{k}]" for k, (x, y, z) in enumerate(places)),
        )
        first = np.searchsorted(rows.station, np.arange(len(names) + 1))
        return Poses.join([self.job.poses, self.candidates.poses]), names, rows, first

    def rows_of(self, number: int) -> Expected:
        """What one station or candidate sees."""
        _, _, rows, first = self._all
        return rows.take(np.arange(first[number], first[number + 1]))

    def with_stations(self, chosen: list[int]) -> Job:
        """The job as if it had these stations and candidates alone."""
        poses, names, _, _ = self._all
        index = np.array(chosen, int)
        parts = [replace(self.rows_of(k), station=np.full(len(self.rows_of(k)), n)) for n, k in enumerate(chosen)]
        world = replace(self.job.world, station_name=tuple(names[k] for k in chosen), camera_from_world=poses[index])
        return replace(self.job, world=world, worlds=(world,), expected=Expected.join(parts))

    def predict(self, chosen: list[int], pixel_factor: float = 1.0) -> Prediction | None:
        """The prediction of these stations; None where they determine nothing."""
        if not chosen:
            return None
        try:
            return predict(planned(self.with_stations(chosen)), pixel_factor)
        except (TestfieldError, np.linalg.LinAlgError):
            return None
