"""How the light changes across a dot, learned from the dots around it.

A dot alone can hardly tell a gradient of its light from a shift of its centre: leaving the gradient free costs a dot of
24 px a quarter of its information, one of 6 px two thirds. Light changes slowly, so its neighbours know: local
regression with a quadratic over the nearest, and bisquare weights against outliers (Cleveland 1979).
"""

import numpy as np
from scipy.spatial import cKDTree

from testfield.detect.normal_equations import by_cholesky

NEIGHBOURS, LEAST_NEIGHBOURS = 24, 10
REACH = 20.0
"""Neighbours count up to this many diameters away."""
ROBUST_ROUNDS = 3
SURPRISING = 9.0
"""Squared deviation of a dot from what its neighbours foretell, over its variance."""
LEAST_SHAPE_PX = 0.02
"""Standard deviation of a dot's half axes below which no difference from its neighbours' counts."""
CLEARLY = 1.0
"""Standard deviations of a variance by which scatter must exceed chance to be taken for light."""


def local_gradients(
    xy_px: np.ndarray, values: np.ndarray, variances: np.ndarray, good: np.ndarray, axes_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (n, 2) a px of a slowly varying quantity at n dots, and their inverse covariances (n, 2, 2).

    `values`, `variances` (n,) one a dot, the latter of chance alone; `good` (n,) which of them count; `axes_px` (n, 2,
    2) the symmetric matrices that make the dots' outlines of the unit circle. A dot whose level or whose shape is not
    what its neighbours foretell lies on another surface, and they say nothing of its light. What neighbours scatter
    about the quadratic beyond chance is light that changes from dot to dot: a random field whose gradients have its
    variance over its correlation length squared, which is half the dots' spacing or less where neighbours know nothing
    of each other. A dot with too few neighbours gets a gradient of zero and zeros for the inverse covariance: nothing
    is known.
    """
    n = len(xy_px)
    diameter_px = 2 * np.abs(np.linalg.eigvalsh(axes_px)).max(axis=1)
    gradient, information = np.zeros((n, 2)), np.zeros((n, 2, 2))
    known = np.flatnonzero(good)
    if len(known) <= LEAST_NEIGHBOURS:
        return gradient, information
    count = min(NEIGHBOURS + 1, len(known))
    distance, index = cKDTree(xy_px[known]).query(xy_px[known], k=count)
    distance[distance > REACH * diameter_px[known, None]] = np.inf
    near = np.isfinite(distance)
    enough = near.sum(axis=1) > LEAST_NEIGHBOURS
    known, distance, index, near = known[enough], distance[enough], index[enough], near[enough]
    if len(known) == 0:
        return gradient, information
    radius = np.where(near, distance, 0).max(axis=1) * 1.01
    rows = np.flatnonzero(good)[index]
    offset = (xy_px[rows] - xy_px[known, None, :]) / radius[:, None, None]
    u, v = offset[..., 0], offset[..., 1]
    design = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    level = values[rows]
    weight = near.astype(float)
    for _ in range(ROBUST_ROUNDS):
        residual, spread = _fit(design, level, weight)[1:]
        weight = near * (1 - np.minimum(np.abs(residual) / (6 * spread[:, None]), 1) ** 2) ** 2
    solution, residual, _ = _fit(design, level, weight)
    inverse = _inverse(np.swapaxes(design * weight[..., None], 1, 2) @ design)
    squares = np.swapaxes(design * weight[..., None] ** 2, 1, 2) @ design
    freedom = weight.sum(axis=1) - np.einsum("nij,nji->n", inverse, squares)
    variance = (weight * residual**2).sum(axis=1) / np.maximum(freedom, 1e-6)
    covariance = variance[:, None, None] * (inverse @ squares @ inverse)[:, 1:3, 1:3] / radius[:, None, None] ** 2
    chance = (weight * variances[rows]).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-300)
    beyond = variance > chance * (1 + CLEARLY * np.sqrt(2 / np.maximum(freedom, 1)))
    spacing = np.sort(np.where(near, distance, np.inf), axis=1)[:, 1:5].mean(axis=1)
    rough = np.where(beyond, variance - chance, 0) * (2 / spacing) ** 2
    covariance += rough[:, None, None] * np.eye(2)
    leverage = np.minimum(weight[:, 0] * inverse[:, 0, 0], 0.95)
    surprise = _surprise(residual, weight, freedom, leverage, variances[rows[:, 0]])
    for i, j in ((0, 0), (0, 1), (1, 1)):
        off = _fit(design, axes_px[:, i, j][rows], weight)[1]
        surprise = np.maximum(
            surprise, _surprise(off, weight, freedom, leverage, np.full(len(rows), LEAST_SHAPE_PX**2))
        )
    scale = np.abs(level).max(axis=1) / radius
    covariance += (1e-9 * scale[:, None, None]) ** 2 * np.eye(2)  # nothing is known without doubt
    usable = (
        (surprise < SURPRISING)
        & (freedom > 2)
        & np.isfinite(covariance).all(axis=(1, 2))
        & (np.linalg.det(covariance) > 0)
    )
    gradient[known[usable]] = (solution[:, 1:3] / radius[:, None])[usable]
    information[known[usable]] = np.linalg.inv(covariance[usable])
    return gradient, information


def _surprise(
    residual: np.ndarray, weight: np.ndarray, freedom: np.ndarray, leverage: np.ndarray, least: np.ndarray
) -> np.ndarray:
    """(n,) squared deviation of each dot from a fit to the others alone, over its variance, at least `least`."""
    variance = (weight * residual**2).sum(axis=1) / np.maximum(freedom, 1e-6)
    return (residual[:, 0] / (1 - leverage)) ** 2 / np.maximum(np.maximum(variance, least) / (1 - leverage), 1e-300)


def _fit(design: np.ndarray, level: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weighted least squares: solutions (n, 6), residuals (n, k), median size of those with weight (n,)."""
    weighted = design * weight[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ design
    solution = (_inverse(normal) @ (np.swapaxes(weighted, 1, 2) @ level[..., None]))[..., 0]
    residual = level - np.einsum("nki,ni->nk", design, solution)
    spread = np.nanmedian(np.where(weight > 0, np.abs(residual), np.nan), axis=1)
    return solution, residual, np.maximum(spread, 1e-12 * np.abs(level).max(axis=1) + 1e-300)


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverses of normal matrices (n, 6, 6), or what comes nearest: neighbours may lie in one line."""
    found, whole = by_cholesky(np.ascontiguousarray(normal))
    if not whole.all():
        found[~whole] = np.linalg.pinv(normal[~whole], hermitian=True)
    return found
