"""How a comparison's interactive plots and tables look: readable on light and on dark ground alike."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from testfield import report
from testfield.store.text import read_text

QUIET = "#7d8b95"
"""Text, axes and thin lines: 3.5 to 1 and more against white and against the dark ground of the page."""
FAINT_FILL = "#8fa1ad"
HEIGHT_PX = 380
ROW_PX = 26
MOST_ROWS_SHOWN = 16
STYLE = Path(report.__file__).parent / "compare_widgets.css"
"""What Bokeh's tabs and tables look like: they live in roots of their own, which the page's style does not reach."""
NUMBER_PX, TEXT_PX = 80, 110
WIDTHS_PX = {
    "figure": 290,
    "why": 420,
    "error": 210,
    "of": 160,
    "draws": 50,
    "draw": 50,
    "unpaired": 70,
    "floor": 90,
    "since": 200,
}
"""Widths of columns, by their heads where they are others than usual; a table stretches them to the page's width."""
NUMBER = """<%= value == null || value !== value ? "–" : !isFinite(value) ? (value < 0 ? "−∞" : "∞") :
Math.abs(value) >= 1e6 ? value.toExponential(2) : Number.isInteger(value) ? value : +value.toPrecision(4) %>"""
VERDICT = """<b style="color:<%= {better: '#2b8fc7', worse: '#d9653c'}[value] || 'inherit' %>"><%- value %></b>"""


def plot(x_title: str, y_title: str, height_px: int, **options: Any) -> Any:
    """An empty plot as wide as the page."""
    from bokeh.models import BasicTickFormatter, LinearAxis
    from bokeh.plotting import figure

    made = figure(
        height=height_px,
        sizing_mode="stretch_width",
        tools="pan,box_zoom,wheel_zoom,reset,save",
        background_fill_alpha=0,
        border_fill_alpha=0,
        outline_line_color=None,
        x_axis_label=x_title,
        **({"y_axis_label": y_title} if y_title else {}),
        **options,
    )
    made.toolbar.logo = None
    made.toolbar.autohide = True
    made.toolbar.active_scroll = None
    for axis in made.axis:
        axis.axis_label_text_color = axis.major_label_text_color = QUIET
        axis.axis_line_color = axis.major_tick_line_color = QUIET
        axis.minor_tick_line_color = None
        if isinstance(axis, LinearAxis):
            axis.formatter = BasicTickFormatter(use_scientific=False)
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = "12px"
    made.grid.grid_line_color = QUIET
    made.grid.grid_line_alpha = 0.25
    return made


def legend_outside(figure: Any, items: Sequence[tuple[str, list[Any]]]) -> None:
    """A legend beside a plot; a click on a name hides what belongs to it."""
    from bokeh.models import Legend, LegendItem

    legend = Legend(
        items=[LegendItem(label={"value": name}, renderers=renderers) for name, renderers in items],
        click_policy="hide",
        background_fill_alpha=0,
        border_line_color=None,
        inactive_fill_color=FAINT_FILL,
        inactive_fill_alpha=0.4,
        label_text_color=QUIET,
        label_text_font_size="12px",
    )
    figure.add_layout(legend, "right")


def tabs(panels: Sequence[tuple[str, Any]]) -> Any:
    """Panels of which one is seen at a time; a single one stands alone, none gives None."""
    from bokeh.models import InlineStyleSheet, TabPanel, Tabs

    if len(panels) < 2:
        return panels[0][1] if panels else None
    return Tabs(
        tabs=[TabPanel(title=title, child=child) for title, child in panels],
        sizing_mode="stretch_width",
        stylesheets=[InlineStyleSheet(css=read_text(STYLE))],
    )


def sortable(table: pd.DataFrame) -> Any:
    """A table that is sorted by a click on a column's head."""
    from bokeh.models import (
        ColumnDataSource,
        DataTable,
        HTMLTemplateFormatter,
        InlineStyleSheet,
        StringFormatter,
        TableColumn,
    )

    columns = []
    for name in table:
        number = pd.api.types.is_numeric_dtype(table[name])
        formatter = HTMLTemplateFormatter(template=VERDICT if name == "verdict" else NUMBER)
        if not number and name != "verdict":
            formatter = StringFormatter()
        width = WIDTHS_PX.get(str(name), NUMBER_PX if number else TEXT_PX)
        columns.append(TableColumn(field=name, title=name.replace("_", " "), formatter=formatter, width=width))
    values = {name: table[name].tolist() for name in table}
    return DataTable(
        source=ColumnDataSource(values),
        columns=columns,
        index_position=None,
        sizing_mode="stretch_width",
        height=ROW_PX * (min(len(table), MOST_ROWS_SHOWN) + 1) + 16,
        row_height=ROW_PX,
        selectable=True,
        reorderable=False,
        stylesheets=[InlineStyleSheet(css=read_text(STYLE))],
    )


def colours_of(recipes: Sequence[str]) -> dict[str, str]:
    """A colour for each recipe."""
    from bokeh.palettes import Category10_10, Category20_20

    palette = Category10_10 if len(recipes) <= 10 else Category20_20
    return {name: palette[k % len(palette)] for k, name in enumerate(recipes)}
