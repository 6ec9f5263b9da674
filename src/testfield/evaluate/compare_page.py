"""The page of a comparison, and what lies beside it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from testfield.evaluate.compare import Compared
from testfield.evaluate.compare_drawings import Drawing, drawings_of, inline, write_drawings
from testfield.evaluate.compare_floor import Floor
from testfield.evaluate.compare_look import colours_of, sortable
from testfield.evaluate.compare_plots import Plots
from testfield.evaluate.compare_tables import shown, tables_of, write_tables
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.known_rows import BOARDS, SCALE
from testfield.evaluate.metrics import CENTRE, CORNER, POINTS
from testfield.evaluate.worst import Crop
from testfield.evaluate.worst_drawings import crop_drawings
from testfield.report.pages import page
from testfield.store.atomic import whole
from testfield.store.text import write_text

GROUPS = ("crops", "differences", "recall", "lengths", "maps", "curves")
"""Groups of drawings, by how much a page would miss them."""
DRAWN_BYTES = 1_700_000
"""Drawings beyond these stay beside the page, so that it can be sent by mail."""

KNOWN_SHOWN = (
    (CENTRE.key, "%.6f px"),
    (CORNER.key, "%.6f px"),
    (BOARDS, "%.6f mm"),
    (SCALE, "%.4f ppm"),
    (POINTS.key, "%.6f mm"),
)
"""Figures of the rows whose figures are known, and how they are written."""


def write_comparison(
    compared: Compared,
    comparison: Comparison,
    floor: Floor,
    made: dict[str, str],
    folder: Path,
    crops: Sequence[Crop] = (),
) -> Path:
    """Write `report.html`, the tables of `compare_tables` and the figures of `compare_drawings`; returns the page's
    path. `made` says where the figures come from, `crops` show the worst cases."""
    tables = tables_of(compared, comparison, floor)
    write_tables(tables, compared.rows, folder)
    names = [recipe.name for recipe in comparison.recipes]
    drawings = drawings_of(compared, comparison, floor, tables["curves"]) + crop_drawings(crops, colours_of(names))
    write_drawings(drawings, folder)
    seen = shown(tables)
    if len(comparison.scenes) == 1:
        del seen["scenes"]  # it would say the same again
    plots, scripts = embedded(
        Plots(compared, comparison, floor, tables).all() | {name: sortable(t) for name, t in seen.items() if len(t)}
    )
    html = page(
        "compare.html",
        compared=compared,
        comparison=comparison,
        floor=floor,
        made=made,
        first=names[0],
        shown={name: table.to_dict("records") for name, table in seen.items()},
        partial=_partial(compared),
        sanity=compared.sanity.to_dict("records"),
        known=KNOWN_SHOWN,
        plots=plots,
        scripts=scripts,
        drawings=_inline(drawings),
        colours=colours_of(names),
    )
    with whole(folder / "report.html") as path:
        write_text(path, html)
    return folder / "report.html"


def _partial(compared: Compared) -> list[tuple[str, int, int]]:
    """Figures whose ranks are over fewer draws than there are figures of: title, draws, of how many."""
    ranks = compared.ranks.drop_duplicates("figure") if len(compared.ranks) else compared.ranks
    return [(row.figure, row.draws, row.of_draws) for row in ranks.itertuples() if row.draws < row.of_draws]


def embedded(models: dict[str, Any]) -> tuple[dict[str, Markup], Markup]:
    """What the page holds in the place of each plot, and the scripts that make them live: all of Bokeh is in the page,
    so it needs no network."""
    from bokeh.embed import components
    from bokeh.resources import Resources

    if not models:
        return {}, Markup()
    script, places = components(models)
    library = Resources(mode="inline", components=["bokeh", "bokeh-widgets", "bokeh-tables"]).render_js()
    return {name: Markup(place) for name, place in places.items()}, Markup(f"{library}\n{script}")


def _inline(drawings: list[Drawing]) -> dict[str, list[tuple[str, Markup]]]:
    """Drawings by group, with their titles, as many as a page takes."""
    found: dict[str, list[tuple[str, Markup]]] = {group: [] for group in GROUPS}
    left = DRAWN_BYTES
    for one in sorted(drawings, key=lambda one: GROUPS.index(one.group)):
        text = inline(one.svg)
        left -= len(text)
        if left > 0:
            found[one.group].append((one.title, Markup(text)))
    return found
