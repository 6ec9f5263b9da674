"""One dot, one row: whatever lies within a dot's radius of another row is the same dot, found twice.

A dot is looked for at several scales, and two rough blobs of it may differ enough in size to pass for two; the fit then
takes both to the same place.
"""

import numpy as np
from scipy.spatial import cKDTree

from testfield.detect.observations import MEASURED


def first_rows(
    xy_px: np.ndarray, diameter_px: np.ndarray, code: np.ndarray, status: np.ndarray, chi2: np.ndarray
) -> np.ndarray:
    """Indices, ascending, of one row for each dot. Of rows (n,) that share a dot the one that was read stays, else the
    one that was measured, else the first in the order of how well its model fits. Rows that are nowhere stay."""
    radius = np.where(np.isfinite(diameter_px), diameter_px, 0) / 2
    there = np.flatnonzero(np.isfinite(xy_px).all(axis=1) & (radius > 0))
    gone = np.zeros(len(xy_px), bool)
    if len(there) < 2:
        return np.arange(len(xy_px))
    hits = cKDTree(xy_px[there]).query_ball_point(xy_px[there], radius[there])
    a = there[np.repeat(np.arange(len(there)), [len(h) for h in hits])]
    b = there[np.concatenate([np.asarray(h, int) for h in hits])]
    other = a != b
    a, b = a[other], b[other]
    misfit = np.where(np.isfinite(chi2), chi2, np.inf)
    order = np.lexsort((np.arange(len(xy_px)), misfit, status != MEASURED, code <= 0))
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    near: dict[int, list[int]] = {}
    for first, second in zip(a.tolist(), b.tolist(), strict=True):
        near.setdefault(first, []).append(second)
        near.setdefault(second, []).append(first)
    for row in sorted(near, key=lambda k: int(rank[k])):
        if not gone[row]:
            gone[[k for k in near[row] if rank[k] > rank[row]]] = True
    return np.flatnonzero(~gone)
