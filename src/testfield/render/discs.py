"""Prints of discs of ink and of paper, one within the other (CCTags), integrated in closed form over footprints."""

from typing import Any

import numpy as np

from testfield.render.footprint import half_plane
from testfield.render.lookup import bin_of
from testfield.render.near import in_one_list, listed
from testfield.render.variant import mitsuba
from testfield.scene.world import Panels, Print


class DiscTables:
    """Look-up tables on the device: all discs, and for each panel a grid of bins that lists those nearby."""

    def __init__(self, panels: Panels, prints: tuple[Print, ...]):
        mi = mitsuba()
        shown = [(part.panel, part.discs) for part in prints if part.discs is not None]
        panel = np.concatenate([np.full(len(discs.radius_mm), k) for k, discs in shown])
        xy_mm = np.concatenate([discs.xy_mm for _, discs in shown])
        radius_mm = np.concatenate([discs.radius_mm for _, discs in shown])
        cells = [listed(size, xy_mm, radius_mm, np.flatnonzero(panel == k)) for k, size in enumerate(panels.size_mm)]
        bins = in_one_list(cells)
        self.candidates = bins.candidates
        self.width, self.height = (mi.Float(panels.size_mm[:, k].astype(np.float32)) for k in (0, 1))
        self.start, self.list = mi.UInt32(bins.start), mi.Int32(bins.indices)
        self.columns, self.rows = mi.UInt32(bins.columns), mi.UInt32(bins.rows)
        self.x, self.y = (mi.Float(xy_mm[:, k].astype(np.float32)) for k in (0, 1))
        self.radius = mi.Float(radius_mm.astype(np.float32))
        self.sign = mi.Float(np.concatenate([discs.sign for _, discs in shown]).astype(np.float32))

    def coverage(self, panel: Any, x: Any, y: Any, jacobian: tuple) -> Any:
        """Part that is ink of the footprint around points (x, y) mm of panels."""
        mi = mitsuba()
        import drjit as dr

        xx, xy, yx, yy = jacobian
        width, height = dr.gather(mi.Float, self.width, panel), dr.gather(mi.Float, self.height, panel)
        columns, rows = dr.gather(mi.UInt32, self.columns, panel), dr.gather(mi.UInt32, self.rows, panel)
        column = bin_of((x / width + 0.5) * mi.Float(columns), columns)
        row = bin_of((y / height + 0.5) * mi.Float(rows), rows)
        first = dr.gather(mi.UInt32, self.start, panel) + (row * columns + column) * self.candidates
        ink = mi.Float(0)
        for k in range(self.candidates):
            disc = dr.gather(mi.Int32, self.list, first + k)
            here, index = disc >= 0, mi.UInt32(dr.maximum(disc, 0))
            dx = x - dr.gather(mi.Float, self.x, index, here)
            dy = y - dr.gather(mi.Float, self.y, index, here)
            radius = dr.gather(mi.Float, self.radius, index, here)
            r = dr.maximum(dr.sqrt(dx * dx + dy * dy), 1e-6)
            nx, ny = dx / r, dy / r
            radial = (nx * xx + ny * yx, nx * xy + ny * yy)
            tangential = (ny * xx - nx * yx, ny * xy - nx * yy)
            # A circle bends away from its tangent: over the footprint its mean distance is less by this much.
            sag = (tangential[0] ** 2 + tangential[1] ** 2) / (24 * dr.maximum(r, radius / 2))
            covered = half_plane(radius - r - sag, radial)
            ink += dr.select(here, dr.gather(mi.Float, self.sign, index, here) * covered, 0)
        return ink
