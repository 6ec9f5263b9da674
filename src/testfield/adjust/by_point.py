"""Sums over the observations of each point, compiled.

All take the observations as `Structure` and `Derivatives` hold them: point p has `ray[first[p]]` to
`ray[first[p + 1] - 1]`, each of which depends on the first `count[group]` of the unknowns `columns[group]`.
"""

import math

import numpy as np

from testfield.store.compiled import compiled


@compiled
def widths(
    first: np.ndarray, ray: np.ndarray, group: np.ndarray, columns: np.ndarray, count: np.ndarray, size: int
) -> np.ndarray:
    """(n,) on how many of `size` unknowns each point's observations depend."""
    n = len(first) - 1
    last, answer = np.full(size, -1), np.zeros(n, np.int64)
    for p in range(n):
        for e in ray[first[p] : first[p + 1]]:
            g = group[e]
            for k in range(count[g]):
                if last[columns[g, k]] != p:
                    last[columns[g, k]] = p
                    answer[p] += 1
    return answer


@compiled
def point_normals(first: np.ndarray, ray: np.ndarray, by_point: np.ndarray) -> np.ndarray:
    """(n, 3, 3) normal blocks of all points."""
    n = len(first) - 1
    normal = np.zeros((n, 3, 3))
    for p in range(n):
        for e in ray[first[p] : first[p + 1]]:
            for i in range(3):
                for j in range(3):
                    normal[p, i, j] += by_point[e, 0, i] * by_point[e, 0, j] + by_point[e, 1, i] * by_point[e, 1, j]
    return normal


@compiled
def gathered(first: np.ndarray, ray: np.ndarray, by_point: np.ndarray, change: np.ndarray) -> np.ndarray:
    """(n, 3): `change` (m, 2) of the whitened observations, times `by_point` (m, 2, 3), summed over each point."""
    n = len(first) - 1
    answer = np.zeros((n, 3))
    for p in range(n):
        for e in ray[first[p] : first[p + 1]]:
            for i in range(3):
                answer[p, i] += by_point[e, 0, i] * change[e, 0] + by_point[e, 1, i] * change[e, 1]
    return answer


@compiled
def spread(point: np.ndarray, by_point: np.ndarray, amounts: np.ndarray) -> np.ndarray:
    """(m, 2, d): how the whitened observations of points `point` (m,) follow amounts (n, 3, d) of their points."""
    width = amounts.shape[2]
    answer = np.empty((len(point), 2, width))
    for e in range(len(point)):
        a = amounts[point[e]]
        for i in range(2):
            x, y, z = by_point[e, i, 0], by_point[e, i, 1], by_point[e, i, 2]
            for k in range(width):
                answer[e, i, k] = x * a[0, k] + y * a[1, k] + z * a[2, k]
    return answer


@compiled
def point_factors(normal: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Inverses F (n, 3, 3) of the lower Cholesky factors of blocks (n, 3, 3) whose diagonals are damped, the blocks'
    inverses F' F, and how many blocks are not positive definite."""
    n, bad, by = len(normal), 0, 1 + damping
    factor, inverse = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    for p in range(n):
        a = normal[p]
        d0 = a[0, 0] * by
        l10, l20 = a[1, 0] / math.sqrt(d0), a[2, 0] / math.sqrt(d0)
        d1 = a[1, 1] * by - l10 * l10
        l21 = (a[2, 1] - l20 * l10) / math.sqrt(d1)
        d2 = a[2, 2] * by - l20 * l20 - l21 * l21
        if not (d0 > 0 and d1 > 0 and d2 > 0):
            bad += 1
            continue
        f, i0, i1, i2 = factor[p], 1 / math.sqrt(d0), 1 / math.sqrt(d1), 1 / math.sqrt(d2)
        f[0, 0], f[1, 1], f[2, 2] = i0, i1, i2
        f[1, 0] = -l10 * i0 * i1
        f[2, 1] = -l21 * i1 * i2
        f[2, 0] = -(l20 * i0 + l21 * f[1, 0]) * i2
        for i in range(3):
            for j in range(3):
                inverse[p, i, j] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
    return factor, inverse, bad


@compiled
def point_rows(
    points: np.ndarray,
    first: np.ndarray,
    ray: np.ndarray,
    group: np.ndarray,
    columns: np.ndarray,
    count: np.ndarray,
    by_unknown: np.ndarray,
    by_point: np.ndarray,
    by: np.ndarray,
    place: np.ndarray,
    width: int,
) -> np.ndarray:
    """(k, 3, width): of k `points`, `by` (n, 3, 3) of each times its normal matrix with the reduced unknowns, unknown c
    in column `place[c]`."""
    answer = np.zeros((len(points), 3, width))
    for k in range(len(points)):
        p, row = points[k], answer[k]
        b = by[p]
        for e in ray[first[p] : first[p + 1]]:
            d, g = by_point[e], group[e]
            for i in range(3):
                x = b[i, 0] * d[0, 0] + b[i, 1] * d[0, 1] + b[i, 2] * d[0, 2]
                y = b[i, 0] * d[1, 0] + b[i, 1] * d[1, 1] + b[i, 2] * d[1, 2]
                for c in range(count[g]):
                    row[i, place[columns[g, c]]] += x * by_unknown[e, 0, c] + y * by_unknown[e, 1, c]
    return answer


@compiled
def prediction_rows(
    points: np.ndarray,
    first: np.ndarray,
    ray: np.ndarray,
    group: np.ndarray,
    columns: np.ndarray,
    count: np.ndarray,
    by_unknown: np.ndarray,
    by_point: np.ndarray,
    rows: np.ndarray,
    place: np.ndarray,
) -> np.ndarray:
    """(q, 2, u): how the predictions of all q observations of `points` (k,), one point after another, follow the
    reduced unknowns when the points follow them by minus `rows` (k, 3, u)."""
    q, width = 0, rows.shape[2]
    for p in points:
        q += first[p + 1] - first[p]
    answer = np.zeros((q, 2, width))
    q = 0
    for k in range(len(points)):
        for e in ray[first[points[k]] : first[points[k] + 1]]:
            g = group[e]
            for i in range(2):
                x, y, z = by_point[e, i, 0], by_point[e, i, 1], by_point[e, i, 2]
                for c in range(width):
                    answer[q, i, c] = -(x * rows[k, 0, c] + y * rows[k, 1, c] + z * rows[k, 2, c])
                for c in range(count[g]):
                    answer[q, i, place[columns[g, c]]] += by_unknown[e, i, c]
            q += 1
    return answer


@compiled
def take_away(
    normal: np.ndarray,
    from_row: int,
    to_row: int,
    points: np.ndarray,
    first: np.ndarray,
    ray: np.ndarray,
    group: np.ndarray,
    columns: np.ndarray,
    count: np.ndarray,
    by_unknown: np.ndarray,
    by_point: np.ndarray,
    by: np.ndarray,
) -> None:
    """From the lower triangle of `normal` (P, P), in these rows, what eliminating each of `points` takes away: rows'
    `rows` as `point_rows` makes them, point by point over those unknowns alone on which it depends."""
    size = len(normal)
    place, own, part = np.full(size, -1), np.zeros(size, np.int64), np.zeros((size, 3))
    for p in points:
        b, q = by[p], 0
        for e in ray[first[p] : first[p + 1]]:
            d, g = by_point[e], group[e]
            for c in range(count[g]):
                column = columns[g, c]
                at = place[column]
                if at < 0:
                    at, q = q, q + 1
                    place[column], own[at] = at, column
                    part[at] = 0
                for i in range(3):
                    x = b[i, 0] * d[0, 0] + b[i, 1] * d[0, 1] + b[i, 2] * d[0, 2]
                    y = b[i, 0] * d[1, 0] + b[i, 1] * d[1, 1] + b[i, 2] * d[1, 2]
                    part[at, i] += x * by_unknown[e, 0, c] + y * by_unknown[e, 1, c]
        for i in range(q):
            place[own[i]] = -1
            if from_row <= own[i] < to_row:
                row, x, y, z = normal[own[i]], part[i, 0], part[i, 1], part[i, 2]
                for j in range(q):
                    if own[j] <= own[i]:
                        row[own[j]] -= x * part[j, 0] + y * part[j, 1] + z * part[j, 2]
