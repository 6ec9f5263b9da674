"""Which tag cells show, as levels or under a blur that mixes neighbouring cells.

Cells of one or two pixels, and those of any size under a large blur, have no level of their own: each shows a mean of
itself and its neighbours, and a threshold between black and white reads what is not printed. What every tag of a
dictionary would show under such a blur is known, though. So where the threshold reads nothing, the levels are compared
with all tags as several blurs show them, and the most likely one counts: where what is left of the levels is less than
a few cells read wrongly would leave, and where no other tag comes near.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from math import comb

import cv2
import numpy as np
from scipy.special import ndtr

from testfield.targets.board_pattern import dictionary

WRONG_BORDER, WRONG_BITS = 0.03, 2
"""What may be read wrongly of a tag: a part of its border's cells, and some of its bits. A random 6 x 6 word is within
two bits of one of 36h11 with a probability of 2e-5."""
CORRECTED = 0.6
"""Part of the bits that a dictionary's distance allows to correct that may be wrong, as OpenCV's readers have it."""
BY_CHANCE, LEAST_WRONG = 1e-3, 0.5
"""With which probability a random word may be a tag's, by which dictionaries of short words allow fewer wrong bits; and
what noise may leave in any case."""
ROUNDS = 4
"""The level between dark and bright has settled after these."""
LEAST_RANGE = 12.0
"""Difference of black and white within a tag below which nothing is read, of 255."""
BLURS = (0.15, 0.3, 0.45, 0.6)
"""Standard deviations of blurs in cells, along rows and along columns each: a slanted tag is blurred more one way."""
AROUND = 2
"""White around a tag, in cells, that blurs into its border."""
APART = 1.0
"""Wrong bits by which the second best tag must be worse."""


@cache
def words_of(names: str) -> np.ndarray:
    """(4, n, bits) what all tags of a dictionary show row by row, white 1, turned k times by a quarter clockwise.

    Raises `ValueError` where there is no such dictionary."""
    tags = dictionary(names)
    side = int(tags.markerSize)
    shown = [tags.generateImageMarker(k, side + 2)[1:-1, 1:-1] > 0 for k in range(len(tags.bytesList))]
    return np.array([[np.rot90(one, -k).ravel() for one in shown] for k in range(4)])


def read_bits(cells: np.ndarray, names: str, border: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the levels (q, cells, cells) of tags with a `border` of so many cells: numbers (n,) in the dictionary, -1 for
    none, by how many corners each is turned (n,), and how many bits are wrong (n,)."""
    words = words_of(names)
    number, turns, wrong = np.full(len(cells), -1), np.zeros(len(cells), int), np.full(len(cells), np.inf)
    for k, one in enumerate(cells):
        read = _by_level(one, words, border, _wrong_bits(names))
        if read is not None:
            number[k], turns[k], wrong[k] = read
    rest = np.flatnonzero((number < 0) & (np.ptp(cells, axis=(1, 2)) >= LEAST_RANGE))
    if len(rest):
        number[rest], turns[rest], wrong[rest] = _by_likelihood(cells[rest], names, border)
    return number, turns, wrong


@cache
def _wrong_bits(names: str) -> float:
    """How many bits of a dictionary's tags may be wrong."""
    turned, count, bits = words_of(names).shape
    tags, near = turned * count / 2.0**bits, np.cumsum([comb(bits, k) for k in range(WRONG_BITS + 1)])
    seldom = int((tags * near <= BY_CHANCE).sum()) - 1
    return max(LEAST_WRONG, min(seldom, CORRECTED * int(dictionary(names).maxCorrectionBits)))


def _by_level(cells: np.ndarray, words: np.ndarray, border: int, allowed: float) -> tuple[int, int, int] | None:
    """Number, turns and wrong bits of cells between which and white a level lies; None where they show no tag."""
    low, high = cells.min(), cells.max()
    if high - low < LEAST_RANGE:
        return None
    level = (low + high) / 2
    for _ in range(ROUNDS):  # halfway between the means of the dark and of the bright (Ridler and Calvard 1978)
        level = (cells[cells <= level].mean() + cells[cells > level].mean()) / 2
    white = cells > level
    inner = white[border:-border, border:-border]
    around = white.size - inner.size
    if white.sum() - inner.sum() > WRONG_BORDER * around:
        return None
    wrong = (words != inner.ravel()).sum(axis=2)
    turns, number = np.unravel_index(wrong.argmin(), wrong.shape)
    bits = int(wrong[turns, number])
    return (int(number), -int(turns), bits) if bits <= allowed else None


@dataclass(frozen=True)
class _Blurred:
    """All tags, turned all ways, under one blur: `unit` (4 n, cells^2) levels less their mean, of length one, the
    `length` (4 n,) they had, and the `energy` that one cell read wrongly leaves."""

    unit: np.ndarray
    length: np.ndarray
    energy: float


@cache
def _blurred(names: str, border: int) -> list[_Blurred]:
    words = words_of(names)
    bits = int(np.sqrt(words.shape[2]))
    side = bits + 2 * border
    printed = np.ones((4 * words.shape[1], side + 2 * AROUND, side + 2 * AROUND), np.float32)
    printed[:, AROUND:-AROUND, AROUND:-AROUND] = 0
    inner = slice(AROUND + border, AROUND + border + bits)
    printed[:, inner, inner] = words.reshape(-1, bits, bits)
    found = []
    for across, down in product(BLURS, BLURS):
        kernels = _share(across), _share(down)
        shown = [cv2.sepFilter2D(one, -1, *kernels, borderType=cv2.BORDER_REPLICATE) for one in printed]
        levels = np.array(shown)[:, AROUND:-AROUND, AROUND:-AROUND].reshape(len(printed), -1)
        levels -= levels.mean(axis=1, keepdims=True)
        length = np.linalg.norm(levels, axis=1)
        energy = float((kernels[0] ** 2).sum() * (kernels[1] ** 2).sum())
        found.append(_Blurred(levels / length[:, None], length, energy))
    return found


def _share(blur: float) -> np.ndarray:
    """(7,) how much of the cells before and after it the middle half of a cell shows."""
    within, cell = np.linspace(-0.25, 0.25, 5)[:, None], np.arange(-3, 4)
    share = ndtr((cell + 0.5 - within) / blur) - ndtr((cell - 0.5 - within) / blur)
    return np.asarray(share.mean(axis=0), np.float32)


def _by_likelihood(cells: np.ndarray, names: str, border: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same as of `read_bits`, from the tags as blurs show them: a level and a contrast are fitted to each."""
    levels = cells.reshape(len(cells), -1).astype(np.float32)
    levels = levels - levels.mean(axis=1, keepdims=True)
    total, count, allowed = (levels**2).sum(axis=1), words_of(names).shape[1], _wrong_bits(names)
    left, turns = np.full((len(cells), count), np.inf), np.zeros((len(cells), count), int)
    for blurred in _blurred(names, border):
        along = levels @ blurred.unit.T
        # What is left of the levels beside a tag's contrast, in bits; most rows are near no tag at all.
        steepest = np.maximum(along.max(axis=1), 1e-6)
        near = (total / steepest**2 - 1) * blurred.length.min() ** 2 / blurred.energy <= allowed + APART
        rows = np.flatnonzero(near)
        contrast = np.maximum(along[rows] / blurred.length, 1e-6)
        here = (total[rows, None] - along[rows] ** 2) / contrast**2 / blurred.energy
        here[contrast < LEAST_RANGE] = np.inf
        here = here.reshape(len(rows), 4, count)
        less = here.min(axis=1) < left[rows]
        left[rows] = np.where(less, here.min(axis=1), left[rows])
        turns[rows] = np.where(less, -here.argmin(axis=1), turns[rows])
    # Another tag under another blur is a rival as well.
    best, each = left.argmin(axis=1), np.arange(len(left))
    least = left[each, best]
    left[each, best] = np.inf
    good = (least <= allowed) & (left.min(axis=1, initial=np.inf) > least + APART)
    return np.where(good, best, -1), np.where(good, turns[each, best], 0), np.where(good, least, np.inf)
