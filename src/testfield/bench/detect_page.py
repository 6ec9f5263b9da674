"""The centring benchmark as figures, a page and JSON."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from testfield.bench.centring import BEST
from testfield.bench.detect import FACTORS, MOST_BIAS
from testfield.bench.dots import Case
from testfield.report.style import ACCENT, FAINT, INK, figure

LABELS = {
    "diameter": "diameter, px", "tilt": "tilt, degrees", "snr": "contrast over noise", "blur": "blur, px",
    "gradient": "change of light over a diameter", "phase": "phase in x, px (the last: in x and y)",
}  # fmt: skip
LOGARITHMIC = ("diameter", "snr", "blur")
COLOURS = (
    "#c4502a", "#1a7a4a", "#8a5fb0", "#b08a1e", "#d4719b", "#3aa6a0",
    "#7a5230", "#5c6f7c", "#9bb53c", "#e0903a", "#4b5fc4", "#a03050",
)  # fmt: skip


def write_page(figures: dict[str, Any], folder: Path) -> Path:
    """Write `detect.json`, a figure for each factor as SVG, and `detect.html`; returns the page's path."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "detect.json").write_text(json.dumps(figures, indent=1))
    drawings = {}
    for factor, rows in figures["series"].items():
        if factor in FACTORS and len(rows) > 1:
            svg = draw(factor, rows)
            (folder / f"detect_{factor}.svg").write_bytes(svg)
            drawings[factor] = Markup(svg[svg.index(b"<svg") :].decode())
    environment = Environment(undefined=StrictUndefined, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(Path(__file__).with_name("detect.html").read_text())
    page = folder / "detect.html"
    page.write_text(template.render(b=figures, base=Case(), best=BEST, drawings=drawings))
    return page


def draw(factor: str, rows: list[dict[str, Any]]) -> bytes:
    """One factor: scatter against the bound, bias, claimed covariance, and how many were not measured."""
    field = FACTORS[factor][0]
    values = [row["case"][field] for row in rows]
    x = np.arange(len(values)) / 8 if factor == "phase" else np.array(values, float)
    names = list(rows[0]["estimators"])
    others = [name for name in names if name != BEST]
    colour = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(others)} | {BEST: ACCENT}
    with figure(10.5, 7.6, 2, 2) as (drawing, axes):
        scatter, bias, claimed, lost = axes.ravel()
        for name in [*others, BEST]:
            runs = [row["estimators"].get(name, {}) for row in rows]
            style = {"color": colour[name], "lw": 2.4 if name == BEST else 1.0, "label": name}
            _line(scatter, x, runs, "sigma_px", "sigma_band_px", style)
            _line(bias, x, runs, "bias", None, style)
            _line(claimed, x, runs, "chi2", "chi2_band", style)
            total = [run.get("measured", 0) + run.get("not_measured", 0) for run in runs]
            part = [run.get("not_measured", 0) / max(t, 1) for run, t in zip(runs, total, strict=True)]
            lost.plot(x, part, marker=".", ms=4, **style)
        scatter.plot(x, [row["bound_px"] for row in rows], color=INK, ls="--", lw=1.4, label="Cramer-Rao bound")
        free = [row["bound_with_unknown_gradient_px"] for row in rows]
        scatter.plot(x, free, color=INK, ls=":", lw=1.0, label="the same, gradient unknown")
        scatter.set(ylabel="scatter, px", yscale="log")
        bias.axhline(MOST_BIAS, color=FAINT, lw=0.8)
        bias.set(ylabel="bias, in sigma", yscale="log", ylim=(0.005, None))
        claimed.axhspan(0.9, 1.1, color=FAINT, alpha=0.3, lw=0)
        claimed.set(ylabel="chi-squared of the claim, per degree of freedom", yscale="log")
        lost.set(ylabel="not measured, part", ylim=(-0.03, 1.03))
        for axis in axes.ravel():
            axis.set_xlabel(LABELS[factor])
            if factor in LOGARITHMIC:
                axis.set_xscale("log")
                axis.set_xticks(x, [f"{value:g}" for value in x], minor=False)
                axis.minorticks_off()
        handles, labels = scatter.get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=7.5)
        buffer = io.BytesIO()
        drawing.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _line(axis: Any, x: np.ndarray, runs: list[dict], key: str, band: str | None, style: dict[str, Any]) -> None:
    y = np.array([run.get(key, np.nan) for run in runs], float)
    if not np.isfinite(y).any():
        axis.plot([], [], **style)
        return
    axis.plot(x, y, marker=".", ms=4, **style)
    if band:
        low, high = np.array([run.get(band, (np.nan, np.nan)) for run in runs], float).T
        axis.fill_between(x, np.maximum(low, 1e-9), high, color=style["color"], alpha=0.18, lw=0)
