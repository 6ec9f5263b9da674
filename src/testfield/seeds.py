"""Random numbers by name, and by place: adding a stage, a board or a pixel changes no other's numbers.

By place they are counter-based (Salmon et al., Parallel random numbers: as easy as 1, 2, 3, SC 2011: Philox4x64-10):
the number at a row and a column is a function of seed, name, row and column alone. NumPy keeps Philox's bits the same
in all its versions, which it does not promise of its distributions, so normal deviates are made here, by inversion: one
number each, never a rejection.
"""

import hashlib

import numpy as np
from scipy.special import ndtri

WORDS = 4
"""64-bit words that one step of Philox's counter gives."""


def seed_of(seed: int, name: str) -> int:
    """A 64-bit seed for the purpose `name`, from the scene's seed."""
    return int.from_bytes(_digest(seed, name)[:8], "little")


def generator(seed: int, name: str) -> np.random.Generator:
    """The generator of one purpose of one scene: a stream, for what needs an unknown number of draws."""
    return np.random.default_rng(seed_of(seed, name))


class Plane:
    """A plane of random numbers without edges, called `name`, of one seed; each number belongs to its row and column.

    Every row has a counter of its own, so a number does not depend on how many columns or rows are asked for, nor in
    which order: a crop of a sensor keeps its pixels' noise.
    """

    def __init__(self, seed: int, name: str):
        self._bits = np.random.Philox(key=int.from_bytes(_digest(seed, name)[:16], "little"))
        self._state = self._bits.state
        self._state["buffer_pos"] = WORDS  # nothing is left over from another row

    def uniforms(self, rows: range, columns: int) -> np.ndarray:
        """(len(rows), columns) numbers uniform in (0, 1).

        They are (n + 1/2) 2^-52, from 2^-53 to 1 - 2^-53 and symmetric about 1/2: both tails are resolved alike, to
        8.2 standard deviations, and 1 - u is exact.
        """
        words = np.empty((len(rows), columns), np.uint64)
        for k, row in enumerate(rows):
            self._state["state"]["counter"][:] = (0, row, 0, 0)
            self._bits.state = self._state
            words[k] = self._bits.random_raw(columns)
        words >>= np.uint64(12)
        numbers = words.astype(np.float64)
        numbers += 0.5
        numbers *= 2.0**-52
        return numbers

    def normals(self, rows: range, columns: int) -> np.ndarray:
        """(len(rows), columns) standard normal deviates."""
        numbers = self.uniforms(rows, columns)
        ndtri(numbers, out=numbers)
        return numbers


def normals(seed: int, name: str, items: int, each: int = 1) -> np.ndarray:
    """(items, each) standard normal deviates; those of an item do not depend on how many others follow it."""
    return Plane(seed, name).normals(range(1), items * each).reshape(items, each)


def _digest(seed: int, name: str) -> bytes:
    return hashlib.sha256(f"{seed}/{name}".encode()).digest()


def normals_of_marks(
    seed: int,
    stations: tuple[str, ...],
    boards: tuple[str, ...],
    station: np.ndarray,
    board: np.ndarray,
    point: np.ndarray,
    code: np.ndarray,
) -> np.ndarray:
    """(n, 2) standard normal deviates of n observations.

    `station`, `board` (n,) index the names, -1 for no board; `point` (n,) is a board's mark. Marks of no board go by
    their `code` (n,); plain dots of no board have no name but their order in the image.
    """
    drawn = np.empty((len(station), 2))
    plain = (board < 0) & (code == 0)
    for s in np.unique(station):
        here = station == s
        for b in np.unique(board[here]):
            named = np.flatnonzero(here & (board == b) & ~plain)
            if len(named):
                number = (point if b >= 0 else code)[named]
                group = f"board/{boards[b]}" if b >= 0 else "loose"
                drawn[named] = normals(seed, f"pixels/{stations[s]}/{group}", int(number.max()) + 1, 2)[number]
        unnamed = np.flatnonzero(here & plain)
        drawn[unnamed] = normals(seed, f"pixels/{stations[s]}/plain", len(unnamed), 2)
    return drawn
