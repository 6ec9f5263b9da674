"""The interactive plots of a comparison's page, by Bokeh: hover a value, hide a name, choose a figure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from testfield.evaluate.bias import length_curve
from testfield.evaluate.compare import Compared
from testfield.evaluate.compare_floor import Floor
from testfield.evaluate.compare_look import (
    FAINT_FILL,
    HEIGHT_PX,
    QUIET,
    colours_of,
    legend_outside,
    plot,
    tabs,
)
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.curves import axis_of
from testfield.evaluate.metrics import CENTRE, METRICS, Metric

POOLED = "all scenes"
SPREAD = 0.7
"""Of a row's height, the part over which recipes are set apart."""
HIGHEST_PX = 2400


@dataclass(frozen=True)
class Plots:
    """Makes the plots of one comparison."""

    compared: Compared
    comparison: Comparison
    floor: Floor
    tables: dict[str, pd.DataFrame]

    @property
    def recipes(self) -> list[str]:
        """Names, in order."""
        return [recipe.name for recipe in self.comparison.recipes]

    def all(self) -> dict[str, Any]:
        """Every plot by its place in the page; none where there is nothing to show."""
        made = {
            "differences": self._by_metric(self._differences),
            "curves": tabs([(m.title, tabs(self._curves(m))) for m in METRICS if self._curves(m)]),
            "recall": self._recall(),
            "lengths": self._lengths(),
        }
        return {name: one for name, one in made.items() if one is not None}

    def _by_metric(self, draw: Callable[[Metric], Any]) -> Any:
        return tabs([(metric.title, one) for metric in METRICS if (one := draw(metric)) is not None])

    def _differences(self, metric: Metric) -> Any:
        """Differences from the first recipe, with intervals: all scenes together, then each."""
        scenes = self._rows("scenes", metric)
        rows = [{"scene": POOLED} | row for row in self._rows("comparison", metric)]
        if len(self.comparison.scenes) == 1:
            rows = []  # the scene alone says the same
        rows = [row for row in [*rows, *scenes] if row["draws"]]
        if not rows:
            return None
        names = list(dict.fromkeys(row["scene"] for row in rows))
        others = self.recipes[1:]
        unit = metric.unit or "targets"
        height = min(130 + len(names) * max(34, 15 * len(others)), HIGHEST_PX)
        figure = plot(f"difference from {self.recipes[0]}, {unit}", "", height, y_range=names[::-1])
        matters = float(rows[0]["matters from"])
        _band(figure, -matters, matters)
        colours = colours_of(self.recipes)
        items = []
        for k, name in enumerate(others):
            off = SPREAD * ((len(others) - 1 - k + 0.5) / len(others) - 0.5)
            own = pd.DataFrame([row for row in rows if row["recipe"] == name])
            if own.empty:
                continue  # it came to no result anywhere
            own["place"] = [(scene, off) for scene in own.scene]
            finite = own[np.isfinite(own.low) & np.isfinite(own.high)]
            drawn = [
                figure.segment(
                    "low", "place", "high", "place", source=_source(finite), color=colours[name], line_width=3
                )
            ]
            points = figure.scatter("difference", "place", source=_source(own), color=colours[name], size=8)
            items.append((name, [*drawn, points]))
            _hover(
                figure,
                points,
                [
                    ("recipe", "@recipe"),
                    ("scene", "@scene"),
                    ("difference", "@difference{0.00000} " + unit),
                    ("95 %", "@low{0.00000} to @high{0.00000}"),
                    ("verdict", "@verdict"),
                    ("floor", "@floor"),
                    ("draws", "@draws"),
                ],
            )
        legend_outside(figure, items)
        return figure

    def _curves(self, metric: Metric) -> list[tuple[str, Any]]:
        """A curve a recipe over each factor's values, with its band."""
        table = self.tables["curves"]
        found = []
        for factor in self.comparison.factors:
            part = table[(table.factor == factor.name) & (table.figure == metric.title)] if len(table) else table
            if not len(part) or not np.isfinite(part["mean"]).any():
                continue
            figure = plot(factor.name, f"{metric.title}, {metric.unit or 'targets'}", HEIGHT_PX)
            at, words = axis_of(factor.values)
            if words is not None:
                figure.xaxis.ticker = at.tolist()
                figure.xaxis.major_label_overrides = {int(x): word for x, word in zip(at, words, strict=True)}
            self._floor_line(figure, metric)
            colours, items = colours_of(self.recipes), []
            for name in self.recipes:
                own = part[part.recipe == name].sort_values("at")
                banded = own[np.isfinite(own.low) & np.isfinite(own.high)]
                band = figure.varea("at", "low", "high", source=_source(banded), color=colours[name], alpha=0.18)
                line = figure.line("at", "mean", source=_source(own), color=colours[name], line_width=2)
                dots = figure.scatter("at", "mean", source=_source(own), color=colours[name], size=7)
                items.append((name, [band, line, dots]))
                _hover(
                    figure,
                    dots,
                    [
                        ("recipe", "@recipe"),
                        (factor.name, "@value"),
                        ("mean", "@mean{0.00000}"),
                        ("95 %", "@low{0.00000} to @high{0.00000}"),
                        ("from the first", "@difference{+0.00000}"),
                    ],
                )
            legend_outside(figure, items)
            found.append((factor.name, figure))
        return found

    def _recall(self) -> Any:
        """Centre error over the part of expected targets that was found, a mark for each recipe and scene."""
        rows = self.compared.rows
        own = rows[rows.recipe.isin(self.recipes)]
        if CENTRE.key not in own:
            return None
        numbers = own.assign(
            found=100 * pd.to_numeric(own["detection.found_fraction"], errors="coerce"),
            error=pd.to_numeric(own[CENTRE.key], errors="coerce"),
        )
        table = numbers.groupby(["recipe", "scene"], sort=False)[["found", "error"]].mean().reset_index().dropna()
        if not len(table):
            return None
        figure = plot("found of those expected, %", "centre error, rms, px", HEIGHT_PX, y_axis_type="log")
        self._floor_line(figure, CENTRE)
        colours, items = colours_of(self.recipes), []
        for name in self.recipes:
            dots = figure.scatter(
                "found", "error", source=_source(table[table.recipe == name]), color=colours[name], size=10, alpha=0.8
            )
            items.append((name, [dots]))
            _hover(
                figure,
                dots,
                [
                    ("recipe", "@recipe"),
                    ("scene", "@scene"),
                    ("found", "@found{0.00} %"),
                    ("rms", "@error{0.00000} px"),
                ],
            )
        legend_outside(figure, items)
        return figure

    def _lengths(self) -> Any:
        """Length error over length: root mean square, and the mean as a broken line."""
        rows, items = self.compared.rows, []
        figure = plot("length, mm", "length error, um", HEIGHT_PX)
        colours = colours_of(self.recipes)
        for name in self.recipes:
            table = length_curve(rows[rows.recipe == name]).assign(recipe=name)
            if not len(table):
                continue
            line = figure.line("length_mm", "rms", source=_source(table), color=colours[name], line_width=2)
            mean = figure.line("length_mm", "mean", source=_source(table), color=colours[name], line_dash="dashed")
            dots = figure.scatter("length_mm", "rms", source=_source(table), color=colours[name], size=7)
            items.append((name, [line, mean, dots]))
            _hover(
                figure,
                dots,
                [
                    ("recipe", "@recipe"),
                    ("length", "@length_mm{0} mm"),
                    ("rms", "@rms{0.00} um"),
                    ("mean", "@mean{+0.00} um"),
                    ("lengths", "@count"),
                ],
            )
        if not items:
            return None
        legend_outside(figure, items)
        return figure

    def _rows(self, table: str, metric: Metric) -> list[dict[str, Any]]:
        frame = self.tables[table]
        rows: list[dict[str, Any]] = frame[frame.figure == metric.title].to_dict("records") if len(frame) else []
        return rows

    def _floor_line(self, figure: Any, metric: Metric) -> None:
        from bokeh.models import Span

        floor = {"px": self.floor.px, "um": self.floor.um}.get(metric.unit) if metric.floor else None
        if floor:
            figure.add_layout(Span(location=floor, dimension="width", line_color=QUIET, line_dash="dotted"))


def _band(figure: Any, low: float, high: float) -> None:
    from bokeh.models import BoxAnnotation, Span

    figure.add_layout(BoxAnnotation(left=low, right=high, fill_color=FAINT_FILL, fill_alpha=0.25, line_color=None))
    figure.add_layout(Span(location=0, dimension="height", line_color=QUIET, line_width=1))


def _source(table: pd.DataFrame) -> Any:
    from bokeh.models import ColumnDataSource

    return ColumnDataSource({name: table[name].tolist() for name in table})


def _hover(figure: Any, renderer: Any, said: Sequence[tuple[str, str]]) -> None:
    from bokeh.models import HoverTool

    figure.add_tools(HoverTool(renderers=[renderer], tooltips=list(said), point_policy="follow_mouse"))
