"""A study's page, its figures as SVG and their data as CSV."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from testfield.evaluate.failures import FAILURE
from testfield.report.pages import page
from testfield.report.style import figure, svg_of
from testfield.store.atomic import whole
from testfield.store.text import write_text
from testfield.study.finding import plain
from testfield.study.study import Extent, Plot, Results, Study, Table


def write_page(study: Study, results: Results, extent: Extent, folder: Path) -> None:
    """Write `report.html`, and of every plot `NAME.svg` and `NAME.csv`."""
    drawings = []
    for plot in results.plots:
        svg = drawn(plot)
        with whole(folder / f"{plot.name}.svg") as path:
            path.write_bytes(svg)
        with whole(folder / f"{plot.name}.csv") as path:
            plot.data.to_csv(path, index=False)
        drawings.append((plot, Markup(svg[svg.index(b"<svg") :].decode())))
    html = page(
        "study.html",
        study=study,
        verdict=study.verdict(results),
        findings=[(finding, finding.name in study.rests_on) for finding in results.findings],
        conclusion=study.concluded(results),
        plain=plain,
        drawings=drawings,
        extent=extent,
        first_failed=_labels(extent.failures[0]) if extent.failures else "",
        tables=[(table, Markup(as_html(table))) for table in results.tables],
    )
    with whole(folder / "report.html") as path:
        write_text(path, html)


def _labels(row: dict[str, Any]) -> str:
    """What names a case that failed."""
    return ", ".join(f"{name} {value}" for name, value in row.items() if name != FAILURE and value == value)


def drawn(plot: Plot) -> bytes:
    """A plot as SVG, the same bytes for the same data."""
    with figure(*plot.size_in, columns=plot.columns, rows=plot.rows) as (drawing, axes):
        plot.draw(axes, plot.data)
        return svg_of(drawing)


def as_html(table: Table) -> str:
    """A table as HTML, an empty cell where there is no value."""
    frame = table.frame.copy()
    for column, form in table.formats.items():
        frame[column] = [form.format(value) if value == value and value is not None else "–" for value in frame[column]]
    return frame.to_html(index=False, border=0, na_rep="–", float_format=lambda value: f"{value:.4g}")
