"""Points as one quantity of three components (GUM supplement 2, JCGM 102): ellipsoids and boxes that hold it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from testfield.uncertainty.monte_carlo import P, tolerance


def coverage_factor(components: int = 3, p: float = P) -> float:
    """k of a Gaussian's coverage ellipsoid: 2.4477 for two components, 2.7955 for three at 95 %."""
    return float(np.sqrt(chi2.ppf(p, components)))


@dataclass(frozen=True)
class Region:
    """Coverage regions of n points at p.

    `centre_mm` (n, 3), `cov_mm2` (n, 3, 3); ellipsoid (x - c)^T C^-1 (x - c) <= k^2 with `k` (n,), of the half-axes
    `axes_mm` (n, 3), smallest first, along the columns of `directions` (n, 3, 3); `box_mm` (n, 3) half-widths of the
    box with the sides in proportion to the standard uncertainties.
    """

    centre_mm: np.ndarray
    cov_mm2: np.ndarray
    k: np.ndarray
    axes_mm: np.ndarray
    directions: np.ndarray
    box_mm: np.ndarray


def ellipsoids(centre_mm: np.ndarray, cov_mm2: np.ndarray, p: float = P) -> Region:
    """Regions of Gaussian points in closed form. The box is the one around the ellipsoid: it holds p and more."""
    n, m = centre_mm.shape
    k = np.full(n, coverage_factor(m, p))
    return _region(centre_mm, cov_mm2, k, k[:, None] * np.sqrt(np.einsum("nii->ni", cov_mm2)))


def regions(trials_mm: np.ndarray, p: float = P) -> Region:
    """Regions of (T, n, 3) trials: k is the p-quantile of their Mahalanobis radii, the box that of their largest
    deviation in standard uncertainties."""
    centre, cov, radius = _moments(trials_mm)
    u = np.sqrt(np.einsum("nii->ni", cov))
    largest = np.abs((trials_mm - centre) / u).max(axis=2)
    return _region(centre, cov, np.quantile(radius, p, axis=0), np.quantile(largest, p, axis=0)[:, None] * u)


def adaptive_regions(
    block: Callable[[int], np.ndarray], most_trials: int, digits: int = 1, p: float = P
) -> tuple[Region, bool, int]:
    """Regions of blocks of (M, n, 3) trials, as many as the supplement's stop asks for: until the standard
    uncertainties, the correlation matrix' largest eigenvalue and k are known to `digits` significant digits.
    Returns also whether that was reached, and the number of trials."""
    parts: list[np.ndarray] = []
    figures: list[np.ndarray] = []
    while True:
        parts.append(block(len(parts)))
        figures.append(_stop_figures(parts[-1], p))
        drawn = sum(len(part) for part in parts)
        if len(parts) < 2:
            continue
        s = np.std(figures, axis=0, ddof=1) / np.sqrt(len(figures))
        reached = bool((2 * s <= tolerance(np.mean(figures, axis=0), digits)).all())
        if reached or drawn + len(parts[-1]) > most_trials:
            return regions(np.concatenate(parts), p), reached, drawn


def _region(centre: np.ndarray, cov: np.ndarray, k: np.ndarray, box: np.ndarray) -> Region:
    values, directions = np.linalg.eigh(cov)
    return Region(centre, cov, k, k[:, None] * np.sqrt(values), directions, box)


def _moments(trials: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means (n, 3), covariances (n, 3, 3) and Mahalanobis radii (T, n) of trials (T, n, 3)."""
    centre = trials.mean(axis=0)
    off = trials - centre
    cov = np.einsum("tni,tnj->nij", off, off, optimize=True) / (len(trials) - 1)
    white = np.einsum("nij,tnj->tni", np.linalg.inv(np.linalg.cholesky(cov)), off)
    return centre, cov, np.linalg.norm(white, axis=2)


def _stop_figures(trials: np.ndarray, p: float) -> np.ndarray:
    """(5, n) standard uncertainties, largest eigenvalue of the correlation matrix, and k of a block."""
    _, cov, radius = _moments(trials)
    u = np.sqrt(np.einsum("nii->ni", cov))
    largest = np.linalg.eigvalsh(cov / (u[:, :, None] * u[:, None, :]))[:, -1]
    return np.vstack([u.T, largest, np.quantile(radius, p, axis=0)])
