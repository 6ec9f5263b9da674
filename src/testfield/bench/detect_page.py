"""The centring benchmark as figures, a page and JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from testfield.bench.centring import BEST, KNOWN
from testfield.bench.detect import CHI2, FACTORS, LEAST_EFFICIENCY, MOST_BIAS, text
from testfield.bench.dots import Case
from testfield.report.style import ACCENT, FAINT, INK, figure, svg_of
from testfield.store.stamp import stamp
from testfield.store.text import read_text, write_text

LABELS = {
    "diameter": "diameter, px",
    "tilt": "tilt, degrees",
    "snr": "contrast over noise",
    "blur": "blur, px",
    "gradient": "change of light over a diameter",
    "phase": "phase on the pixels' grid in x and y, px",
    "coded": "diameter of the dot in a ring code, px",
}
TITLES = {
    "diameter": "Size",
    "tilt": "Tilt",
    "snr": "Noise",
    "blur": "Blur",
    "gradient": "Uneven light",
    "phase": "Place on the pixels' grid",
    "coded": "Ring codes",
    "corners": "Corners of the required range",
}
TEMPLATE = Path(__file__).parents[1] / "report/bench_detect.html"
LOGARITHMIC = ("diameter", "snr", "blur", "coded")
COLOURS = ("#1a7a4a", "#8a5fb0", "#b08a1e", "#d4719b", "#3aa6a0", "#7a5230", "#5c6f7c", "#6f9b1c", "#4b5fc4")
PEERS = ("#c4502a", "#e0903a", "#a03050", "#d98a7a")
"""Colours of this project's estimators, and of OpenCV's and scikit-image's, whose lines are broken."""
MARKERS = "osD^v<>Ph"
LEAST_FOR_BIAS = 6
"""From fewer exposures of the same dot nothing can be said of its bias."""
WORST_RATIO, WORST_CHI2 = 30.0, 30.0
"""Beyond these the axes end: what lies there is out of the question."""


def write_page(figures: dict[str, Any], folder: Path) -> Path:
    """Write `detect.json`, a figure for each factor as SVG, and `detect.html`; returns the page's path."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "detect.json", json.dumps(stamp() | figures, indent=1))
    drawings = {}
    for factor, rows in figures["series"].items():
        if factor in FACTORS and len(rows) > 1:
            svg = draw(factor, rows)
            (folder / f"detect_{factor}.svg").write_bytes(svg)
            drawings[factor] = Markup(svg[svg.index(b"<svg") :].decode())
    environment = Environment(undefined=StrictUndefined, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.globals.update(text=text, titles=TITLES, best=BEST, known=KNOWN)
    template = environment.from_string(read_text(TEMPLATE))
    page = folder / "detect.html"
    write_text(page, template.render(b=figures, base=Case(), drawings=drawings))
    return page


def styles(names: list[str]) -> dict[str, dict[str, Any]]:
    """How each estimator is drawn, in the order of drawing: the forward model last, over all others."""
    ours = [name for name in names if not _peer(name) and name not in (BEST, KNOWN)]
    peers = [name for name in names if _peer(name)]
    drawn = {n: {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % 9], "lw": 1.0} for k, n in enumerate(ours)}
    drawn |= {
        n: {"color": PEERS[k % len(PEERS)], "marker": MARKERS[k % 9], "lw": 1.0, "ls": (0, (4, 2))}
        for k, n in enumerate(peers)
    }
    drawn[KNOWN] = {"color": ACCENT, "marker": "o", "lw": 1.2, "ls": (0, (1, 1.5)), "mfc": "white"}
    drawn[BEST] = {"color": ACCENT, "marker": "o", "lw": 2.6}
    return {name: {"ms": 3.2, "label": name} | style for name, style in drawn.items() if name in names}


def _peer(name: str) -> bool:
    return name.startswith(("opencv_", "skimage_"))


def draw(factor: str, rows: list[dict[str, Any]]) -> bytes:
    """One factor as SVG: scatter in px and over the bound, bias, claimed covariance, and how many were not measured."""
    field = FACTORS[factor][0]
    values = [row["case"][field] for row in rows]
    x = np.arange(len(values), dtype=float) if factor == "phase" else np.array(values, float)
    drawn = styles(list(rows[0]["estimators"]))
    bound = np.array([row["bound_px"] for row in rows])
    free = np.array([row["bound_with_unknown_gradient_px"] for row in rows])
    with figure(11.0, 11.6, 0) as (drawing, _):
        curves, table = drawing.subfigures(2, 1, height_ratios=[2.5, 1])
        (scatter, ratio), (bias, claimed) = curves.subplots(2, 2)
        for name, style in drawn.items():
            runs = [row["estimators"].get(name, {}) for row in rows]
            _line(scatter, x, runs, "sigma_px", style)
            _line(ratio, x, runs, "sigma_px", style, 1 / bound)
            enough = [run if run.get("exposures", 0) >= LEAST_FOR_BIAS else {} for run in runs]
            _line(bias, x, enough, "bias_by_dot", style, faint=name != BEST)
            _line(claimed, x, runs, "chi2", style)
        for axis, scale in ((scatter, 1), (ratio, 1 / bound)):
            axis.plot(x, bound * scale, color=INK, ls="--", lw=1.4, label="Cramer-Rao bound", zorder=5)
            axis.plot(x, free * scale, color=INK, ls=":", lw=1.0, label="bound, gradient of light unknown", zorder=5)
        scatter.set(ylabel="px", yscale="log")
        _plain_ticks(scatter.yaxis, [m * 10.0**e for e in range(-5, 2) for m in (1, 2, 5)])
        ratio.axhspan(0.5, 1 / np.sqrt(LEAST_EFFICIENCY), color=FAINT, alpha=0.25, lw=0)
        ratio.set(ylabel="ratio", yscale="log", ylim=(0.85, min(WORST_RATIO, max(ratio.get_ylim()[1], 2))))
        _plain_ticks(ratio.yaxis, [1, 1.5, 2, 3, 5, 10, 20, 30])
        bias.axhspan(0, MOST_BIAS, color=FAINT, alpha=0.25, lw=0)
        bias.set(ylabel="in units of the same estimator's scatter")
        bias.set_yscale("symlog", linthresh=0.1, linscale=0.7)
        bias.set_ylim(-0.004, None)
        _plain_ticks(bias.yaxis, [0, 0.05, 0.1, 0.3, 1, 3, 10, 30, 100])
        claimed.axhspan(*CHI2, color=FAINT, alpha=0.25, lw=0)
        claimed.set(
            ylabel="per degree of freedom", yscale="log", ylim=(0.1, min(WORST_CHI2, max(claimed.get_ylim()[1], 3)))
        )
        _plain_ticks(claimed.yaxis, [0.1, 0.2, 0.5, 1, 2, 5, 10, 20])
        for axis, title in (
            (scatter, "Scatter"),
            (ratio, "Scatter over the bound (grey: efficiency of 0.9 and more)"),
            (bias, "Bias of the single dots, less chance (grey: the limit)"),
            (claimed, "Chi-squared by the claimed covariance (grey: the limits)"),
        ):
            axis.set_title(title, loc="left", fontsize=9.5, fontweight="bold")
            axis.grid(axis="y", color=FAINT, alpha=0.35, lw=0.5)
            _abscissa(axis, factor, x, values)
        _counts(table.subplots(), factor, rows, list(drawn)[::-1], values)
        handles, labels = scatter.get_legend_handles_labels()
        order = [*range(len(handles) - 3, -1, -1), len(handles) - 2, len(handles) - 1]
        curves.legend(
            [handles[k] for k in order],
            [labels[k] for k in order],
            loc="outside upper center",
            ncols=5,
            frameon=False,
            fontsize=8.5,
            handlelength=3,
        )
        return svg_of(drawing)


def _line(
    axis: Any,
    x: np.ndarray,
    runs: list[dict],
    key: str,
    style: dict[str, Any],
    scale: np.ndarray | float = 1.0,
    faint: bool = False,
) -> None:
    """A curve with its band of 95 %; what was not measured leaves a gap."""
    y = np.array([run.get(key, np.nan) for run in runs], float) * scale
    band = key.replace("_px", "_band_px") if key.endswith("_px") else f"{key}_band"
    low, high = np.array([run.get(band, (np.nan, np.nan)) for run in runs], float).T * scale
    axis.plot(x, y, **style)
    axis.fill_between(x, np.maximum(low, 1e-9), high, color=style["color"], alpha=0.03 if faint else 0.13, lw=0)


def _plain_ticks(axis: Any, at: list[float]) -> None:
    low, high = axis.get_view_interval()
    shown = [value for value in at if low <= value <= high]
    axis.set_ticks(shown, [f"{value:g}" for value in shown], minor=False)
    axis.set_ticks([], minor=True)


def _abscissa(axis: Any, factor: str, x: np.ndarray, values: list[Any]) -> None:
    axis.set_xlabel(LABELS[factor])
    if factor in LOGARITHMIC:
        axis.set_xscale("log")
    axis.set_xticks(x, [_value(value) for value in values], minor=False)
    axis.set_xticks([], minor=True)


def _value(value: Any) -> str:
    return f"{value[0]:g}, {value[1]:g}" if isinstance(value, (list, tuple)) else f"{value:g}"


def _counts(axis: Any, factor: str, rows: list[dict[str, Any]], names: list[str], values: list[Any]) -> None:
    """A table: how many of how many dots each estimator did not measure."""
    part = np.full((len(names), len(rows)), np.nan)
    for j, row in enumerate(rows):
        for i, name in enumerate(names):
            run = row["estimators"].get(name)
            if run is None:
                continue
            total = run["measured"] + run["not_measured"]
            part[i, j] = run["not_measured"] / total
            shown = "0" if not run["not_measured"] else f"{run['not_measured']} of {total}"
            colour = FAINT if shown == "0" else "white" if part[i, j] > 0.6 else INK
            axis.text(j, i, shown, ha="center", va="center", fontsize=7.5, color=colour)
    from matplotlib.colors import LinearSegmentedColormap

    shades = LinearSegmentedColormap.from_list("lost", ["#ffffff", "#f3d9cc", "#c4502a"])
    axis.imshow(part, cmap=shades, vmin=0, vmax=1, aspect="auto")
    axis.set_title("Not measured, of all dots on all exposures", loc="left", fontsize=9.5, fontweight="bold")
    axis.set_yticks(range(len(names)), names)
    axis.set_xticks(range(len(values)), [_value(value) for value in values])
    axis.set_xlabel(LABELS[factor])
    axis.tick_params(length=0)
    for side in axis.spines.values():
        side.set_visible(False)
