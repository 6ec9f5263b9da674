"""What is printed on the panels, evaluated analytically at any point of any panel.

Given a footprint (the image of a small square of the sensor on the panel), a mark's coverage of it is integrated in
closed form, so an edge has no sampling error; without one the answer is inside or outside. Both renderers use this
one texture, hence they see the same boards.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from testfield.render.cells import CellTables
from testfield.render.discs import DiscTables
from testfield.render.footprint import half_plane, quarter_plane
from testfield.render.lookup import bin_of
from testfield.render.near import in_one_list, listed
from testfield.render.variant import mitsuba
from testfield.scene.world import Dirt, Panels, Print, TrueMarks
from testfield.targets.code_table import CodeTable, words_of


class PatternTables:
    """Look-up tables on the device: panels, marks, and for each panel a grid of cells that lists nearby marks."""

    def __init__(
        self,
        panels: Panels,
        marks: TrueMarks,
        bits: int,
        dirt: Dirt | None = None,
        prints: tuple[Print, ...] = (),
        codes: CodeTable | None = None,
    ):
        mi = mitsuba()
        self.bits, self.ring = bits, marks.radii
        extent = marks.printed_radius_mm
        words = np.zeros(len(marks), np.uint32)
        words[marks.code > 0] = words_of(marks.code[marks.code > 0], bits, codes)
        cells = [
            listed(size, marks.xy_mm, extent, np.flatnonzero((marks.panel == k) & ~marks.corner))
            for k, size in enumerate(panels.size_mm)
        ]
        bins = in_one_list(cells)
        self.candidates = bins.candidates

        self.width, self.height = (mi.Float(panels.size_mm[:, k].astype(np.float32)) for k in (0, 1))
        self.ground, self.ink = mi.Float(panels.ground_albedo), mi.Float(panels.ink_albedo)
        self.start, self.list = mi.UInt32(bins.start), mi.Int32(bins.indices)
        self.columns, self.rows = mi.UInt32(bins.columns), mi.UInt32(bins.rows)
        self.any_dots = bool((~marks.corner).any())
        if self.any_dots:
            self.x, self.y = (mi.Float(marks.xy_mm[:, k].astype(np.float32)) for k in (0, 1))
            self.radius, self.word = mi.Float(marks.diameter_mm / 2), mi.UInt32(words)
        self.dirt = DirtTables(panels, dirt) if dirt is not None and len(dirt) else None
        self.prints = CellTables(len(panels), prints) if prints else None
        self.discs = DiscTables(panels, prints) if any(part.discs is not None for part in prints) else None

    def coverage(self, panel: Any, uv: Any, duv_dx: Any, duv_dy: Any, parts: int) -> Any:
        """Fraction of the footprint that is ink, in [0, 1].

        The footprint is divided into `parts` x `parts`, in each of which a mark's edges are taken as straight but for
        their mean sag.
        """
        mi = mitsuba()
        import drjit as dr

        width, height = dr.gather(mi.Float, self.width, panel), dr.gather(mi.Float, self.height, panel)
        x, y = (uv.x - 0.5) * width, (uv.y - 0.5) * height
        jacobian = (duv_dx.x * width, duv_dy.x * width, duv_dx.y * height, duv_dy.y * height)
        columns, rows = dr.gather(mi.UInt32, self.columns, panel), dr.gather(mi.UInt32, self.rows, panel)
        column, row = bin_of(uv.x * mi.Float(columns), columns), bin_of(uv.y * mi.Float(rows), rows)
        first = dr.gather(mi.UInt32, self.start, panel) + (row * columns + column) * self.candidates
        part = tuple(value / parts for value in jacobian)
        middle = (np.arange(parts) + 0.5) / parts - 0.5
        steps = [(float(a), float(b)) for a in middle for b in middle]
        ink = mi.Float(0)
        for k in range(self.candidates if self.any_dots else 0):
            mark = dr.gather(mi.Int32, self.list, first + k)
            here = mark >= 0
            index = mi.UInt32(dr.maximum(mark, 0))
            dx = x - dr.gather(mi.Float, self.x, index, here)
            dy = y - dr.gather(mi.Float, self.y, index, here)
            radius = dr.gather(mi.Float, self.radius, index, here)
            word = dr.gather(mi.UInt32, self.word, index, here)
            for a, b in steps:
                shift_x, shift_y = a * jacobian[0] + b * jacobian[1], a * jacobian[2] + b * jacobian[3]
                ink += dr.select(here, self._mark(dx + shift_x, dy + shift_y, radius, word, part), 0)
        for printed in (self.prints, self.discs):
            if printed is None:
                continue
            for a, b in steps:
                shift_x, shift_y = a * jacobian[0] + b * jacobian[1], a * jacobian[2] + b * jacobian[3]
                ink += printed.coverage(panel, x + shift_x, y + shift_y, part)
        return dr.minimum(ink / parts**2, 1)

    def _mark(self, dx: Any, dy: Any, radius: Any, word: Any, jacobian: tuple) -> Any:
        mi = mitsuba()
        import drjit as dr

        xx, xy, yx, yy = jacobian
        r = dr.maximum(dr.sqrt(dx * dx + dy * dy), 1e-6)
        nx, ny = dx / r, dy / r
        radial = (nx * xx + ny * yx, nx * xy + ny * yy)
        tangential = (ny * xx - nx * yx, ny * xy - nx * yy)  # towards clockwise, seen from the front
        # A circle bends away from its tangent: over the footprint its mean distance is less by this much.
        sag = (tangential[0] ** 2 + tangential[1] ** 2) / (24 * dr.maximum(r, radius / 2))

        def inside(edge: Any) -> Any:
            return half_plane(edge - r - sag, radial)

        angle = dr.atan2(-dy, dx)
        turn = angle * (self.bits / (2 * np.pi))
        turn = dr.select(turn < 0, turn + self.bits, turn)
        boundary = dr.round(turn)
        spoke = r * dr.sin((turn - boundary) * (2 * np.pi / self.bits))
        clockwise = half_plane(spoke, tangential)
        after = bin_of(boundary, self.bits + 1) % self.bits
        before = (after + self.bits - 1) % self.bits
        bit_after = mi.Float((word >> (self.bits - 1 - after)) & 1)
        bit_before = mi.Float((word >> (self.bits - 1 - before)) & 1)

        def sector(edge: Any) -> Any:
            """Ink within the circle `edge`, on either side of the nearest spoke."""
            whole = inside(edge)
            outwards = (-radial[0], -radial[1])
            both = quarter_plane(edge - r - sag, outwards, spoke, tangential, whole, clockwise)
            return bit_after * both + bit_before * (whole - both)

        ring = sector(self.ring.outer * radius) - sector(self.ring.inner * radius)
        return inside(radius) + dr.select(word > 0, ring, 0)


class DirtTables:
    """Look-up tables on the device of spots of dirt, found through a grid of cells as the marks are."""

    def __init__(self, panels: Panels, dirt: Dirt):
        mi = mitsuba()
        cells = [
            listed(size, dirt.xy_mm, dirt.radius_mm, np.flatnonzero(dirt.panel == k))
            for k, size in enumerate(panels.size_mm)
        ]
        bins = in_one_list(cells)
        self.candidates = bins.candidates
        self.width, self.height = (mi.Float(panels.size_mm[:, k].astype(np.float32)) for k in (0, 1))
        self.start, self.list = mi.UInt32(bins.start), mi.Int32(bins.indices)
        self.columns, self.rows = mi.UInt32(bins.columns), mi.UInt32(bins.rows)
        self.x, self.y = (mi.Float(dirt.xy_mm[:, k].astype(np.float32)) for k in (0, 1))
        self.radius, self.albedo = mi.Float(dirt.radius_mm), mi.Float(dirt.albedo)

    def over(self, below: Any, panel: Any, uv: Any, duv_dx: Any, duv_dy: Any, parts: int, black: bool = False) -> Any:
        """Reflectance with the spots over that of the print, `below`; `black` as if the spots reflected nothing.

        Where a spot's edge crosses a mark's within one footprint, what lies under the spot is taken as the footprint's
        mean.
        """
        mi = mitsuba()
        import drjit as dr

        width, height = dr.gather(mi.Float, self.width, panel), dr.gather(mi.Float, self.height, panel)
        x, y = (uv.x - 0.5) * width, (uv.y - 0.5) * height
        xx, xy, yx, yy = duv_dx.x * width, duv_dy.x * width, duv_dx.y * height, duv_dy.y * height
        columns, rows = dr.gather(mi.UInt32, self.columns, panel), dr.gather(mi.UInt32, self.rows, panel)
        column, row = bin_of(uv.x * mi.Float(columns), columns), bin_of(uv.y * mi.Float(rows), rows)
        first = dr.gather(mi.UInt32, self.start, panel) + (row * columns + column) * self.candidates
        middle = (np.arange(parts) + 0.5) / parts - 0.5
        for k in range(self.candidates):
            spot = dr.gather(mi.Int32, self.list, first + k)
            here, index = spot >= 0, mi.UInt32(dr.maximum(spot, 0))
            dx = x - dr.gather(mi.Float, self.x, index, here)
            dy = y - dr.gather(mi.Float, self.y, index, here)
            radius = dr.gather(mi.Float, self.radius, index, here)
            covered = mi.Float(0)
            for a, b in ((float(a), float(b)) for a in middle for b in middle):
                px, py = dx + a * xx + b * xy, dy + a * yx + b * yy
                r = dr.maximum(dr.sqrt(px * px + py * py), 1e-6)
                nx, ny = px / r, py / r
                radial = ((nx * xx + ny * yx) / parts, (nx * xy + ny * yy) / parts)
                tangential = ((ny * xx - nx * yx) / parts, (ny * xy - nx * yy) / parts)
                sag = (tangential[0] ** 2 + tangential[1] ** 2) / (24 * dr.maximum(r, radius / 2))
                covered += half_plane(radius - r - sag, radial)
            covered = dr.select(here, covered / parts**2, 0)
            albedo = 0 if black else dr.gather(mi.Float, self.albedo, index, here)
            below = below + covered * (albedo - below)
        return below


@lru_cache
def pattern_texture_class() -> type:
    """The plugin class, registered once."""
    mi = mitsuba()
    import drjit as dr

    class PatternTexture(mi.Texture):  # type: ignore[name-defined]
        def __init__(self, props: Any):
            super().__init__(props)
            self.tables: PatternTables | None = None
            self.panel_of_shape: Any = None
            self.bent: Any = None

        def panel(self, si: Any) -> Any:
            number: Any = dr.reinterpret_array(mi.UInt32, si.shape)
            return dr.gather(mi.UInt32, self.panel_of_shape, number)

        def on_surface(self, si: Any, active: Any = True) -> Any:
            """The path tracer's hit, moved from the mesh to the surface along the ray that found it."""
            if not self.bent:
                return si
            ray = mi.Ray3f(si.p, -si.to_world(si.wi))
            at = mi.SurfaceInteraction3f(si)
            at.t = mi.Float(0)
            return self.bent.refine(at, ray, self.panel(si), active)

        def eval_1(self, si, active=True):  # type: ignore[no-untyped-def]
            return self.reflectance(self.on_surface(si, active), 1)

        def reflectance(self, si: Any, parts: int) -> Any:
            tables = self.tables
            assert tables is not None
            panel = self.panel(si)
            ink = tables.coverage(panel, si.uv, si.duv_dx, si.duv_dy, parts)
            ground = dr.gather(mi.Float, tables.ground, panel)
            printed = ground + ink * (dr.gather(mi.Float, tables.ink, panel) - ground)
            if tables.dirt is None:
                return printed
            return tables.dirt.over(printed, panel, si.uv, si.duv_dx, si.duv_dy, parts)

        def coverage(self, si: Any, shift_mm: tuple[Any, Any], parts: int) -> Any:
            """Part of a hit's footprint that is clean ink, of a print moved by `shift_mm` along the panel's x and y."""
            tables = self.tables
            assert tables is not None
            panel = self.panel(si)
            size = dr.gather(mi.Float, tables.width, panel), dr.gather(mi.Float, tables.height, panel)
            uv = mi.Point2f(si.uv.x - shift_mm[0] / size[0], si.uv.y - shift_mm[1] / size[1])
            ink = tables.coverage(panel, uv, si.duv_dx, si.duv_dy, parts)
            if tables.dirt is None:
                return ink
            return ink * tables.dirt.over(mi.Float(1), panel, si.uv, si.duv_dx, si.duv_dy, parts, black=True)

        def eval(self, si, active=True):  # type: ignore[no-untyped-def]
            return mi.Color1f(self.eval_1(si, active))

        def mean(self):  # type: ignore[no-untyped-def]
            return mi.Float(0.5)

        def to_string(self):  # type: ignore[no-untyped-def]
            return "PatternTexture[]"

        def is_spatially_varying(self):  # type: ignore[no-untyped-def]
            return True

    mi.register_texture("testfield_pattern", PatternTexture)
    return PatternTexture
