"""Everything in one image that was looked at."""

from dataclasses import dataclass, field

import numpy as np

from testfield.detect.find import Blobs
from testfield.detect.observations import Observations
from testfield.targets.marks import RingRadii


@dataclass(frozen=True)
class Targets:
    """Everything in one image that was looked at, n rows: `xy_px`, `cov_px2`, `moments_px2`, `chi2` and `misfit` as
    in `Centres`; `code` (n,) as `decode` gives it, `CROWDED` where nothing was read; `affine` (n, 2, 2) likewise;
    `status` (n,) `measured` or why not; `background_dn` and `contrast_dn` (n,) as in `Centres`; `left_out` how many
    blobs there were beyond `MOST_BLOBS`; `radii` the shape that the rings turned out to have; `passed_over` how many
    blobs have no row, by reason; `blobs` what was found before anything was asked of it."""

    xy_px: np.ndarray
    cov_px2: np.ndarray
    moments_px2: np.ndarray
    chi2: np.ndarray
    misfit: np.ndarray
    code: np.ndarray
    affine: np.ndarray
    status: np.ndarray
    background_dn: np.ndarray
    contrast_dn: np.ndarray
    left_out: int = 0
    radii: RingRadii | None = None
    passed_over: dict[str, int] = field(default_factory=dict)
    blobs: Blobs | None = None

    def observations(self, station: str, board: np.ndarray, point: np.ndarray) -> Observations:
        """As observations of one station, once the boards (n,) and points (n,) are known."""
        return Observations(
            stations=(station,),
            station=np.zeros(len(self.code), int),
            xy_px=self.xy_px,
            cov_px2=self.cov_px2,
            moments_px2=self.moments_px2,
            code=np.maximum(self.code, 0),
            board=board,
            point=point,
            chi2=self.chi2,
            status=self.status,
        )
