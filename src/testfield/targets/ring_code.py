"""Ring codes: which words are valid, their numbers, and how a ring is read (METHODS section 8).

A ring has n equal segments, read clockwise in the image (y down), most significant bit first; the code word is
the smallest cyclic rotation. A word is valid when it has even parity, at least one pair of diametrically opposite
segments that are both 1, and is not all ones. Valid words are numbered from 1 in ascending order.
"""

from functools import lru_cache

import numpy as np

BITS = (8, 10, 12, 14, 16, 20)


def smallest_rotation(words: np.ndarray, bits: int) -> np.ndarray:
    """The smallest cyclic rotation of each word. `words` (...) unsigned integers; same shape back."""
    words = np.asarray(words, dtype=np.uint32)
    mask = np.uint32((1 << bits) - 1)
    best = rotated = words
    for _ in range(bits - 1):
        rotated = ((rotated << np.uint32(1)) | (rotated >> np.uint32(bits - 1))) & mask
        best = np.minimum(best, rotated)
    return best


@lru_cache
def code_words(bits: int) -> np.ndarray:
    """All valid words of a code, ascending: number k is `code_words(bits)[k - 1]`. Read-only (n,) uint32."""
    words = np.arange(1 << bits, dtype=np.uint32)
    half = bits // 2
    even = np.bitwise_count(words) % 2 == 0
    has_opposite_pair = (words & (words >> np.uint32(half)) & np.uint32((1 << half) - 1)) != 0
    valid = even & has_opposite_pair & (words != (1 << bits) - 1)
    words = words[valid]
    words = words[smallest_rotation(words, bits) == words]
    words.setflags(write=False)
    return words


def word_of_number(numbers: np.ndarray, bits: int) -> np.ndarray:
    """Words of code numbers (1-based). Raises `ValueError` where a number does not exist."""
    numbers, table = np.asarray(numbers), code_words(bits)
    if np.any((numbers < 1) | (numbers > len(table))):
        raise ValueError(f"{bits}-bit ring codes are numbered 1 to {len(table)}")
    return table[numbers - 1]


def number_of_word(words: np.ndarray, bits: int) -> np.ndarray:
    """Code numbers of words in any rotation; 0 where a word is not valid."""
    table = code_words(bits)
    smallest = smallest_rotation(words, bits)
    index = np.minimum(np.searchsorted(table, smallest), len(table) - 1)
    return np.where(table[index] == smallest, index + 1, 0)


def repeats(words: np.ndarray, bits: int) -> np.ndarray:
    """Whether words look alike after a part of a turn, so that a ring does not tell how it is turned."""
    words = np.asarray(words, dtype=np.uint32)
    mask = np.uint32((1 << bits) - 1)
    turned = [((words << np.uint32(k)) | (words >> np.uint32(bits - k))) & mask for k in range(1, bits)]
    return np.any([t == words for t in turned], axis=0)
