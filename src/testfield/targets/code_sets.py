"""Sets of code numbers that are hard to take for one another."""

import numpy as np

from testfield.targets.ring_code import code_words, smallest_rotation

MOST = 2500
"""Of larger tables this many numbers are looked at."""


def mirrored(words: np.ndarray, bits: int) -> np.ndarray:
    """The words as read the wrong way round, in their smallest rotation."""
    words = np.asarray(words, np.uint32)
    back = np.zeros_like(words)
    for k in range(bits):
        back |= ((words >> np.uint32(k)) & np.uint32(1)) << np.uint32(bits - 1 - k)
    return smallest_rotation(back, bits)


def cyclic_distance(words: np.ndarray, others: np.ndarray, bits: int) -> np.ndarray:
    """(n, m) least number of segments in which one ring differs from another, over all turns of one of them."""
    words, others = np.asarray(words, np.uint32)[:, None], np.asarray(others, np.uint32)[None, :]
    mask = np.uint32((1 << bits) - 1)
    best = np.full(np.broadcast_shapes(words.shape, others.shape), bits, np.uint8)
    for k in range(bits):
        turned = ((others << np.uint32(k)) | (others >> np.uint32(bits - k))) & mask
        best = np.minimum(best, np.bitwise_count(words ^ turned))
    return best


def choose_codes(bits: int, count: int, mirrors: bool = True) -> tuple[np.ndarray, int]:
    """`count` code numbers, ascending, with as large a least mutual distance as a greedy search finds, and it.

    With `mirrors` a ring read the wrong way round is kept as far from all others. Words that a turn of less than a
    full one repeats come last: such a target does not tell its own turn. Raises `ValueError` where the table holds
    fewer numbers.
    """
    table = code_words(bits)
    if not 1 <= count <= len(table):
        raise ValueError(f"{count} codes of {bits} bits are asked for; there are {len(table)}")
    plain = np.flatnonzero(~repeats(table, bits))
    if count > len(plain):
        plain = np.arange(len(table))
    # Of a large table an even selection does: distances of neighbours in it are no larger than of others.
    among = plain if len(plain) <= MOST else plain[np.linspace(0, len(plain) - 1, max(MOST, count)).astype(int)]
    away = cyclic_distance(table[among], table[among], bits)
    if mirrors:
        away = np.minimum(away, cyclic_distance(table[among], mirrored(table[among], bits), bits))
    for distance in range(bits // 2 * 2, 0, -2):  # words of even parity differ in an even number of segments
        chosen = _least_crowded(away < distance, count)
        if len(chosen) >= count:
            return np.sort(among[chosen]) + 1, distance
    # What is left are mirror images of one another.
    return np.sort(among[:count]) + 1, 0


def _least_crowded(conflict: np.ndarray, count: int) -> list[int]:
    """Up to `count` of n things no two of which conflict (n, n): always the one next that rules out the fewest."""
    conflict = conflict & ~np.eye(len(conflict), dtype=bool)
    crowd = conflict.sum(axis=1)
    free = np.ones(len(conflict), bool)
    chosen: list[int] = []
    while free.any() and len(chosen) < count:
        k = int(np.argmin(np.where(free, crowd, len(conflict) + 1)))
        chosen.append(k)
        gone = free & conflict[k]
        free[k] = False
        free &= ~gone
        crowd = crowd - conflict[:, gone].sum(axis=1)
    return chosen


def repeats(words: np.ndarray, bits: int) -> np.ndarray:
    """(n,) whether a ring looks the same after a turn of less than a full one."""
    words, mask = np.asarray(words, np.uint32), np.uint32((1 << bits) - 1)
    again = np.zeros(len(words), bool)
    for k in range(1, bits):
        again |= (((words << np.uint32(k)) | (words >> np.uint32(bits - k))) & mask) == words
    return again
