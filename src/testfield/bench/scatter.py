"""What many measurements of the same centres are worth: scatter, bias without chance, honesty of the claim."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import ncx2

from testfield.detect.centre import Centres
from testfield.statistics.clusters import cluster_means, mean_of_clusters
from testfield.statistics.jackknife import jackknife_ratio

LEAST_TIMES, LEAST_DOTS = 3, 5
"""A dot counts where it was measured so often; a case where so many dots count."""
CONFIDENCE = 0.95
TAILS = ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)


def figures(runs: Sequence[Centres], true_px: np.ndarray, bound_px2: np.ndarray) -> dict[str, Any]:
    """An estimator's runs over the same n dots, of true centres (n, 2) and least covariances (n, 2, 2).

    Bands are of 95 %, from the spread between exposures: dots of one share what they believe of the light. Scatter
    (`sigma_px`) and `efficiency` are about each dot's own mean. `bias` is the length of the mean error of all dots
    together, `bias_by_dot` the rms of each dot's own mean error, a coordinate: in units of `sigma_px`, as `_seen`, then
    less what chance makes of it, and with a band. `chi2` is of the errors by the claimed covariance, per degree of
    freedom.
    """
    ok = np.stack([run.ok for run in runs])
    error = np.where(ok[..., None], np.stack([run.xy_px for run in runs]) - true_px, np.nan)
    result: dict[str, Any] = {"measured": int(ok.sum()), "not_measured": int(ok.size - ok.sum())}
    often = ok.sum(axis=0) >= LEAST_TIMES
    if often.sum() < LEAST_DOTS:
        return result
    error, ok = error[:, often], ok[:, often]
    count = ok.sum(axis=0)
    mean = np.nanmean(error, axis=0)
    apart = (error - mean) * np.sqrt(count / (count - 1))[:, None]
    sizes = np.einsum("rni,nij,rnj->rn", apart, np.linalg.inv(bound_px2[often]), apart)
    sigma = float(np.sqrt(np.nanmean(apart**2)))
    efficiency = float(2 / np.nanmean(sizes))
    # By exposure: coordinates, and the sums of their squares, plain and in units of the bound.
    coordinates, squares = 2 * ok.sum(axis=1), np.nansum(apart**2, axis=(1, 2))
    _, *sigma_band = jackknife_ratio(squares, coordinates, 0.5, CONFIDENCE)
    _, *efficiency_band = jackknife_ratio(coordinates, np.nansum(sizes, axis=1), p=CONFIDENCE)
    result |= {
        "exposures": len(runs),
        "sigma_px": sigma,
        "sigma_band_px": sigma_band,
        "rms_px": float(np.sqrt(np.nanmean(error**2))),
        "efficiency": efficiency,
        "efficiency_band": efficiency_band,
    }
    # Exposures share nothing: chance is judged by them.
    seen = ok.any(axis=1)
    together = np.nanmean(error[seen], axis=1)
    chance = float(together.var(axis=0, ddof=1).mean()) / seen.sum()
    by_dot = float(np.mean(np.nanvar(error, axis=0, ddof=1) / count[:, None]))
    result |= _bias("bias", np.nanmean(together, axis=0), chance, np.sqrt(2) / sigma)
    result |= _bias("bias_by_dot", mean, by_dot, 1 / sigma)

    covariance = np.stack([run.cov_px2 for run in runs])[:, often]
    claimed = ok & np.isfinite(covariance).all(axis=(2, 3)) & (np.linalg.det(np.nan_to_num(covariance)) > 0)
    if claimed.any():
        e = error[claimed]
        nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariance[claimed]), e) / 2
        value = float(nees.mean())
        by_exposure = mean_of_clusters(cluster_means(nees, np.nonzero(claimed)[0]))
        result |= {"chi2": value, "chi2_band": list(replace(by_exposure, value=value).interval(CONFIDENCE))}
    return result


def _bias(name: str, means: np.ndarray, variance: float, scale: float) -> dict[str, Any]:
    """`systematic`'s figures under a name, times `scale`."""
    seen, without, band = systematic(means, variance)
    return {f"{name}_seen": seen * scale, name: without * scale, f"{name}_band": [b * scale for b in band]}


CERTAIN = 1e7
"""Squares over variance beyond which chance is nothing."""


def systematic(means: np.ndarray, variance: float) -> tuple[float, float, tuple[float, float]]:
    """The rms of means that each have a chance part of `variance`: as seen, less chance, and the band of the latter.

    The sum of the means' squares over `variance` is a non-central chi-squared; the band holds those systematic parts
    under which it is neither improbably large nor improbably small.
    """
    squares = float(np.sum(means**2))
    seen = np.sqrt(squares / means.size)
    without = np.sqrt(max(squares / means.size - variance, 0))
    if squares > CERTAIN * variance:  # there is no chance in it, and no distribution to ask
        return float(seen), float(seen), (float(seen), float(seen))

    def by_centrality(probability: float) -> float:
        def off(centrality: float) -> float:
            return float(ncx2.cdf(squares / variance, means.size, centrality)) - probability

        if off(0.0) <= 0:
            return 0.0
        most = squares / variance + 1
        while off(most) > 0:
            most *= 2
        return float(np.sqrt(brentq(off, 0.0, most) * variance / means.size))

    return float(seen), float(without), (by_centrality(TAILS[1]), by_centrality(TAILS[0]))
