"""A print as DXF in millimetres, for plotters, engravers and drawings: circles, arcs and boxes as they are."""

import io

import numpy as np

from testfield.author.drawn_page import boxes
from testfield.author.prints import Print
from testfield.errors import TestfieldError


def as_dxf(one: Print) -> bytes:
    """The outlines of all that is printed, and of the board, about its middle. Raises `TestfieldError` where the
    package for it is missing."""
    try:
        import ezdxf
        from ezdxf import units
    except ImportError as error:
        raise TestfieldError(
            "DXF is written by a package that is not installed", "--formats dxf", "pip install 'testfield[print]'"
        ) from error

    document = ezdxf.new("R2010", units=units.MM)
    for layer, colour in (("BOARD", 8), ("DOTS", 7), ("RINGS", 7), ("CELLS", 7)):
        document.layers.add(layer, color=colour)
    space = document.modelspace()
    x, y = (one.size_mm / 2).tolist()
    space.add_lwpolyline([(-x, -y), (x, -y), (x, y), (-x, y)], close=True, dxfattribs={"layer": "BOARD"})
    for (cx, cy), diameter in zip(one.marks.xy_mm.tolist(), one.marks.diameter_mm.tolist(), strict=True):
        space.add_circle((cx, cy), diameter / 2, dxfattribs={"layer": "DOTS"})
    for s in one.sectors:
        # A polyline's bulge is the tangent of a quarter of its arc.
        bulge = float(np.tan((s.last_rad - s.first_rad) / 4))
        ends = [(np.cos(a), np.sin(a)) for a in (s.first_rad, s.last_rad)]
        (ax, ay), (bx, by) = ends
        cx, cy = s.xy_mm
        points = [
            (cx + s.outer_mm * ax, cy + s.outer_mm * ay, bulge),
            (cx + s.outer_mm * bx, cy + s.outer_mm * by, 0.0),
            (cx + s.inner_mm * bx, cy + s.inner_mm * by, -bulge),
            (cx + s.inner_mm * ax, cy + s.inner_mm * ay, 0.0),
        ]
        space.add_lwpolyline(points, format="xyb", close=True, dxfattribs={"layer": "RINGS"})
    if one.cells is not None:
        for left, bottom, right, top in boxes(one.cells.x_mm, one.cells.y_mm, one.cells.black):
            corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
            space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "CELLS"})
    buffer = io.StringIO()
    document.write(buffer)
    return buffer.getvalue().encode()
