"""One look for all figures."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

INK, ACCENT, WARM, FAINT = "#1d2b36", "#14699c", "#c4502a", "#9fb0bb"


@contextmanager
def figure(
    width_in: float, height_in: float, columns: int = 1, rows: int = 1, **options: Any
) -> Iterator[tuple[Any, Any]]:
    """A figure with its axes (none where `columns` is 0), drawn without a display and without pyplot's global state."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from testfield.report.literal import LiteralFigure

    settings: Any = {
        "font.family": "DejaVu Sans", "font.size": 8.5, "axes.edgecolor": FAINT, "axes.labelcolor": INK,
        "text.color": INK, "xtick.color": INK, "ytick.color": INK, "axes.linewidth": 0.8,
        "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "testfield", "svg.fonttype": "path",
    }  # fmt: skip
    with rc_context(settings):
        drawing = LiteralFigure((width_in, height_in), layout="constrained")
        FigureCanvasAgg(drawing)
        yield drawing, drawing.subplots(rows, columns, **options) if columns else None


def svg_of(drawing: Any) -> bytes:
    """A figure as SVG, the same bytes for the same figure."""
    buffer = io.BytesIO()
    drawing.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()
