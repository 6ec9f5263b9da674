"""Connected bright pixels as runs along the rows: few numbers instead of all pixels of an image."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True)
class Runs:
    """Runs of pixels, m rows in the order of the image: `blob` (m,) to which of n blobs each belongs, its `row`, its
    `first` column and its `length`."""

    blob: np.ndarray
    row: np.ndarray
    first: np.ndarray
    length: np.ndarray

    def only(self, keep: np.ndarray) -> "Runs":
        """The runs of those blobs that a mask (n,) keeps, which are numbered anew."""
        mine = keep[self.blob]
        number = np.cumsum(keep) - 1
        return Runs(number[self.blob[mine]], self.row[mine], self.first[mine], self.length[mine])

    def area(self) -> np.ndarray:
        """(n,) pixels."""
        return np.bincount(self.blob, weights=self.length)

    def box(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Left, top, right and bottom (n,) of the smallest upright boxes, the latter two just outside."""
        n = self.blob.max(initial=-1) + 1
        top, bottom = np.zeros(n, int), np.zeros(n, int)
        left, right = np.full(n, np.iinfo(int).max), np.zeros(n, int)
        np.minimum.at(left, self.blob, self.first)
        np.maximum.at(right, self.blob, self.first + self.length)
        top[self.blob[::-1]] = self.row[::-1]  # the last that is written stays
        bottom[self.blob] = self.row + 1
        return left, top, right, bottom

    def moments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Centre x, y and second moments xx, xy, yy (n,); a pixel is a square, not a point."""
        area = self.area()

        def mean(of_run: np.ndarray) -> np.ndarray:
            return np.bincount(self.blob, weights=self.length * of_run) / area

        middle = self.first + (self.length - 1) / 2
        x, y = mean(middle), mean(self.row)
        dx, dy = middle - x[self.blob], self.row - y[self.blob]
        along = (self.length**2 - 1) / 12  # of a run about its own middle
        return x, y, mean(dx * dx + along) + 1 / 12, mean(dx * dy), mean(dy * dy) + 1 / 12


def empty_mask(h: int, w: int) -> tuple[np.ndarray, np.ndarray]:
    """Memory for `changes`, and the part of it (h, w) uint8 into which the mask is to be written.

    A dark pixel lies before the first row and behind each row, so that in memory every run begins and ends somewhere.
    """
    line = np.empty(h * (w + 1) + 1, np.uint8)
    line[:: w + 1] = 0
    return line, line[1:].reshape(h, w + 1)[:, :w]


def changes(line: np.ndarray) -> np.ndarray:
    """Places in a mask's memory where runs of pixels that are not 0 begin and end, in turn; a row is w + 1 long."""
    return np.flatnonzero(line[1:] != line[:-1])


def runs_between(change: np.ndarray, w: int) -> Runs:
    """Runs from all the changes in an image of width `w`; pixels that share an edge belong to one blob."""
    begin, end = change[::2], change[1::2]
    row, first = begin // (w + 1), begin % (w + 1)
    return Runs(_connected(begin, end, w + 1), row, first, end - begin)


def _connected(begin: np.ndarray, end: np.ndarray, step: int) -> np.ndarray:
    """(m,) numbers of the blobs of runs, whose places in memory `begin` and `end` (m,) are one `step` a row apart."""
    m = len(begin)
    # The runs that touch one from below lie next to each other.
    touching = np.searchsorted(end, begin + step, "right"), np.searchsorted(begin, end + step, "left")
    count = touching[1] - touching[0]
    pointer = np.concatenate([[0], np.cumsum(count)])
    below = np.arange(pointer[-1]) + np.repeat(touching[0] - pointer[:-1], count)
    graph = csr_array((np.ones(len(below), np.int8), below, pointer), shape=(m, m))
    return connected_components(graph, directed=False)[1]
