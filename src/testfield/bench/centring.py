"""One case of the centring benchmark: every estimator on many exposures of one board.

Estimators start from rough places and sizes, as a search for blobs leaves them, and are called as `detect` calls them.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from testfield.bench.bound import closed_form_px, cramer_rao
from testfield.bench.dots import SIDE, Case, Dots, render_dots
from testfield.bench.scatter import figures
from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.detect import measure_targets
from testfield.detect.observations import MEASURED
from testfield.registry import find, names
from testfield.seeds import generator
from testfield.sensor.expose import expose
from testfield.targets.marks import RADII, USUAL

SEED = 1
BITS = 14
NEAR_PX = 2.0
"""How far from where a dot was looked for it may be found."""
BEST, KNOWN, GRID = "forward_model", "forward_model, camera known", "opencv_circles_grid"
ROUGH_PX, ROUGH_SIZE = 0.2, 1.05
"""How far off, and how much too large, a search leaves its blobs."""
SMALLEST_BLOB, MOST_BLOBS = 0.4, 2.0
"""Of a dot's area, and of the number of dots: where noise makes many blobs OpenCV's search for a grid does not end."""

Estimator = Callable[[np.ndarray, SensorSheet, np.ndarray, np.ndarray], Centres]


@dataclass(frozen=True)
class Task:
    """A `case` and how often it is exposed: for the forward model, for it with the camera known, for all others."""

    case: Case
    exposures: int
    of_known: int
    of_others: int


def measure(task: Task, only: str = "") -> dict[str, Any]:
    """The bound, and what each estimator (`only` one of them where named) makes of a case."""
    case, dots = task.case, render_dots(task.case, SEED)
    bound, uneven = cramer_rao(dots)
    rough, sheet = generator(SEED, f"bench/rough/{case}"), dots.sensor.sheet
    tried = {name: e for name, e in estimators(dots, case.coded).items() if only in ("", name)}
    times = {name: task.of_others for name in tried} | {BEST: task.exposures, KNOWN: task.of_known}
    results: dict[str, list[Centres]] = {name: [] for name in tried if times[name]}
    for k in range(max(times.values())):
        station = replace(dots.radiance, station=f"{case}/{k}")
        image = expose(station, dots.sensor, SEED).pixels_dn.astype(np.float32)
        xy = dots.xy_px + ROUGH_PX * rough.standard_normal(dots.xy_px.shape)
        moments = ROUGH_SIZE * dots.moments_px2 + (0.1 + case.blur_px**2 / 4) * np.eye(2)
        for name, runs in results.items():
            if k < times[name]:
                runs.append(tried[name](image, sheet, xy, moments))
    return {
        "case": asdict(case),
        "dots": len(dots.xy_px),
        "bound_px": _rms_sigma(bound),
        "bound_with_unknown_gradient_px": _rms_sigma(uneven),
        "closed_form_px": closed_form_px(dots),
        "estimators": {name: figures(runs, dots.xy_px, bound) for name, runs in results.items()},
    }


def estimators(dots: Dots, coded: bool = False) -> dict[str, Estimator]:
    """All that are registered, called plainly; the forward model with the camera; OpenCV's grid detector."""
    chosen: dict[str, Estimator] = {name: find("centroids", name) for name in names("centroids")}
    chosen[KNOWN] = partial(chosen[BEST], interior=dots.world.interior)  # type: ignore[call-arg]
    if coded:
        chosen[BEST] = with_rings
    return chosen | {GRID: circles_grid}


def with_rings(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """Dots of ring codes as a run measures them: found, centred, read, and fitted once more together with their rings.
    What is not found, or turned down, is not measured."""
    smallest_px = 0.7 * 4 * float(np.linalg.det(moments_px2).min() ** 0.25)
    targets = measure_targets(image_dn, sheet, BEST, smallest_px, BITS, RADII[USUAL])
    found = Centres.empty(len(xy_px))
    good = np.flatnonzero((targets.status == MEASURED) & (targets.code > 0))
    if len(good) == 0:
        return found
    distance = np.linalg.norm(xy_px[:, None] - targets.xy_px[good], axis=-1)
    nearest, ok = good[np.argmin(distance, axis=1)], distance.min(axis=1) < NEAR_PX
    for name in ("xy_px", "cov_px2", "moments_px2", "chi2", "misfit"):
        getattr(found, name)[ok] = getattr(targets, name)[nearest[ok]]
    found.ok[:] = ok
    return found


def circles_grid(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """OpenCV's findCirclesGrid on the whole board; it finds all dots or none, and claims no uncertainty."""
    found = Centres.empty(len(xy_px))
    low, high = np.percentile(image_dn, [5, 99.8])
    grey = (255 - 235 * ((image_dn - low) / max(high - low, 1.0)).clip(0, 1)).astype(np.uint8)
    settings = cv2.SimpleBlobDetector.Params()
    settings.minArea = SMALLEST_BLOB * 4 * np.pi * float(np.sqrt(np.linalg.det(moments_px2)).min())
    settings.maxArea, settings.minDistBetweenBlobs = 1e6, 5
    detector = cv2.SimpleBlobDetector.create(settings)
    if len(detector.detect(grey)) > MOST_BLOBS * len(xy_px):
        return found
    good, points = cv2.findCirclesGrid(grey, (SIDE, SIDE), flags=cv2.CALIB_CB_SYMMETRIC_GRID, blobDetector=detector)
    if good:
        points = points.reshape(-1, 2).astype(float)
        nearest = np.argmin(np.linalg.norm(xy_px[:, None] - points, axis=-1), axis=1)
        found.xy_px[:] = points[nearest]
        found.ok[:] = np.linalg.norm(points[nearest] - xy_px, axis=1) < 2
    return found


def _rms_sigma(covariance: np.ndarray) -> float:
    return float(np.sqrt(np.einsum("nii->n", covariance).mean() / 2))
