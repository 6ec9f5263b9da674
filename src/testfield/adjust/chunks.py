"""Which points are eliminated together.

Points that the same images see depend on the same few unknowns, so that their part of the reduced normal matrix is one
small product of dense matrices. Where points that lie next to each other in that order share little, each adds its own
part alone.
"""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.by_point import widths

PARTS = 8
"""At least so many chunks, for as many threads; not the number of cores, or sums would depend on it."""
LEAST_POINTS = 64
"""Points that are not divided further."""
CHUNK_NUMBERS = 4_000_000
"""Numbers between points and unknowns that a thread holds at a time."""
PAID = 2.0
"""Multiplications of a dense product over those that are needed, up to which it is the faster way."""


@dataclass(frozen=True)
class Chunk:
    """`points` (k,) and the reduced unknowns `columns` (u,) on which any of their observations depend; `dense` whether
    most depend on most."""

    points: np.ndarray
    columns: np.ndarray
    dense: bool


def chunks_of(
    first: np.ndarray, ray: np.ndarray, group: np.ndarray, columns: np.ndarray, count: np.ndarray, size: int
) -> tuple[Chunk, ...]:
    """All points that have observations, in chunks; arguments as in `Structure`, `size` the number of unknowns."""
    seen = np.flatnonzero(np.diff(first))
    if not len(seen):
        return ()
    needed = widths(first, ray, group, columns, count, size).astype(float) ** 2
    groups = group[ray]
    # `ray` follows the groups, so a point's first and last are its lowest and highest.
    seen = seen[np.lexsort((seen, groups[first[seen + 1] - 1], groups[first[seen]]))]
    by_group = [columns[g, : count[g]] for g in range(len(columns))]
    step = max(LEAST_POINTS, -(-len(seen) // PARTS))
    open_ends = [seen[at : at + step] for at in range(0, len(seen), step)][::-1]
    answer = []
    while open_ends:
        points = open_ends.pop()
        k = len(points)
        there = np.zeros(len(columns), bool)
        for p in points:
            there[groups[first[p] : first[p + 1]]] = True
        used = np.zeros(size, bool)
        for g in np.flatnonzero(there):
            used[by_group[g]] = True
        own = np.flatnonzero(used)
        dense = k * len(own) ** 2 <= PAID * needed[points].sum()
        if k > LEAST_POINTS and (not dense or 3 * k * len(own) > CHUNK_NUMBERS):
            open_ends += [points[k // 2 :], points[: k // 2]]
        else:
            answer.append(Chunk(points, own, bool(dense)))
    return tuple(answer)
