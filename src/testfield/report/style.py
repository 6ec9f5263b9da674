"""One look for all figures."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

INK, ACCENT, WARM, FAINT = "#1d2b36", "#14699c", "#c4502a", "#9fb0bb"
LEAST_SHOWN = 0.2
"""How bright, between 0 and 1, the brightest tenth of a picture is shown at least."""


@contextmanager
def figure(
    width_in: float, height_in: float, columns: int = 1, rows: int = 1, **options: Any
) -> Iterator[tuple[Any, Any]]:
    """A figure with its axes (none where `columns` is 0), drawn without a display and without pyplot's global state."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from testfield.report.literal import LiteralFigure

    settings: Any = {
        "font.family": "DejaVu Sans",
        "font.size": 8.5,
        "axes.edgecolor": FAINT,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.linewidth": 0.8,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "svg.hashsalt": "testfield",
        "svg.fonttype": "path",
    }
    with rc_context(settings):
        drawing = LiteralFigure((width_in, height_in), layout="constrained")
        FigureCanvasAgg(drawing)
        yield drawing, drawing.subplots(rows, columns, **options) if columns else None


def svg_of(drawing: Any) -> bytes:
    """A figure as SVG, the same bytes for the same figure."""
    buffer = io.BytesIO()
    drawing.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def shown(values: np.ndarray) -> np.ndarray:
    """An image (h, w) as 0 to 1 for the eye: its brightest pixels but two in a thousand are white. A lamp among them
    would leave the rest black, so darks are lifted until most of the picture can be seen."""
    part = np.clip(values / max(float(np.percentile(values, 99.8)), 1e-12), 0, 1)
    bright = float(np.percentile(part, 90))
    gamma = 1 / 2.2
    if 0 < bright < LEAST_SHOWN ** (1 / gamma):
        gamma = max(np.log(LEAST_SHOWN) / np.log(bright), 0.1)
    return np.asarray(part**gamma)
