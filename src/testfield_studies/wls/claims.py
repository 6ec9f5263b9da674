"""What methods claim, narrower than their own sandwich, and the law that uncertainty follows."""

from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.reconstruct.estimate import Method, Solved, pixel_covariance, sandwich, settle
from testfield.reconstruct.ml import REPROJECTION
from testfield.reconstruct.parametric_wls import by_ray
from testfield.reconstruct.sights import rays_of, sights_of
from testfield.targets.field import Field


def narrower_claims(
    seen: Observations, calibration: Calibration, sheet: Field, methods: set[str]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By method, codes and (n, 3, 3) covariances in the calibration's frame that know less than the sandwich (METHODS
    section 1.6), of those that are among `methods`.

    `ml` by its pixels alone, as if the calibration were exact; `parametric_wls` by its own normal matrix, the inverse
    of sum D^T R^-1 D, as if no two cameras shared an error.
    """
    sights = sights_of(seen, calibration, sheet)
    claims = {}
    if "ml" in methods:
        pixels = settle(sights, calibration, REPROJECTION)
        claims["ml"] = (pixels.sights.code, sandwich(pixels)[0])
    if "parametric_wls" in methods:
        blocks = settle(sights, calibration, Method("parametric_wls", by_ray))
        claims["parametric_wls"] = (blocks.sights.code, normal_claim(blocks, calibration))
    return claims


def normal_claim(solved: Solved, calibration: Calibration) -> np.ndarray:
    """(n, 3, 3) inverses of sum D^T R^-1 D: what weighting each ray by its own covariance claims of the points."""
    n, k = solved.sights.there.shape
    gain = solved.gain.reshape(n, 3, k, 2)
    each = pixel_covariance(solved.sights, solved.rays, calibration)
    return np.einsum("nikl,nklm,njkm->nij", gain, each, gain)


def of_the_cameras(
    seen: Observations, calibration: Calibration, sheet: Field, codes: list[int], true_mm: np.ndarray
) -> dict[str, Any]:
    """The gain by the law of METHODS section 1.7, of ranges alone and with each ray's own noise, and how many cameras
    the latter's weights make (`law_cameras`), as means over the points; and unit normals (n, 3) of the planes in which
    the first two rays of each point lie."""
    every = sights_of(seen, calibration, sheet)
    place = {int(code): k for k, code in enumerate(every.code)}
    sights = every.take(np.array([place[code] for code in codes], int))
    depth = rays_of(sights, calibration, true_mm).depth_mm
    noise = np.sqrt(np.trace(sights.cov_px2, axis1=-2, axis2=-1))
    toward = calibration.stations.origin_mm[sights.station[:, :2]] - true_mm[:, None]
    normal = np.cross(toward[:, 0], toward[:, 1])
    return {
        "law_ranges": law(depth, sights.there)[0],
        "law_noise": law(depth * noise, sights.there)[0],
        "law_cameras": law(depth * noise, sights.there)[1],
        "normal": normal / np.linalg.norm(normal, axis=1, keepdims=True),
    }


def law(across: np.ndarray, there: np.ndarray) -> tuple[float, float]:
    """sqrt(<L^2> <1/L^2>) over the rays that are there, and the number of equal cameras that the weights w = 1/L^2
    come to, (sum w)^2 / sum w^2: both as means over points. `across` (n, k) is proportional to each ray's noise square
    to it. The law is of many cameras: where one weight outdoes all others it does not hold."""
    square = np.where(there, across, 1) ** 2
    weight = np.where(there, 1 / square, 0)
    n = there.sum(axis=1)
    mean, inverse = np.where(there, square, 0).sum(axis=1) / n, weight.sum(axis=1) / n
    cameras = weight.sum(axis=1) ** 2 / (weight**2).sum(axis=1)
    return float(np.sqrt(mean * inverse).mean()), float(cameras.mean())
