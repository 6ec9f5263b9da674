"""Similarities between points and where they ought to be, though some ought to be elsewhere."""

from itertools import combinations
from math import comb

import numpy as np

from testfield.camera.pose import nearest_rotation

TRIALS = 400
"""Triples that are tried: with a third of the places wrong, one of them is right but once in 10^60."""
THIN = 1e-3
"""Second over first extent below which points are on a line."""


def similarity(here: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation (3, 3) and shift (3,) that bring points (k, 3) nearest to their targets (k, 3), by
    least squares (Umeyama 1991)."""
    a, b = here - here.mean(axis=0), target - target.mean(axis=0)
    R = nearest_rotation(b.T @ a)
    scale = float((b * (a @ R.T)).sum() / max(float((a**2).sum()), 1e-300))
    return scale, R, target.mean(axis=0) - scale * R @ here.mean(axis=0)


def misses(here: np.ndarray, target: np.ndarray, by: tuple[float, np.ndarray, np.ndarray]) -> np.ndarray:
    """(k,) distances of points from their targets after a similarity."""
    scale, R, t = by
    return np.linalg.norm(scale * here @ R.T + t - target, axis=1)


def on_a_line(points: np.ndarray) -> bool:
    """Whether points (k, 3) leave the turn about a line open."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < THIN * max(float(spread[0]), 1e-300))


def robust_similarity(here: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """The similarity that brings more than half of the points (k, 3) as near as can be to their targets (least median
    of squares, Rousseeuw 1984), then best to those that it brings near."""
    k = len(here)
    if k <= 3:
        return similarity(here, target)
    if comb(k, 3) <= TRIALS:
        triples = [list(triple) for triple in combinations(range(k), 3)]
    else:
        rng = np.random.default_rng(0)
        triples = [rng.choice(k, 3, replace=False).tolist() for _ in range(TRIALS)]
    extent = float(np.linalg.norm(np.ptp(target, axis=0)))
    best, least = similarity(here, target), np.inf
    half = k // 2
    for triple in triples:
        span = np.linalg.svd(target[triple] - target[triple].mean(axis=0), compute_uv=False)
        if span[1] < 0.05 * extent:
            continue
        found = similarity(here[triple], target[triple])
        middle = float(np.partition(misses(here, target, found), half)[half])
        if middle < least:
            best, least = found, middle
    if not np.isfinite(least):
        return best
    near = misses(here, target, best) <= max(6 * least, 1e-9 * extent)
    return similarity(here[near], target[near]) if near.sum() >= 3 and not on_a_line(target[near]) else best
