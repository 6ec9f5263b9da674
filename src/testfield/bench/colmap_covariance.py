"""The covariance alone, beside COLMAP's own: the same network at the same place, in the same run."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.datum import open_motions
from testfield.adjust.network import Layout
from testfield.bench.ceres import AS_COLMAP
from testfield.bench.networks import SIGMA_PX, free_network, plain_labels
from testfield.calibrate.as_colmap import as_reconstruction, free_bundle
from testfield.errors import TestfieldError

SIZES = {"small": (10, 300, None), "large": (400, 40_000, 16)}
"""Images, points and rays a point (None: every image sees every point)."""


def beside_colmap(images: int, points: int, rays: int | None, repeats: int) -> dict[str, Any]:
    """Times of both covariances, and how far standard uncertainties differ in COLMAP's datum.

    Ours are the covariance of all cameras and stations with each other, and that of every point with all of them
    estimated. COLMAP's are the former, and that of every point with all others held: those are compared as such.
    Setting the problem up counts for nobody; the derivatives count for both. `ratio` is the median of the paired ratios
    of time, ours over COLMAP's, `processor_ratio` that of processor time.
    """
    try:
        import pycolmap
    except ImportError:
        return {"skipped": "pycolmap is not installed: pip install 'testfield[peers]'"}
    network, _ = free_network(images, points, rays)
    labels = plain_labels(network)
    rebuilt, numbers = as_reconstruction(pycolmap, network, "OPENCV", AS_COLMAP)
    adjuster = free_bundle(pycolmap, rebuilt, images)
    options = pycolmap.BACovarianceOptions()
    options.damping = 0.0
    wall: list[list[float]] = [[], []]
    processor: list[list[float]] = [[], []]
    for _ in range(repeats):
        begin = _now()
        theirs = pycolmap.estimate_ba_covariance(options, rebuilt, adjuster)
        middle = _now()
        found = adjust(network, labels, most_steps=0)
        blocks = found.cov.point_blocks()
        end = _now()
        if theirs is None:
            raise TestfieldError("COLMAP gave no covariance")
        for k, (a, b) in enumerate(((middle, end), (begin, middle))):
            wall[k].append(b.wall - a.wall)
            processor[k].append(b.processor - a.processor)
    return {
        "images": images,
        "points": points,
        "observations": len(network.point),
        "ratio": float(np.median(np.divide(wall[0], wall[1]))),
        "processor_ratio": float(np.median(np.divide(processor[0], processor[1]))),
        "ours_s": float(np.median(wall[0])),
        "colmap_s": float(np.median(wall[1])),
        "ours_processor_s": float(np.median(processor[0])),
        "colmap_processor_s": float(np.median(processor[1])),
        "relative_difference_of_u": _difference(found, theirs, rebuilt, numbers),
        "mean_u_point_mm": float(np.sqrt(np.trace(blocks, axis1=1, axis2=2) / 3).mean()),
    }


@dataclass(frozen=True)
class _Moment:
    wall: float
    processor: float


def _now() -> _Moment:
    return _Moment(time.perf_counter(), time.process_time())


def _difference(found: Adjustment, theirs: Any, rebuilt: Any, numbers: list[int]) -> float:
    """The largest relative difference of any standard uncertainty: interior orientation, stations, points by
    themselves."""
    network, at = found.network, Layout.of(found.network)
    poses = [theirs.get_cam_cov_from_world(k + 1) for k in range(len(network.stations))]
    held, half_held = (next(k for k, p in enumerate(poses) if _free(p) == free) for free in (0, 5))
    fixed = [at.station + 6 * held + k for k in range(6)]
    interior = np.sqrt(np.diag(theirs.get_other_params_cov(rebuilt.camera(1).params)))
    H, tried = open_motions(network)[0], []
    for axis in range(3):  # COLMAP holds one coordinate of a second image, and does not say which
        seven = [*fixed, at.station + 6 * half_held + 3 + axis]
        u = np.sqrt(np.maximum(np.diag(_held(found.covariance, H, seven)), 0))
        off = [u[: len(interior)] / SIGMA_PX / interior]
        for k, pose in enumerate(poses):
            if _free(pose) == 6:
                # COLMAP's turns are parts of a quaternion: half as large.
                unit = np.array([0.5] * 3 + [1.0] * 3) / SIGMA_PX
                off.append(u[at.station + 6 * k : at.station + 6 * k + 6] * unit / np.sqrt(np.diag(pose)))
        tried.append(np.abs(np.concatenate(off) - 1).max())
    own = np.linalg.inv(found.equations.point_normal)
    points = np.array([theirs.get_point_cov(number) for number in numbers])
    ratio = np.sqrt(np.einsum("nii->ni", own)) / SIGMA_PX / np.sqrt(np.einsum("nii->ni", points))
    return float(max(min(tried), np.abs(ratio - 1).max()))


def _free(pose: np.ndarray | None) -> int:
    return 0 if pose is None else len(pose)


def _held(C: np.ndarray, H: np.ndarray, fixed: list[int]) -> np.ndarray:
    """A covariance (P, P) with open motions H (P, 7) transformed to the datum in which seven unknowns are held."""
    W = np.linalg.solve(H[fixed].T, H.T).T
    across = W @ C[fixed]
    return np.asarray(C - across - across.T + W @ C[np.ix_(fixed, fixed)] @ W.T)
