"""Figures whose labels are drawn as they are written, and that are the same bytes each time."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter

DIGITS = 6
"""Of positions, as parts of the figure."""


class LiteralFigure(Figure):
    """A figure in which dollar signs mean nothing, except in the powers of ten that matplotlib writes on log axes."""

    def draw(self, renderer: Any) -> None:
        """Draw the figure."""
        self._take_literally()  # before anything measures a label
        self._lay_out()
        self._take_literally()  # labels of ticks that the layout has made, too
        super().draw(renderer)

    def _take_literally(self) -> None:
        powers = set()
        for axes in self.axes:
            for axis in (axes.xaxis, axes.yaxis):
                formats = (axis.get_major_formatter(), axis.get_minor_formatter())
                if any(isinstance(form, LogFormatter) for form in formats):
                    powers |= {id(text) for text in axis.findobj(Text) if text is not axis.label}
        for text in self.findobj(Text):
            if id(text) not in powers:
                text.set_parse_math(False)

    def _lay_out(self) -> None:
        """Settle where axes lie: the solver of constraints orders them by address, so its last digits change."""
        engine = self.get_layout_engine()
        if engine is None or isinstance(engine, PlaceHolderLayoutEngine):
            return
        engine.execute(self)
        self.set_layout_engine("none")
        for part in self.subfigs:
            part.bbox_relative.set_points(np.round(part.bbox_relative.get_points(), DIGITS))
        for axes in self.axes:
            axes.set_position(np.round(axes.get_position(original=True).bounds, DIGITS).tolist(), which="original")
