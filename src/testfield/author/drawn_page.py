"""Pages as PDF, SVG and PNG, true to scale: a millimetre of a page is a millimetre of its file."""

import io
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from testfield.author.pages import CAPTION_MM, Page
from testfield.author.prints import Print

MM_AN_INCH = 25.4
CROP_MM, CROP_OFF_MM = 4.0, 1.0
"""Length of the lines that show where to cut, and how far they keep from the print."""
RULER_MM = (100, 50, 20, 10)
"""Lengths of the ruler, the first that the page has room for."""
ARC_RAD = np.pi / 16
"""Arcs are cubic curves over so much at most, which keep to the circle within 1e-8 of its radius."""
MOST_PIXELS = 250e6
NUMBER_HIGH, NUMBER_WIDE, NUMBER_OFF = 0.14, 0.3, 0.03
"""Of a card's number, in half its side: most height of the font, most width, and from the edges. It lies outside of the
circle that touches the sides, because (1 - 0.33)^2 + (1 - 0.17)^2 is more than 1."""
DIGIT_WIDE = 0.65
"""Width of a digit over the size of the font."""
FAINT = "#8a8a8a"


def as_pdf(pages: Sequence[Page], caption: str) -> bytes:
    """All pages in one file, which asks viewers to print it as large as it is."""
    from matplotlib.backends.backend_pdf import PdfPages
    from pypdf import PdfReader, PdfWriter

    buffer = io.BytesIO()
    with PdfPages(buffer, metadata={"CreationDate": None, "Creator": "testfield", "Title": caption}) as file:
        for page in pages:
            file.savefig(_figure(page, caption))
    writer = PdfWriter(clone_from=PdfReader(io.BytesIO(buffer.getvalue())))
    preferences: Any = writer.create_viewer_preferences()
    preferences.print_scaling = "/None"
    whole = io.BytesIO()
    writer.write(whole)
    return whole.getvalue()


def as_svg(page: Page, caption: str) -> bytes:
    """A page, whose width and height are in mm."""
    from matplotlib import rc_context

    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "testfield", "svg.fonttype": "path"}):
        _figure(page, caption).savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return _in_mm(buffer.getvalue(), page.paper_mm)


def as_png(page: Page, caption: str, dpi: float) -> bytes:
    """A page in grey, whose edges are as full as they are true, with its resolution written in the file."""
    from PIL import Image

    # Whole pixels from the top left corner on; a page is seldom a whole number of them.
    whole_mm = np.ceil(page.paper_mm * dpi / MM_AN_INCH) * MM_AN_INCH / dpi
    figure = _figure(page, caption)
    figure.set_size_inches(*(whole_mm / MM_AN_INCH))
    figure.axes[0].set(xlim=(0, whole_mm[0]), ylim=(page.paper_mm[1] - whole_mm[1], page.paper_mm[1]))
    figure.set_dpi(dpi)
    canvas: Any = figure.canvas
    canvas.draw()
    grey = np.asarray(canvas.buffer_rgba())[..., 0]
    buffer = io.BytesIO()
    Image.fromarray(grey).save(buffer, "PNG", dpi=(dpi, dpi))
    return buffer.getvalue()


def pixels(page: Page, dpi: float) -> float:
    """How many pixels a page has."""
    return float(np.prod(page.paper_mm * dpi / MM_AN_INCH))


def _figure(page: Page, caption: str) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path

    width, height = page.paper_mm
    figure = Figure((width / MM_AN_INCH, height / MM_AN_INCH), facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    middle = page.paper_mm / 2 + page.shift_mm
    low = middle - page.print.size_mm / 2
    ink = "white" if page.print.white_on_black else "black"
    for left, bottom, right, top in page.print.areas_mm + np.tile(middle, 2):
        if page.print.white_on_black:
            axes.add_patch(
                Rectangle((left, bottom), right - left, top - bottom, facecolor="black", linewidth=0, snap=False)
            )
        _crop_marks(axes, np.array([left, bottom]), np.array([right, top]), page.print.cards is not None)
    if page.print.cards is not None:
        _numbers(axes, page, middle)
    vertices, codes = _outlines(page.print)
    if len(vertices):
        path = Path(vertices + middle, codes)
        path.should_simplify = False
        axes.add_patch(PathPatch(path, facecolor=ink, linewidth=0, snap=False))
    _captions(axes, page, low, caption)
    return figure


def _outlines(one: Print) -> tuple[np.ndarray, np.ndarray]:
    """All shapes as one path: where two of them touch, no seam shows."""
    from matplotlib.path import Path

    parts = []
    for (x, y), diameter in zip(one.marks.xy_mm, one.marks.diameter_mm, strict=True):
        parts.append(_closed(_arc(x, y, diameter / 2, 0, 2 * np.pi)))
    for s in one.sectors:
        outer = _arc(*s.xy_mm, s.outer_mm, s.first_rad, s.last_rad)
        inner = _arc(*s.xy_mm, s.inner_mm, s.last_rad, s.first_rad)
        line = np.array([Path.LINETO])
        parts.append(_closed((np.concatenate([outer[0], inner[0]]), np.concatenate([outer[1], line, inner[1][1:]]))))
    if one.cells is not None:
        for left, bottom, right, top in boxes(one.cells.x_mm, one.cells.y_mm, one.cells.black):
            corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
            parts.append(_closed((corners, np.array([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO]))))
    if not parts:
        return np.zeros((0, 2)), np.zeros(0, np.uint8)
    vertices, codes = zip(*parts, strict=True)
    return np.concatenate(vertices), np.concatenate(codes)


def boxes(x_mm: np.ndarray, y_mm: np.ndarray, black: np.ndarray) -> list[tuple[float, float, float, float]]:
    """Left, bottom, right and top of as few boxes as black cells are easily put together to: runs of a row, and the
    same runs of the rows above."""
    found = []
    opened: dict[tuple[int, int], int] = {}
    for row in range(len(black) + 1):
        runs = set()
        if row < len(black):
            edge = np.diff(np.concatenate([[0], black[row].astype(int), [0]]))
            runs = set(zip(np.flatnonzero(edge > 0).tolist(), np.flatnonzero(edge < 0).tolist(), strict=True))
        for run in [run for run in opened if run not in runs]:
            found.append((run[0], opened.pop(run), run[1], row))
        for run in runs:
            opened.setdefault(run, row)
    return [(float(x_mm[a]), float(y_mm[b]), float(x_mm[c]), float(y_mm[d])) for a, b, c, d in sorted(found)]


def _arc(x: float, y: float, radius: float, first: float, last: float) -> tuple[np.ndarray, np.ndarray]:
    """An arc from one angle to another, as cubic curves whose ends and directions are the circle's."""
    from matplotlib.path import Path

    count = max(1, int(np.ceil(abs(last - first) / ARC_RAD - 1e-9)))
    angle = np.linspace(first, last, count + 1)
    pull = 4 / 3 * np.tan((last - first) / count / 4)
    at, way = np.column_stack([np.cos(angle), np.sin(angle)]), np.column_stack([-np.sin(angle), np.cos(angle)])
    curves = np.stack([at[:-1] + pull * way[:-1], at[1:] - pull * way[1:], at[1:]], axis=1).reshape(-1, 2)
    vertices = np.array([x, y]) + radius * np.concatenate([at[:1], curves])
    return vertices, np.array([Path.MOVETO, *[Path.CURVE4] * len(curves)], np.uint8)


def _closed(part: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    from matplotlib.path import Path

    return np.concatenate([part[0], part[0][:1]]), np.append(part[1], Path.CLOSEPOLY).astype(np.uint8)


def _crop_marks(axes: Any, low: np.ndarray, high: np.ndarray, near: bool) -> None:
    """Lines at the corners of what is cut out; `near` where others are close by."""
    off, long = (CROP_OFF_MM, CROP_MM) if not near else (CROP_OFF_MM / 4, CROP_MM / 4)
    for x, outward_x in ((low[0], -1), (high[0], 1)):
        for y, outward_y in ((low[1], -1), (high[1], 1)):
            along = [x + outward_x * off, x + outward_x * (off + long)], [y, y]
            upright = [x, x], [y + outward_y * off, y + outward_y * (off + long)]
            for ends in (along, upright):
                axes.plot(*ends, color="black", linewidth=0.3, clip_on=False)


def _numbers(axes: Any, page: Page, middle: np.ndarray) -> None:
    """Each card's code in its lower left corner, outside of the circle that the ring needs free."""
    for (left, bottom, right, _), code in zip(page.print.areas_mm, page.print.marks.code, strict=True):
        half = (right - left) / 2
        size_mm = min(NUMBER_HIGH * half, NUMBER_WIDE * half / (DIGIT_WIDE * len(str(code))))
        axes.text(
            left + middle[0] + NUMBER_OFF * half,
            bottom + middle[1] + NUMBER_OFF * half,
            str(code),
            fontsize=size_mm * 72 / 25.4,
            color=FAINT,
            va="baseline",
        )


def _captions(axes: Any, page: Page, low: np.ndarray, caption: str) -> None:
    """The ruler and what the page is, below the print; where to glue, on the strip for it."""
    width = float(page.paper_mm[0])
    left = max(float(low[0]), 8.0)
    base = float(low[1]) - page.overlap_mm * page.glue[1] - CAPTION_MM
    room = width - left - 8
    length = next((n for n in RULER_MM if n <= room - 2), 0)
    for mm in range(length + 1):
        tall = 3.0 if mm % 10 == 0 else 2.2 if mm % 5 == 0 else 1.4
        axes.plot([left + mm] * 2, [base + 6.2, base + 6.2 + tall], color="black", linewidth=0.25)
    if length:
        axes.plot([left, left + length], [base + 6.2] * 2, color="black", linewidth=0.25)
        axes.text(left + length + 1.5, base + 6.2, f"{length} mm", fontsize=6, color="black")
    part = f", page {page.number} of {page.count}" if page.count > 1 else ""
    axes.text(left, base + 2.4, f"{page.of}{part}   {caption}", fontsize=6, color="black", clip_on=True)
    if page.glue[0]:
        x = float(low[0]) - page.overlap_mm / 2
        axes.text(
            x, float(low[1]) + 30, "glue the neighbour on here", fontsize=5, color=FAINT, rotation=90, ha="center"
        )
    if page.glue[1]:
        y = float(low[1]) - page.overlap_mm / 2
        axes.text(float(low[0]) + 30, y, "glue the neighbour on here", fontsize=5, color=FAINT, va="center")


def _in_mm(svg: bytes, paper_mm: np.ndarray) -> bytes:
    """Width and height of an SVG in mm instead of points, which some programs take for pixels."""
    text = svg.decode()
    for name, value in zip(("width", "height"), paper_mm, strict=True):
        text = re.sub(rf'{name}="[\d.]+pt"', f'{name}="{value:.6g}mm"', text, count=1)
    return text.encode()
