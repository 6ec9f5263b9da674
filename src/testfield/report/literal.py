"""Figures whose labels are drawn as they are written: a name is no formula."""

from typing import Any

from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter


class LiteralFigure(Figure):
    """A figure in which dollar signs mean nothing, except in the powers of ten that matplotlib writes on log axes."""

    def draw(self, renderer: Any) -> None:
        """Draw the figure."""
        powers = set()
        for axes in self.axes:
            for axis in (axes.xaxis, axes.yaxis):
                formats = (axis.get_major_formatter(), axis.get_minor_formatter())
                if any(isinstance(form, LogFormatter) for form in formats):
                    powers |= {id(text) for text in axis.findobj(Text) if text is not axis.label}
        for text in self.findobj(Text):
            if id(text) not in powers:
                text.set_parse_math(False)
        super().draw(renderer)
