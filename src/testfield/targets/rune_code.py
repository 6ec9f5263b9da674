"""RUNE-129: the words that its rings of dots show, and their numbers.

A tag has 43 sectors of three places, one on each of three circles. What stands in a sector is a symbol from 0 to 6,
shown as 1 to 7 in three bits, the innermost first, so that no sector is empty; and the 43 symbols are a word of a
cyclic code over the field of 7 elements, of 7 dimensions, two words of which differ in 30 symbols or more. So half of
a tag can be hidden, or a third of it wrong.

Rules and numbers are those of the reference (Bergamasco, Albarelli, Rodola and Torsello, CVPR 2011;
github.com/artursg/RUNEtag, commit e8319a1, RUNETag/coding.cpp and codegen/codegen.cpp): of all turns of a word the one
is taken whose second coefficient of the Fourier transform over the field of 173 elements is a small power of 2, and
its number is made of six of its message's digits. Where words share a number, the one counts that the reference's
table of 17,000 tags holds.
"""

from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

SECTORS, CIRCLES, SYMBOLS = 43, 3, 7
RADII = np.array([4, 5, 6]) / 6
"""Radii of the circles on which dots stand, in that of the outer one."""
DOT = 1 / 17.8
"""A dot's radius in that of its circle."""
APART = 30
"""In how many symbols any two words, or two turns of one, differ at least."""
TAGS = 17_000
_DIGITS = 6
_GENERATOR = (
    1,
    1,
    6,
    4,
    6,
    0,
    3,
    1,
    5,
    3,
    5,
    4,
    0,
    4,
    6,
    3,
    4,
    6,
    3,
    6,
    4,
    3,
    6,
    4,
    0,
    4,
    5,
    3,
    5,
    1,
    3,
    0,
    6,
    4,
    6,
    1,
    1,
)
_FIELD, _ROOT, _STEP = 173, 2, 4
"""The transform's field, a root that generates it, and which power of the root turns by one sector."""


@dataclass(frozen=True)
class RuneCode:
    """All tags: `number` (n,) ascending and their `word` (n, 43) of symbols, counter-clockwise from the right."""

    number: np.ndarray
    word: np.ndarray


@cache
def rune_code() -> RuneCode:
    """The tags of the reference's table."""
    power = np.array([pow(_ROOT, k, _FIELD) for k in range(_FIELD - 1)])
    logarithm = np.full(_FIELD, -1)
    logarithm[power] = np.arange(_FIELD - 1)
    count = SYMBOLS**_DIGITS
    message = np.arange(count)[:, None] // SYMBOLS ** np.arange(_DIGITS) % SYMBOLS
    shifted = np.array([np.roll(np.append(_GENERATOR, np.zeros(SECTORS - len(_GENERATOR), int)), k) for k in range(6)])
    words = (message.astype(np.int16) @ shifted.astype(np.int16)) % SYMBOLS
    turned = logarithm[words.astype(np.int64) @ power[_STEP * np.arange(SECTORS) % (_FIELD - 1)] % _FIELD]
    # A word whose coefficient is 0 cannot be turned, and is no tag.
    words, turn = words[turned >= 0], turned[turned >= 0] // _STEP
    aligned = np.take_along_axis(words, (np.arange(SECTORS) + turn[:, None]) % SECTORS, axis=1)
    number = _number(aligned)
    # In the order of messages until there are as many tags as the table has; a later word takes the number over.
    _, first = np.unique(number, return_index=True)
    last = np.sort(first)[TAGS - 1]
    numbers, from_behind = np.unique(number[last::-1], return_index=True)
    word = aligned[last - from_behind].astype(np.int8)
    for values in (numbers, word):
        values.setflags(write=False)
    return RuneCode(numbers, word)


def word_of_rune(number: int) -> np.ndarray:
    """(43,) symbols of a tag. Raises `ValueError` where there is no such tag."""
    code = rune_code()
    row = int(np.searchsorted(code.number, number))
    if row == len(code.number) or code.number[row] != number:
        near = code.number[min(row, len(code.number) - 1)]
        raise ValueError(f"there is no RUNE-Tag of number {number}; the next one is {near}")
    return np.asarray(code.word[row])


def places_of_rune(number: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,) sectors and (n,) circles, 0 the innermost, of a tag's dots, sector by sector. Raises `ValueError`."""
    shown = (word_of_rune(number)[:, None].astype(int) + 1) >> np.array([2, 1, 0]) & 1
    sector, circle = np.nonzero(shown)
    return sector, circle


def nearest_rune(symbols: np.ndarray) -> tuple[int, int, int]:
    """The tag whose word, in one of its turns, agrees best with the symbols (43,) seen, -1 where none is seen: its
    number, which sector is the word's first, and how many symbols agree.

    The generator reads alike from both ends, so that a tag's mirror image is another tag, which may be in the table.
    """
    turns = (np.arange(SECTORS)[:, None] + np.arange(SECTORS)) % SECTORS
    shown = (symbols[turns][..., None] == np.arange(SYMBOLS)).reshape(SECTORS, -1).astype(np.float32)
    alike = _as_bits() @ shown.T
    row, first = np.unravel_index(int(alike.argmax()), alike.shape)
    return int(rune_code().number[row]), int(first), int(alike[row, first])


def chance_of_rune(seen: int, alike: int) -> float:
    """How many of all tags, in all their turns, agree by chance in `alike` or more of so many symbols seen: those of a
    word are as good as even dice, because any seven of them can be chosen."""
    wrong = sum(comb(seen, k) * (SYMBOLS - 1) ** k for k in range(seen - alike + 1))
    return TAGS * SECTORS * wrong / SYMBOLS**seen


@cache
def _as_bits() -> np.ndarray:
    """(n, 43 * 7) which symbol stands where in each tag's word."""
    return (rune_code().word[..., None] == np.arange(SYMBOLS)).reshape(TAGS, -1).astype(np.float32)


def symbols_of(shown: np.ndarray) -> np.ndarray:
    """(43,) symbols of which dots (43, 3) are seen; -1 where a sector shows none."""
    return shown @ np.array([4, 2, 1]) - 1


def _number(words: np.ndarray) -> np.ndarray:
    c = words.T.astype(np.int64)
    digits = (
        c[0],
        6 * c[0] + c[1],
        2 * c[0] + 6 * c[1] + c[2],
        2 * c[1] + 6 * c[2] + c[3],
        2 * c[2] + 6 * c[3] + c[4],
        5 * c[0] + 2 * c[3] + 6 * c[4] + c[5],
    )
    return np.asarray(sum(digit % SYMBOLS * SYMBOLS**k for k, digit in enumerate(digits)))
