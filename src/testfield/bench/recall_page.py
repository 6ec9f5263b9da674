"""The recall of every kind of target as a figure and a page: a row a kind, a panel for what varies."""

import html
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from testfield.bench.recall_kinds import KINDS, SERIES, lines
from testfield.report.style import ACCENT, FAINT, INK, WARM, figure, svg_of
from testfield.store.stamp import stamp
from testfield.store.text import write_text

TITLES = {"size_px": "size, px", "tilt_deg": "obliquity, degrees", "snr": "contrast over noise", "blur_px": "blur, px"}
THEIRS = (WARM, "#b08a1e", "#8a5fb0")
"""Colours of public detectors, whose lines are broken."""
ROW_IN, WIDTH_IN = 1.75, 11.0
BASE = "Beside what varies: obliquity 20 degrees, contrast 30 times a pixel's noise, blur 0.8 px, the middle size."


def write_page(figures: dict[str, Any], folder: Path) -> Path:
    """Write `recall_kinds.json`, `.svg`, `.png` and `.html`, the page, whose path is returned."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "recall_kinds.json", json.dumps(stamp() | figures, indent=1))
    svg, png = draw(figures["rows"])
    (folder / "recall_kinds.svg").write_bytes(svg)
    (folder / "recall_kinds.png").write_bytes(png)
    behind = figures["behind"] or ["nowhere"]
    text = "\n".join(lines(figures["rows"]))
    page = folder / "recall_kinds.html"
    write_text(
        page,
        "<!doctype html><meta charset='utf-8'><title>Recall of every kind of target</title>"
        f"<body style='font:15px/1.5 sans-serif;color:{INK};max-width:1100px;margin:2em auto'>"
        "<h1>Recall of every kind of target</h1>"
        "<p>Found, of all targets drawn, beside public detectors on the same pictures. Wrong are numbers or places "
        f"that none has; false are finds in clutter without targets. {BASE}</p>"
        "<p><b>Behind a public detector with no more wrong and false finds:</b> "
        + html.escape("; ".join(behind))
        + ".</p>"
        + svg[svg.index(b"<svg") :].decode()
        + f"<h2>The figures</h2><pre style='font-size:12px'>{html.escape(text)}</pre>"
        "<p><code>testfield bench recall --kinds --out FOLDER</code></p>",
    )
    return page


def draw(rows: list[dict[str, Any]]) -> tuple[bytes, bytes]:
    """The figure as SVG and PNG: recall in percent over every factor, a row a kind that `rows` tell of."""
    kinds = [kind for kind in KINDS if any(row["kind"] == kind.name for row in rows)]
    with figure(WIDTH_IN, ROW_IN * len(kinds) + 0.5, len(SERIES), len(kinds), squeeze=False, sharey=True) as (
        drawing,
        axes,
    ):
        for line, kind in zip(axes, kinds, strict=True):
            mine = [row for row in rows if row["kind"] == kind.name]
            names = list(dict.fromkeys(row["detector"] for row in mine))
            for ax, factor in zip(line, SERIES, strict=True):
                _panel(ax, [row for row in mine if row["factor"] == factor], names)
                ax.set_xlabel(f"{kind.size}, px" if factor == "size_px" else TITLES[factor])
            line[0].set_ylabel("found, %")
            line[0].set_title(kind.name, loc="left", fontweight="bold", fontsize=9.5)
            for k, name in enumerate(names):
                own = [row for row in mine if row["detector"] == name]
                wrong, false = sum(row["wrong"] for row in own), own[0]["false"]
                said = f"{name}: {wrong} wrong of {sum(row['there'] for row in own)}, {false} false"
                column = line[min(k + 1, len(line) - 1)]
                column.set_title(said, loc="left", fontsize=6.2, color=_style(k)["color"])
        buffer = io.BytesIO()
        drawing.savefig(buffer, format="png", dpi=110)
        return svg_of(drawing), buffer.getvalue()


def _style(k: int) -> dict[str, Any]:
    """How the k-th detector is drawn: ours, the first, so thick that it is seen beneath the others."""
    if k == 0:
        return {"color": ACCENT, "lw": 3.0, "marker": "o", "ms": 4.5}
    return {"color": THEIRS[(k - 1) % len(THEIRS)], "lw": 1.4, "ls": (0, (4, 2)), "marker": "s^D"[k % 3], "ms": 3.4}


def _panel(ax: Any, rows: list[dict[str, Any]], names: list[str]) -> None:
    values = list(dict.fromkeys(row["value"] for row in rows))
    for k, name in enumerate(names):
        own = [row for row in rows if row["detector"] == name]
        share = [100 * row["found"] / max(row["there"], 1) for row in own]
        ax.plot([row["value"] for row in own], share, label=name, clip_on=False, **_style(k))
    if len(values) > 1 and values[0] > 0 and values[-1] / values[0] > 4:
        ax.set_xscale("log")
        ax.set_xticks(values, [f"{value:g}" for value in values])
        ax.minorticks_off()
    else:
        ax.set_xticks(values)
    ax.set_ylim(0, 100)
    ax.set_yticks(np.arange(0, 101, 50))
    ax.grid(color=FAINT, alpha=0.4, lw=0.6)
