"""The page of a comparison, and what lies beside it."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from testfield.evaluate.compare import Compared
from testfield.evaluate.compare_floor import Floor
from testfield.evaluate.compare_tables import tables_of, write_tables
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.failures import Kind
from testfield.evaluate.metrics import METRICS
from testfield.evaluate.paired import Difference, Word
from testfield.report.pages import page
from testfield.report.style import ACCENT, FAINT, INK, WARM, figure, svg_of
from testfield.store.atomic import whole
from testfield.store.text import write_text

COLOURS = {Word.BETTER: ACCENT, Word.WORSE: WARM, Word.EQUIVALENT: INK, Word.OPEN: FAINT, Word.ONE: FAINT}


def write_comparison(
    compared: Compared, comparison: Comparison, floor: Floor, made: dict[str, str], folder: Path
) -> Path:
    """Write `report.html`, the tables of `compare_tables`, and a figure a metric as SVG; returns the page's path.
    `made` says where the figures come from."""
    tables = tables_of(compared, comparison, floor)
    write_tables(tables, compared.rows, folder)
    drawings = []
    first = comparison.recipes[0].name
    for metric in METRICS:
        own = {recipe: one for (recipe, key), one in compared.differences.items() if key == metric.key and one.draws}
        if own:
            svg = _drawn(own, f"{metric.title}: difference from {first}, {metric.unit or 'targets'}")
            with whole(folder / f"{metric.key.replace('.', '_')}.svg") as path:
                path.write_bytes(svg)
            drawings.append((metric.title, Markup(svg[svg.index(b"<svg") :].decode())))
    html = page(
        "compare.html",
        compared=compared,
        comparison=comparison,
        floor=floor,
        made=made,
        first=first,
        metrics=METRICS,
        kinds=[kind.value for kind in Kind],
        tables={name: records(table) for name, table in tables.items()},
        sanity=compared.sanity.to_dict("records"),
        drawings=drawings,
    )
    with whole(folder / "report.html") as path:
        write_text(path, html)
    return folder / "report.html"


def records(table: Any) -> list[dict[str, Any]]:
    """A table's rows for a template."""
    found: list[dict[str, Any]] = table.to_dict("records")
    return found


def _drawn(differences: dict[str, Difference], title: str) -> bytes:
    """Differences with their intervals, and the band in which they do not matter."""
    with figure(6.5, 0.8 + 0.35 * len(differences)) as (drawing, axes):
        matters = max(one.matters for one in differences.values())
        axes.axvspan(-matters, matters, color=FAINT, alpha=0.25, linewidth=0)
        axes.axvline(0, color=INK, linewidth=0.8)
        for k, one in enumerate(differences.values()):
            low, high = one.estimate.interval()
            colour = COLOURS[one.word]
            if one.estimate.freedom > 0:
                axes.plot([low, high], [k, k], color=colour, linewidth=2.2, solid_capstyle="butt")
            axes.plot(one.estimate.value, k, "o", color=colour, markersize=5)
        axes.set_yticks(range(len(differences)), [f"{name}: {one.word.value}" for name, one in differences.items()])
        axes.set_ylim(len(differences) - 0.4, -0.6)
        axes.set_xlabel(title)
        return svg_of(drawing)
