"""Number the dots of a hexagonal grid, whatever else the photograph shows."""

import numpy as np

from testfield.detect.circle_grid import order_grid
from testfield.targets.kinds.hexcircles import row_shifts

SIXTH = np.array([[0, 1], [-1, 1]])
"""Column and row steps (a, b) of a lattice at 60 degrees become those of the lattice turned by 60 degrees."""
OF_120 = np.array([[1, 0], [-1, 1]])
"""Steps of a lattice whose axes are 120 degrees apart become those of axes at 60 degrees."""


def order_hexagonal(xy_px: np.ndarray, diameter_px: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Place in its row and row (n, 2) of each dot of a complete hexagonal grid, -1 for dots that are not in it.

    A hexagonal grid is a regular one in skew axes, so `order_grid` follows it; what is left to find is which of the
    lattice's six directions the rows take, and which end is the first. The grid is never numbered mirrored, and of two
    numberings that fit (an even number of rows looks the same upside down) the one whose first dot is nearest to the
    image's top left is taken.
    """
    nothing = np.full((len(xy_px), 2), -1)
    lattice = order_grid(xy_px, diameter_px)
    inside = np.flatnonzero(lattice[:, 0] >= 0)
    if len(inside) < columns * rows:
        return nothing
    best, least = nothing, np.inf
    for skew in (np.eye(2, dtype=int), OF_120):  # perspective hides which of the two angles the axes make
        at = lattice[inside] @ skew
        for _ in range(6):
            at = at @ SIXTH
            for own, place in _fitting(at, columns, rows):
                first = xy_px[inside[own[0]]].sum()
                if first < least:
                    best, least = nothing.copy(), first
                    best[inside[own]] = place
    return best


def _fitting(at: np.ndarray, columns: int, rows: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Which dots (m,) make up the whole grid, and their places (m, 2), for each first row that leaves no other choice;
    none where the grid is part of a larger one."""
    there = {(int(a), int(b)): k for k, (a, b) in enumerate(at)}
    row, k = np.divmod(np.arange(columns * rows), columns)
    shift = row_shifts(rows)
    wanted = np.column_stack([k + (shift[row] - shift[0] - row) // 2, row])
    whole = []
    for first in at:
        own = [there.get((int(a), int(b)), -1) for a, b in wanted[[0, columns - 1, -columns, -1]] + first]
        if min(own) < 0:
            continue
        own = [there.get((int(a), int(b)), -1) for a, b in wanted + first]
        if min(own) >= 0:
            whole.append((np.array(own), np.column_stack([k, row])))
    return whole if len(whole) == 1 else []
