"""The page of a comparison, and its tables for papers and pull requests."""

from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from testfield.evaluate.compare import METRICS, STATED, Compared
from testfield.evaluate.execute import FAILURE
from testfield.evaluate.paired import Difference, Word
from testfield.report.pages import page
from testfield.report.style import ACCENT, FAINT, INK, WARM, figure, svg_of
from testfield.store.atomic import whole
from testfield.store.text import write_text

COLOURS = {Word.BETTER: ACCENT, Word.WORSE: WARM, Word.EQUIVALENT: INK, Word.OPEN: FAINT, Word.ONE: FAINT}
LISTS = ["station", "mark", "dx_px", "dy_px"]


def write_comparison(compared: Compared, about: dict[str, Any], folder: Path) -> Path:
    """Write `report.html`, `comparison.csv`, `comparison.md`, `comparison.tex`, `cases.csv`, and a figure a metric as
    SVG; returns the page's path. `about` says what was compared: first, scenes, recipes, draws, command, floor."""
    table = differences_table(compared)
    numbers = compared.rows.drop(columns=LISTS, errors="ignore")
    texts = {
        "comparison.csv": table.to_csv(index=False),
        "comparison.md": _markdown(table),
        "comparison.tex": table.to_latex(index=False, float_format="%.4g", escape=True),
        "cases.csv": numbers.to_csv(index=False),
    }
    for name, text in texts.items():
        with whole(folder / name) as path:
            write_text(path, text)
    with whole(folder / "comparison.parquet") as path:
        table.to_parquet(path, index=False)
    drawings = []
    for metric in METRICS:
        own = {recipe: one for (recipe, key), one in compared.differences.items() if key == metric.key and one.draws}
        if own:
            svg = _drawn(own, f"{metric.title}: difference from {about['first']}, {metric.unit or 'targets'}")
            with whole(folder / f"{metric.key.replace('.', '_')}.svg") as path:
                path.write_bytes(svg)
            drawings.append((metric.title, Markup(svg[svg.index(b"<svg") :].decode())))
    failures = compared.rows[compared.rows[FAILURE].notna()] if FAILURE in compared.rows else compared.rows[:0]
    html = page(
        "compare.html",
        compared=compared,
        about=about,
        metrics=METRICS,
        stated=STATED,
        summary=compared.summary.to_dict("records"),
        differences=table.to_dict("records"),
        sanity=compared.sanity.to_dict("records"),
        failures=failures[["scene", "draw", "recipe", FAILURE]].to_dict("records") if len(failures) else [],
        drawings=drawings,
    )
    with whole(folder / "report.html") as path:
        write_text(path, html)
    return folder / "report.html"


def differences_table(compared: Compared) -> pd.DataFrame:
    """Every difference in a row: figure, recipe, both means, difference with its interval, what is said, and how much
    narrower common noise makes it."""
    title = {metric.key: (metric.title, metric.unit) for metric in METRICS}
    rows = []
    for (recipe, key), one in compared.differences.items():
        low, high = one.estimate.interval()
        rows.append(
            {
                "figure": title[key][0],
                "unit": title[key][1],
                "recipe": recipe,
                "first": one.first,
                "this": one.other,
                "difference": one.estimate.value,
                "low": low,
                "high": high,
                "matters from": one.matters,
                "p (Holm)": one.chance,
                "p equivalent": one.chance_equivalent,
                "verdict": one.word.value,
                "draws": one.draws,
                "scenes": one.scenes,
                "unpaired over paired": one.unpaired_u / one.estimate.u if one.estimate.u > 0 else float("nan"),
            }
        )
    return pd.DataFrame(rows)


def _markdown(table: pd.DataFrame) -> str:
    """A table for a pull request or a notebook."""
    rows = [table.columns, ["---"] * len(table.columns), *table.map(_short).itertuples(index=False)]
    return "".join(f"| {' | '.join(str(value) for value in row)} |\n" for row in rows)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


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
