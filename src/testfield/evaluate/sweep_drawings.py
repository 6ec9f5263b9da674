"""A sweep's figures for paper: SVG and PDF as wide as a column, drawn by matplotlib."""

from collections.abc import Iterator, Sequence

import pandas as pd

from testfield.evaluate.compare_drawings import COLUMN_IN, Drawing, finished, slug, small
from testfield.report.style import ACCENT, FAINT, figure

HEIGHT_IN = 2.1


def drawings_of(rows: pd.DataFrame, fields: Sequence[str], figures: Sequence[tuple[str, str]]) -> list[Drawing]:
    """Every figure, by title and key, against every field: each case a dot, a line through the means at each value."""
    return [one for title, key in figures for path in fields for one in _drawn(rows, path, title, key)]


def _drawn(rows: pd.DataFrame, path: str, title: str, key: str) -> Iterator[Drawing]:
    there = rows[rows[path].notna() & rows[key].notna()] if path in rows else rows.iloc[:0]
    if there.empty:
        return
    number = pd.api.types.is_numeric_dtype(there[path])
    values = there[path] if number else there[path].astype(str)
    means = there.groupby(values, sort=number)[key].mean()
    with figure(COLUMN_IN, HEIGHT_IN) as (drawing, axes):
        axes.plot(list(means.index), means.tolist(), color=FAINT, linewidth=0.8)
        axes.plot(values.tolist(), there[key].tolist(), "o", color=ACCENT, markersize=2.5, alpha=0.7)
        axes.set_xlabel(path)
        axes.set_ylabel(title)
        small(drawing)
        yield finished(f"{slug(title)}_over_{slug(path)}", path, title, drawing)
