"""What settling a start leaves, and how residuals are sized."""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.calibrate.misfit import NO_MISFIT, Misfit

NOT_CONVERGED = "the bundle had not converged"
"""How the note begins that tells it."""
REJECT_SIGMA = 6.0
"""An observation is rejected whose residual is larger than this many of its own standard deviations."""


@dataclass(frozen=True)
class Settled:
    """An adjustment, the records of observations `rejected` on the way, `notes` for the reader; the `left` of the
    start's observations (an index); `certificates` tested and `failures` as in `Calibration`; the `misfit` that is in
    its model, and the factor by which all observed covariances were `widened`; where there is a misfit, the adjustment
    by the `plain` model, whose residuals are tested: a wrong certificate must not pass for a lens.

    Where a board's sheet is `wrong` (its place in the start), or a `lost` image contradicts the others, all must begin
    again without it.
    """

    adjustment: Adjustment
    rejected: list[dict]
    notes: list[str]
    left: np.ndarray
    certificates: tuple[dict, ...] = ()
    failures: tuple[str, ...] = ()
    wrong: int | None = None
    lost: int | None = None
    misfit: Misfit = NO_MISFIT
    widened: float = 1.0
    plain: Adjustment | None = None

    @property
    def begin_again(self) -> bool:
        """Whether a board or an image must be left out first."""
        return self.wrong is not None or self.lost is not None


def residual_sizes(adjustment: Adjustment, scaled: bool = True) -> np.ndarray:
    """(m,) residuals in units of their standard deviations, those of the adjustment's overall misfit where `scaled`."""
    white = np.linalg.solve(np.linalg.cholesky(adjustment.network.cov_px2), adjustment.residual_px[..., None])[..., 0]
    size = np.linalg.norm(white, axis=1)
    if not scaled:
        return size
    typical = np.median(size) / 1.1774  # the median length of a standard normal vector in the plane
    return size / max(typical, 1.0)
