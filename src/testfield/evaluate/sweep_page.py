"""The page of a sweep: every figure that matters against every field that was varied."""

from pathlib import Path

import pandas as pd

from testfield.evaluate.compare_drawings import write_drawings
from testfield.evaluate.compare_look import FAINT_FILL, HEIGHT_PX, plot, tabs
from testfield.evaluate.failures import FAILURE
from testfield.evaluate.sweep import Sweep
from testfield.evaluate.sweep_drawings import drawings_of
from testfield.score.scorecard import TEN
from testfield.store.text import write_text

FIRST = "points.rmse_mm"
"""The figure that is shown first."""
DOT_PX = 8
DOT = "#2b8fc7"


def figures_of(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Title and key of the figures of a scorecard that the rows hold."""
    numbers = [(title, key) for title, key, _ in TEN if key in rows and pd.api.types.is_numeric_dtype(rows[key])]
    there = [(title, key) for title, key in numbers if rows[key].notna().any()]
    return sorted(there, key=lambda one: one[1] != FIRST)


def write_sweep(sweep: Sweep, rows: pd.DataFrame, folder: Path) -> Path:
    """Write `sweep.html`, with all of Bokeh in it, `sweep.csv`, and each figure as SVG and PDF in `figures`; returns
    the page's path."""
    from bokeh.embed import file_html
    from bokeh.layouts import column
    from bokeh.models import Div
    from bokeh.resources import INLINE

    kept = [*(name for name in rows.columns if name in _labels(sweep)), *(key for _, key in figures_of(rows))]
    kept += [FAILURE] if FAILURE in rows else []
    write_text(folder / "sweep.csv", rows[kept].to_csv(index=False))
    failed = int(rows[FAILURE].notna().sum()) if FAILURE in rows else 0
    count, how = sweep.size
    said = f"<h2>{sweep.name}: {count} cases</h2><p>{how}." + (f" {failed} failed.</p>" if failed else "</p>")
    said += "<p>Each dot is one case; the line joins the means at each value.</p>"
    shown = tabs(
        [
            (title, tabs([(path, _drawn(rows, path, list(sweep.fields), title, key)) for path in sweep.fields]))
            for title, key in figures_of(rows)
        ]
    )
    parts = [Div(text=said), *([shown] if shown is not None else [])]
    page = file_html(column(*parts, sizing_mode="stretch_width"), INLINE, title=f"sweep of {sweep.name}")
    write_text(folder / "sweep.html", page)
    write_drawings(drawings_of(rows, list(sweep.fields), figures_of(rows)), folder)
    return folder / "sweep.html"


def _labels(sweep: Sweep) -> tuple[str, ...]:
    return ("scene", "case", "draw", *sweep.fields)


def _drawn(rows: pd.DataFrame, path: str, fields: list[str], title: str, key: str) -> object:
    from bokeh.models import HoverTool

    there = rows[rows[path].notna() & rows[key].notna()] if path in rows else rows.iloc[:0]
    number = pd.api.types.is_numeric_dtype(there[path]) if len(there) else True
    values = there[path] if number else there[path].astype(str)
    options = {} if number else {"x_range": list(dict.fromkeys(values))}
    drawn = plot(path, title, HEIGHT_PX, **options)
    means = there.groupby(values, sort=number)[key].mean()
    drawn.line(list(means.index), means.tolist(), color=FAINT_FILL)
    dots = drawn.scatter(
        "x",
        "y",
        size=DOT_PX,
        color=DOT,
        alpha=0.7,
        source={"x": values.tolist(), "y": there[key].tolist(), "case": there["case"].tolist()}
        | {f"field{k}": there[name].astype(str).tolist() for k, name in enumerate(fields) if name in there},
    )
    said = [(name, f"@field{k}") for k, name in enumerate(fields) if name in there]
    drawn.add_tools(HoverTool(renderers=[dots], tooltips=[("case", "@case"), *said, (title, "@y")]))
    return drawn
