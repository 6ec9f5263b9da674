"""Which marks are near: bins of a panel and the marks that may touch each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bins:
    """Bins of all panels in one `indices`, so many `candidates` a bin: those of a panel begin at `start` (panels,), its
    `rows` and `columns` (panels,) row by row."""

    candidates: int
    start: np.ndarray
    rows: list[int]
    columns: list[int]
    indices: np.ndarray


def in_one_list(cells: Sequence[np.ndarray]) -> Bins:
    """What `listed` gives for each panel, filled up to the longest bin of all."""
    most = max((cell.shape[2] for cell in cells), default=1)
    padded = [np.pad(c, ((0, 0), (0, 0), (0, most - c.shape[2])), constant_values=-1) for c in cells]
    start = np.cumsum([0] + [part.size for part in padded[:-1]])
    rows, columns = [part.shape[0] for part in padded], [part.shape[1] for part in padded]
    return Bins(most, start, rows, columns, np.concatenate([part.ravel() for part in padded]))


def listed(size_mm: np.ndarray, xy_mm: np.ndarray, extent_mm: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """(rows, columns, k) indices of the marks that may touch each cell of a panel, -1 where fewer than k do."""
    if len(marks) == 0:
        return np.full((1, 1, 1), -1)
    cell_mm = max(2 * np.median(extent_mm[marks]), size_mm.max() / 256)
    columns, rows = (int(n) for n in np.clip(size_mm // cell_mm, 1, 256))
    # An edge is felt within a footprint of it; three millimetres are more than any footprint in use.
    reach = extent_mm[marks] + 3.0
    low = (xy_mm[marks] - reach[:, None] + size_mm / 2) / size_mm * [columns, rows]
    high = (xy_mm[marks] + reach[:, None] + size_mm / 2) / size_mm * [columns, rows]
    lists: list[list[list[int]]] = [[[] for _ in range(columns)] for _ in range(rows)]
    for mark, (x0, y0), (x1, y1) in zip(marks, np.floor(low), np.floor(high), strict=True):
        for row in range(max(int(y0), 0), min(int(y1), rows - 1) + 1):
            for column in range(max(int(x0), 0), min(int(x1), columns - 1) + 1):
                lists[row][column].append(int(mark))
    most = max(1, max(len(cell) for row_lists in lists for cell in row_lists))
    table = np.full((rows, columns, most), -1)
    for row in range(rows):
        for column in range(columns):
            table[row, column, : len(lists[row][column])] = lists[row][column]
    return table
