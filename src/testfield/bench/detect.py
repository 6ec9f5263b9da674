"""Centring against the physical limit: every estimator on rendered series that vary one thing at a time.

A board of 64 dots is rendered once a case and exposed many times; estimators start from rough places and sizes, as a
search for blobs leaves them. Scatter is compared with the Cramer-Rao bound of each dot, claimed covariances with the
scatter, and means with the exact centres.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from scipy.stats import chi2 as chi_squared

from testfield.bench.bound import UNEVEN, closed_form_px, cramer_rao
from testfield.bench.dots import SIDE, Case, Dots, render_dots
from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.registry import find, names
from testfield.seeds import generator
from testfield.sensor.expose import expose

FACTORS: dict[str, tuple[str, list[Any]]] = {
    "diameter": ("diameter_px", [4.0, 5.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 40.0]),
    "tilt": ("tilt_deg", [0.0, 15.0, 30.0, 45.0, 60.0, 65.0, 70.0]),
    "snr": ("snr", [5.0, 10.0, 20.0, 50.0, 100.0, 200.0]),
    "blur": ("blur_px", [0.4, 0.6, 0.8, 1.2, 2.0, 3.0]),
    "gradient": ("gradient", [0.0, 0.01, 0.02, 0.03, 0.04]),
    "phase": ("phase", [(0.0, 0.0), (0.125, 0.0), (0.25, 0.0), (0.375, 0.0), (0.5, 0.0), (0.5, 0.5)]),
}
"""What is varied, from the least to the most; all else is as `Case` has it."""
QUICK = {"diameter": (2, 4, 6), "tilt": (0, 4), "snr": (2, 5), "blur": (0, 3), "gradient": (4,), "phase": (2,)}
CORNERS = [
    Case(6.0, 60.0, 20.0), Case(6.0, 60.0, 200.0), Case(6.0, 0.0, 20.0), Case(40.0, 60.0, 200.0),
    Case(40.0, 0.0, 200.0), Case(40.0, 60.0, 20.0), Case(12.0, 60.0, 200.0, 0.7, 0.01),
]  # fmt: skip
"""Where the requirement's range ends in several ways at once."""
BEST, EXPOSURES, EXPOSURES_OF_OTHERS = "forward_model", 64, 24
GRID = "opencv_circles_grid"
LEAST_EFFICIENCY, MOST_BIAS, CHI2, MOST_LOST = 0.9, 0.1, (0.9, 1.1), 0.002

Estimator = Callable[[np.ndarray, SensorSheet, np.ndarray, np.ndarray], Centres]


def bench_detect(quick: bool, tell: Callable[[str], None]) -> dict[str, Any]:
    """All series and the verdicts on the forward model; `tell` hears what is being done."""
    series: dict[str, list[dict[str, Any]]] = {}
    for factor, case in _cases(quick):
        tell(f"{factor}: {case}")
        series.setdefault(factor, []).append(measure(case, 16 if quick else EXPOSURES, 6 if quick else None))
    return {"quick": quick, "series": series, "verdicts": verdicts(series)}


def _cases(quick: bool) -> Iterator[tuple[str, Case]]:
    for factor, (field, values) in FACTORS.items():
        chosen = [values[k] for k in QUICK[factor]] if quick else values
        for value in chosen:
            # A phase is the same for all dots only on a board that is seen straight.
            yield factor, replace(Case(tilt_deg=0.0) if factor == "phase" else Case(), **{field: value})
    for case in CORNERS[:2] if quick else CORNERS:
        yield "corners", case


def estimators(dots: Dots) -> dict[str, Estimator]:
    """All that are registered, the forward model with the camera, and OpenCV's grid detector."""
    chosen: dict[str, Estimator] = {name: find("centroids", name) for name in names("centroids")}
    if BEST in chosen:
        chosen[BEST] = partial(chosen[BEST], interior=dots.world.interior)  # type: ignore[call-arg]
    return chosen | {GRID: circles_grid}


def circles_grid(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """OpenCV's findCirclesGrid on the whole board; it finds all dots or none, and claims no uncertainty."""
    found = Centres.empty(len(xy_px))
    low, high = np.percentile(image_dn, [5, 99.8])
    grey = (255 - 235 * ((image_dn - low) / max(high - low, 1.0)).clip(0, 1)).astype(np.uint8)
    settings = cv2.SimpleBlobDetector.Params()
    settings.minArea, settings.maxArea = 4, 1e6
    settings.minDistBetweenBlobs = 5
    good, points = cv2.findCirclesGrid(
        grey, (SIDE, SIDE), flags=cv2.CALIB_CB_SYMMETRIC_GRID, blobDetector=cv2.SimpleBlobDetector.create(settings)
    )
    if good:
        points = points.reshape(-1, 2).astype(float)
        nearest = np.argmin(np.linalg.norm(xy_px[:, None] - points, axis=-1), axis=1)
        found.xy_px[:] = points[nearest]
        found.ok[:] = np.linalg.norm(points[nearest] - xy_px, axis=1) < 2
    return found


def measure(case: Case, exposures: int, exposures_of_others: int | None = None, only: str = "") -> dict[str, Any]:
    """One case: the bound, and what each estimator makes of so many exposures (`only` one of them where named)."""
    dots = render_dots(case, 1)
    bound = cramer_rao(dots)
    rough, sheet = generator(1, f"bench/rough/{case}"), dots.sensor.sheet
    tried = {name: e for name, e in estimators(dots).items() if only in ("", name)}
    results: dict[str, list[Centres]] = {name: [] for name in tried}
    for k in range(exposures):
        station = replace(dots.radiance, station=f"{case}/{k}")
        image = expose(station, dots.sensor, 1).pixels_dn.astype(np.float32)
        # As a search for blobs leaves them: a fifth of a pixel off, and too large by the blur.
        xy = dots.xy_px + 0.2 * rough.standard_normal(dots.xy_px.shape)
        moments = 1.05 * dots.moments_px2 + (0.1 + case.blur_px**2 / 4) * np.eye(2)
        for name, estimate in tried.items():
            if name == BEST or k < (exposures_of_others or EXPOSURES_OF_OTHERS):
                results[name].append(estimate(image, sheet, xy, moments))
    return {
        "case": vars(case),
        "dots": len(dots.xy_px),
        "bound_px": _rms_sigma(bound),
        "bound_with_unknown_gradient_px": _rms_sigma(cramer_rao(dots, UNEVEN)),
        "closed_form_px": closed_form_px(dots),
        "estimators": {name: figures(runs, dots.xy_px, bound) for name, runs in results.items()},
    }


def figures(runs: list[Centres], true_px: np.ndarray, bound_px2: np.ndarray) -> dict[str, Any]:
    """What an estimator's runs over the same n dots are worth; bands are of 95 %.

    Efficiency and scatter are about each dot's own mean; `bias` is the mean error of all dots in units of the
    scatter, `bias_by_dot` the rms of each dot's own, less what chance makes of it; `chi2` of the errors by the claimed
    covariance, per degree of freedom.
    """
    ok = np.stack([run.ok for run in runs])
    error = np.where(ok[..., None], np.stack([run.xy_px for run in runs]) - true_px, np.nan)
    measured = int(ok.sum())
    nothing = {"measured": measured, "not_measured": int(ok.size - measured)}
    often = ok.sum(axis=0) >= 3
    if often.sum() < 5:
        return nothing
    error, ok = error[:, often], ok[:, often]
    count = ok.sum(axis=0)
    mean = np.nanmean(error, axis=0)
    apart = (error - mean) * np.sqrt(count / (count - 1))[:, None]
    sizes = np.einsum("rni,nij,rnj->rn", apart, np.linalg.inv(bound_px2[often]), apart)
    freedom = 2 * int((count - 1).sum())
    efficiency = float(2 / np.nanmean(sizes))
    sigma = float(np.sqrt(np.nanmean(apart**2)))
    low, high = chi_squared.ppf([0.025, 0.975], freedom) / freedom
    common = np.hypot(*np.nanmean(error, axis=(0, 1))) / sigma
    # Efron: each dot's mean has scatter of its own.
    by_dot = np.mean(np.sum(mean**2, axis=1) - 2 * sigma**2 / count) / 2
    result = nothing | {
        "sigma_px": sigma,
        "sigma_band_px": [sigma / np.sqrt(high), sigma / np.sqrt(low)],
        "rms_px": float(np.sqrt(np.nanmean(error**2))),
        "efficiency": efficiency,
        "efficiency_band": [efficiency * low, efficiency * high],
        "bias": float(common),
        "bias_band": float(np.sqrt(chi_squared.ppf(0.95, 2) / ok.sum())),
        "bias_by_dot": float(np.sqrt(max(by_dot, 0)) / sigma),
    }
    covariance = np.stack([run.cov_px2 for run in runs])[:, often]
    claimed = ok & np.isfinite(covariance).all(axis=(2, 3)) & (np.linalg.det(np.nan_to_num(covariance)) > 0)
    if claimed.any():
        e = error[claimed]
        nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariance[claimed]), e) / 2
        half = 1.96 * float(nees.std()) / np.sqrt(len(nees))
        result |= {"chi2": float(nees.mean()), "chi2_band": [float(nees.mean()) - half, float(nees.mean()) + half]}
    return result


def _rms_sigma(covariance: np.ndarray) -> float:
    return float(np.sqrt(np.einsum("nii->n", covariance).mean() / 2))


def in_range(case: dict[str, Any]) -> bool:
    """Whether the requirement speaks of a case: 6 to 40 px, SNR 20 to 200, tilt to 60 degrees."""
    return 6 <= case["diameter_px"] <= 40 and 20 <= case["snr"] <= 200 and case["tilt_deg"] <= 60


def verdicts(series: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """The forward model's worst figures in the range required, and whether they keep their limits."""
    rows = [row for part in series.values() for row in part if in_range(row["case"])]
    best = [row["estimators"][BEST] for row in rows]
    chi2 = [b.get("chi2", np.nan) for b in best]
    # A mean of chi-squared over a series; cases differ only by chance where the claim is honest.
    overall = float(np.mean(chi2))
    lost = max(b["not_measured"] / (b["measured"] + b["not_measured"]) for b in best)
    bias = max(b.get("bias", np.inf) for b in best)
    return [
        _verdict("least efficiency", min(b.get("efficiency", 0) for b in best), LEAST_EFFICIENCY, None),
        _verdict("greatest bias, in sigma", bias, None, MOST_BIAS),
        _verdict("chi-squared per degree of freedom, over all", overall, *CHI2),
        _verdict("the same, least case", min(chi2), CHI2[0], None),
        _verdict("the same, greatest case", max(chi2), None, CHI2[1]),
        _verdict("largest part of dots not measured", lost, None, MOST_LOST),
    ]


def _verdict(name: str, measured: float, least: float | None, most: float | None) -> dict[str, Any]:
    passed = (least is None or measured >= least) and (most is None or measured <= most)
    return {"name": name, "measured": float(measured), "least": least, "most": most, "passed": bool(passed)}
