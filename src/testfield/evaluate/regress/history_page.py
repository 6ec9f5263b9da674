"""The page of a history: each figure over the checks, with the commits at which another level begins."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.evaluate.compare_look import QUIET, legend_outside, plot, sortable
from testfield.evaluate.compare_page import embedded
from testfield.evaluate.regress.changes import change_points
from testfield.evaluate.regress.history import kept, suites_in
from testfield.evaluate.regress.verdict import FAILING, Verdict
from testfield.report.pages import page
from testfield.report.style import ACCENT, WARM
from testfield.store.atomic import whole
from testfield.store.text import write_text

HEIGHT_PX = 230
MOST_CHECKS = 2000
"""The latest checks that are drawn: a page must stay readable."""
SHORT = 10
"""Characters of a commit that a page shows."""


def write_history(database: Path, out: Path) -> Path:
    """Write the page of all suites in a database; returns its path. Raises `TestfieldError` as `history.kept`."""
    suites = suites_in(database)
    models: dict[str, Any] = {}
    shown: list[dict[str, Any]] = []
    for s, suite in enumerate(suites):
        rows = kept(database, suite)
        rows = rows[rows.number.isin(sorted(rows.number.unique())[-MOST_CHECKS:])]
        changes: list[dict[str, Any]] = []
        panels: list[tuple[int, str, str]] = []
        for name, own in rows.groupby(["scene", "recipe", "figure"], sort=False):
            own, place = own.reset_index(drop=True), f"s{s}f{len(panels)}"
            at = change_points(own.value.to_numpy(float))
            changes += [_change(name, own, *three) for three in zip([0, *at], at, [*at[1:], len(own)], strict=False)]
            panels.append((len(at), " / ".join(name), place))
            models[place] = _plot(own, at)
        panels.sort(key=lambda panel: -panel[0])
        table = pd.DataFrame(changes)
        if len(table):
            models[f"s{s}changes"] = sortable(table)
        shown.append(
            {
                "name": suite,
                "checks": int(rows.number.nunique()),
                "first": _when(rows.iloc[0]),
                "last": _when(rows.iloc[-1]),
                "machines": sorted(rows.processor.unique()),
                "changes": table.to_dict("records"),
                "table": f"s{s}changes",
                "panels": panels,
            }
        )
    plots, scripts = embedded(models)
    html = page("history.html", database=database.name, suites=shown, plots=plots, scripts=scripts)
    with whole(out) as part:
        write_text(part, html)
    return out


def _when(row: Any) -> str:
    return f"{str(row.made)[:10]}, {_commit(row.commit_id)}"


def _commit(commit: str) -> str:
    return (commit[:SHORT] + ("+" if commit.endswith("+") else "")) if commit else "no commit"


def _change(name: tuple[str, str, str], own: pd.DataFrame, last: int, k: int, following: int) -> dict[str, Any]:
    """A row of the table: figure, where another level begins (k), and the means on both sides, from the `last` change
    before and up to the `following` one."""
    values = own.value.to_numpy(float)
    before, after = float(np.nanmean(values[last:k])), float(np.nanmean(values[k:following]))
    row = own.iloc[k]
    return {
        "scene": name[0],
        "recipe": name[1],
        "figure": name[2],
        "since": _when(row),
        "before": before,
        "after": after,
        "change_%": 100 * (after / before - 1) if before else float("nan"),
        "verdict": row.verdict,
    }


def _plot(own: pd.DataFrame, changes: list[int]) -> Any:
    """A figure over checks: its values, the baseline it was held against, change points; failing checks stand out."""
    from bokeh.models import ColumnDataSource, HoverTool, Span

    failing = [verdict.value for verdict in FAILING]
    colour = [WARM if v in failing else QUIET if v == Verdict.UNKNOWN.value else ACCENT for v in own.verdict]
    source = ColumnDataSource(
        {
            "check": list(range(1, len(own) + 1)),
            "value": own.value.astype(float).tolist(),
            "base": own.base.astype(float).tolist(),
            "commit": [_commit(one) for one in own.commit_id],
            "made": own.made.tolist(),
            "verdict": own.verdict.tolist(),
            "processor": own.processor.tolist(),
            "colour": colour,
        }
    )
    made = plot("check", "", HEIGHT_PX)
    made.xaxis.ticker.min_interval = 1  # there is no check between the first and the second
    line = made.line("check", "value", source=source, color=ACCENT, line_width=1, line_alpha=0.6)
    dots = made.scatter("check", "value", source=source, color="colour", size=6)
    items = [("figure", [line, dots])]
    if own.base.notna().any():
        items.append(("baseline", [made.step("check", "base", source=source, color=QUIET, line_dash="dashed")]))
    for k in changes:
        made.add_layout(Span(location=k + 0.5, dimension="height", line_color=WARM, line_dash="dotted", line_width=2))
    told = [(name, f"@{name}") for name in ("commit", "made", "verdict", "processor")]
    made.add_tools(HoverTool(renderers=[dots], tooltips=[("value", "@value{0.000000}"), *told]))
    legend_outside(made, items)
    return made
