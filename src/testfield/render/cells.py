"""Prints of rectangular cells (squares, tags), integrated in closed form over footprints.

In a footprint that meets one line of each direction at most, four cells meet at a corner; what it sees of each follows
from the parts on either side of the two lines and in one corner. The lines next to a point come from a table of even
bins, so the cost does not grow with the number of cells.
"""

from typing import Any

import numpy as np

from testfield.render.footprint import half_plane, quarter_plane
from testfield.render.lookup import bin_of
from testfield.render.variant import mitsuba
from testfield.scene.world import Print

MOST_BINS = 65536


class CellTables:
    """Look-up tables on the device: for each panel the lines of both directions, the bins to find them, the cells."""

    def __init__(self, panels: int, prints: tuple[Print, ...]):
        mi = mitsuba()
        row_of_panel = np.full(panels, -1)
        row_of_panel[[part.panel for part in prints]] = np.arange(len(prints))
        self.row = mi.Int32(row_of_panel)
        self.x, self.y = (_Lines([lines(part) for part in prints]) for lines in (_x_lines, _y_lines))
        # One more row and column of white on every side, so that a line always has a cell on either side.
        black = [np.pad(part.cells.black, 1) for part in prints]
        self.first_cell = mi.UInt32(np.cumsum([0] + [part.size for part in black[:-1]]))
        self.width = mi.UInt32([part.shape[1] for part in black])
        self.black = mi.Float(np.concatenate([part.ravel() for part in black]).astype(np.float32))

    def coverage(self, panel: Any, x: Any, y: Any, jacobian: tuple) -> Any:
        """Part that is ink of the footprint around points (x, y) mm of panels; the whole width of a footprint should
        not exceed that of a cell."""
        mi = mitsuba()
        import drjit as dr

        row = dr.gather(mi.Int32, self.row, panel)
        here, index = row >= 0, mi.UInt32(dr.maximum(row, 0))
        column_line, x_mm = self.x.nearest(index, x)
        row_line, y_mm = self.y.nearest(index, y)
        d, e = x - x_mm, y - y_mm
        g, h = (jacobian[0], jacobian[1]), (jacobian[2], jacobian[3])
        right, above = half_plane(d, g), half_plane(e, h)
        both = quarter_plane(d, g, e, h, right, above)
        width = dr.gather(mi.UInt32, self.width, index)
        corner = dr.gather(mi.UInt32, self.first_cell, index) + row_line * width + column_line
        below_left, below_right, above_left, above_right = (
            dr.gather(mi.Float, self.black, corner + step, here) for step in (0, 1, width, width + 1)
        )
        ink = below_left + (below_right - below_left) * right + (above_left - below_left) * above
        return dr.select(here, ink + (above_right - above_left - below_right + below_left) * both, 0)


class _Lines:
    """Ascending lines of one direction for each print, and even bins no wider than the lines are apart."""

    def __init__(self, lines: list[np.ndarray]):
        mi = mitsuba()
        bins = [int(np.clip(np.ceil(np.ptp(v) / np.diff(v).min()), 1, MOST_BINS)) for v in lines]
        before = [
            np.searchsorted(v, v[0] + np.ptp(v) * np.arange(n) / n, side="right") - 1
            for v, n in zip(lines, bins, strict=True)
        ]
        self.first_line = mi.UInt32(np.cumsum([0] + [len(v) for v in lines[:-1]]))
        self.last = mi.UInt32([len(v) - 1 for v in lines])
        self.at = mi.Float(np.concatenate(lines).astype(np.float32))
        self.first_bin, self.bins = mi.UInt32(np.cumsum([0] + bins[:-1])), mi.UInt32(bins)
        self.low = mi.Float(np.array([v[0] for v in lines], np.float32))
        self.bins_a_mm = mi.Float(np.array([n / np.ptp(v) for v, n in zip(lines, bins, strict=True)], np.float32))
        self.before = mi.UInt32(np.concatenate(before))

    def nearest(self, index: Any, at: Any) -> tuple[Any, Any]:
        """Number of the line nearest to a coordinate in mm, and where it is."""
        mi = mitsuba()
        import drjit as dr

        def of_print(table: Any, kind: Any) -> Any:
            return dr.gather(kind, table, index)

        bins = of_print(self.bins, mi.UInt32)
        place = (at - of_print(self.low, mi.Float)) * of_print(self.bins_a_mm, mi.Float)
        line = dr.gather(mi.UInt32, self.before, of_print(self.first_bin, mi.UInt32) + bin_of(place, bins))
        first, last = of_print(self.first_line, mi.UInt32), of_print(self.last, mi.UInt32)
        # A bin holds one line at most besides the one before it: of those three the nearest is the nearest of all.
        best, best_mm = line, dr.gather(mi.Float, self.at, first + line)
        for step in (1, 2):
            other = dr.minimum(line + step, last)
            other_mm = dr.gather(mi.Float, self.at, first + other)
            nearer = dr.abs(at - other_mm) < dr.abs(at - best_mm)
            best, best_mm = dr.select(nearer, other, best), dr.select(nearer, other_mm, best_mm)
        return best, best_mm


def _x_lines(part: Print) -> np.ndarray:
    return part.cells.x_mm


def _y_lines(part: Print) -> np.ndarray:
    return part.cells.y_mm
