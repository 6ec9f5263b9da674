"""What an algorithm of one's own hands on, taken at the door: statements that say nothing become none.

A covariance of zeros or of NaN, or of another shape than its labels, is none: it is taken out, and what needs one says
that none was stated. Anything else that an algorithm must not hand on is named here, with the algorithm.
"""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.store.sheets import semidefinite


def taken_observations(found: object, name: str) -> Observations:
    """Observations as a detector or a centroid estimator gave them, every measured row at a finite place."""
    if not isinstance(found, Observations):
        raise _no(found, "Observations", name)
    bad = (found.status == "measured") & ~np.isfinite(found.xy_px).all(axis=1)
    return found if not bad.any() else replace(found, status=np.where(bad, "no finite place", found.status))


def taken_calibration(found: object, name: str) -> Calibration:
    """A calibration as a calibrator gave it, without a covariance that says nothing.

    Raises `TestfieldError` where it is none, or its parameters or poses are not finite.
    """
    if not isinstance(found, Calibration):
        raise _no(found, "a Calibration", name)
    for what, values in (
        ("the interior orientation", np.concatenate([camera.parameters for camera in found.interiors])),
        ("the exterior orientations", np.concatenate([found.stations.R.ravel(), found.stations.t_mm.ravel()])),
        ("the poses of boards", np.concatenate([found.boards.R.ravel(), found.boards.t_mm.ravel()])),
    ):
        if not np.isfinite(values).all():
            raise TestfieldError(f"{what} of '{name}' is not finite", "calibrator", "look at the observations it had")
    cov, unknowns = np.asarray(found.covariance, float), len(found.labels)
    said = cov.shape == (unknowns, unknowns) and np.isfinite(cov).all() and (np.diag(cov) >= 0).all() and cov.any()
    if said and not semidefinite(cov):
        raise _not_semidefinite("covariance", name, "calibrator")
    if unknowns and not said:
        return replace(found, covariance=np.zeros((0, 0)), labels=())
    if not unknowns and cov.shape != (0, 0):
        return replace(found, covariance=np.zeros((0, 0)))
    silent = [name for name, variance in zip(found.labels, np.diag(cov), strict=True) if variance == 0]
    return without(found, silent)


def without(found: Calibration, silent: list[str]) -> Calibration:
    """The same without the unknowns of which nothing is said; of a station or board one such takes all six."""
    if not silent:
        return found
    owners = {name.rpartition(".")[0] for name in silent if "." in name}
    keep = [k for k, name in enumerate(found.labels) if name not in silent and name.rpartition(".")[0] not in owners]
    labels = tuple(found.labels[k] for k in keep)
    return replace(found, labels=labels, covariance=found.covariance[np.ix_(keep, keep)])


def taken_points(found: object, name: str) -> Points:
    """Points as a reconstructor gave them, with a covariance of NaN where it says nothing."""
    if not isinstance(found, Points):
        raise _no(found, "Points", name)
    n, cov = len(found.code), np.asarray(found.cov_xyz_mm2, float)
    if np.shape(found.xyz_mm) != (n, 3):
        raise TestfieldError(
            f"'{name}' gives positions of shape {np.shape(found.xyz_mm)} of {n} codes", "reconstructor", "give (n, 3)"
        )
    if cov.shape == (3 * n, 3 * n) and cov.any() and (not n or not np.isnan(cov).all()):
        if np.isfinite(cov).all() and not ((np.diag(cov) >= 0).all() and semidefinite(cov)):
            raise _not_semidefinite("cov_xyz_mm2", name, "reconstructor")
        return found
    return replace(found, cov_xyz_mm2=np.full((3 * n, 3 * n), np.nan))


def _not_semidefinite(field: str, name: str, where: str) -> TestfieldError:
    return TestfieldError(
        f"{field} of '{name}' is no covariance: it is not positive semidefinite", where, "state one, or leave it out"
    )


def _no(found: object, wanted: str, name: str) -> TestfieldError:
    return TestfieldError(f"'{name}' gives a {type(found).__name__} and not {wanted}", "recipe", f"return {wanted}")
