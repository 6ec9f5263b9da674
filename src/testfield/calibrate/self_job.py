"""What a self-calibration adjusts, and what it finds."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.adjust.network import Network
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.certified import Certified
from testfield.calibrate.imaging import Imaging
from testfield.calibrate.ties import Ties, point_name


@dataclass(frozen=True)
class FreeNetwork:
    """The result of a self-calibration.

    `calibration` with stations in the datum; points `code` (n,) (negative: dots without a code) at `xyz_mm` (n, 3) with
    joint covariance `cov_xyz_mm2` (3n, 3n), seen in `rays` (n,) images with `residual_rms_px` (n,), `rejected` (n,)
    sights turned down; `scale_from` what the scale rests on; `job` that was adjusted last, and the one
    to `begin` again from, without what is said in the end; `adjustment` itself.
    """

    calibration: Calibration
    code: np.ndarray
    xyz_mm: np.ndarray
    cov_xyz_mm2: np.ndarray
    rays: np.ndarray
    residual_rms_px: np.ndarray
    rejected: np.ndarray
    scale_from: str
    job: "Job"
    adjustment: Adjustment
    begin: "Job"

    @property
    def labels(self) -> list[str]:
        """Names of the adjustment's unknowns."""
        return replace(self.job, network=self.adjustment.network).labels


@dataclass(frozen=True)
class Job:
    """What is adjusted: `network`, its `ties` in the same order, `radius_mm` (n,) of the discs (NaN: none), `stations`
    names; `rejected` records; `notes`; what is `certified`, tested or not; `shared` targets that each image had in
    common with others to begin with; `failures` that were there before anything was adjusted. Of several cameras,
    `imaging` says which took which image, by the names of all images; `places` are those of the network's stations
    where cameras or rigs stood at one for several images."""

    network: Network
    ties: Ties
    radius_mm: np.ndarray
    scale_from: str
    rejected: tuple[dict, ...]
    notes: tuple[str, ...]
    certified: Certified
    shared: dict[str, int]
    failures: tuple[str, ...] = ()
    imaging: Imaging | None = None
    places: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """Names of the unknowns."""
        names = tuple(point_name(int(c)) for c in self.ties.code)
        members = self.imaging.member_names if self.imaging and self.places else ()
        return self.network.labels(self.places or self.ties.stations, (), self.cameras, names, members)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of several cameras; empty for one."""
        return tuple(camera.name for camera in self.imaging.cameras) if self.imaging else ()
