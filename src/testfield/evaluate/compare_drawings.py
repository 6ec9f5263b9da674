"""A comparison's figures for paper: SVG and PDF as wide as a column, drawn by matplotlib."""

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.evaluate.bias import camera_map, centre_map, length_curve
from testfield.evaluate.compare import Compared
from testfield.evaluate.compare_floor import Floor
from testfield.evaluate.compare_look import colours_of
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.curves import axis_of
from testfield.evaluate.metrics import CENTRE, CORNER, METRICS, POINTS, Metric
from testfield.evaluate.paired import Difference, Word
from testfield.report.style import ACCENT, FAINT, INK, WARM, figure, svg_of
from testfield.store.atomic import whole

COLUMN_IN = 85 / 25.4
"""A column of a journal is 85 mm wide, in inches."""
COLOURS = {
    Word.BETTER: ACCENT,
    Word.WORSE: WARM,
    Word.EQUIVALENT: INK,
    Word.OPEN: FAINT,
    Word.ONE: FAINT,
    Word.NOTHING: FAINT,
}
FONT_PT = 7
ARROW_PERCENTILE = 90


@dataclass(frozen=True)
class Drawing:
    """A figure: its file's `name` without suffix, the `group` of the page that it belongs to, `title`, `svg`, `pdf`."""

    name: str
    group: str
    title: str
    svg: bytes
    pdf: bytes


def drawings_of(compared: Compared, comparison: Comparison, floor: Floor, curves: pd.DataFrame) -> list[Drawing]:
    """All figures of a comparison; `curves` with the values of its factors."""
    recipes = [recipe.name for recipe in comparison.recipes]
    own = compared.rows[compared.rows.recipe.isin(recipes)]
    made = [
        *_differences(compared, recipes[0]),
        *_common_noise(compared, recipes),
        *_curves(curves, comparison, recipes, floor),
        *_recall(own, recipes),
        *_lengths(own, recipes),
        *_maps(own, recipes),
    ]
    return made


def inline(svg: bytes) -> str:
    """An SVG to stand in a page: without its head, and its paths to a hundredth of a point, which halves it."""
    text = svg[svg.index(b"<svg") :].decode()
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"\d+\.\d{3,}", _hundredth, path[0]), text)


def _hundredth(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def write_drawings(drawings: Sequence[Drawing], folder: Path) -> None:
    """Write each as SVG and PDF below `folder`."""
    for one in drawings:
        for suffix, content in (("svg", one.svg), ("pdf", one.pdf)):
            with whole(folder / "figures" / f"{one.name}.{suffix}") as path:
                path.write_bytes(content)


def finished(name: str, group: str, title: str, drawing: Any) -> Drawing:
    """A figure as it is kept, the same bytes for the same figure."""
    buffer = io.BytesIO()
    drawing.savefig(buffer, format="pdf", metadata={"CreationDate": None, "Creator": None, "Producer": None})
    return Drawing(name, group, title, svg_of(drawing), buffer.getvalue())


def small(drawing: Any) -> None:
    """Give a drawing text of a size that a column takes."""
    for axes in drawing.axes:
        axes.tick_params(which="both", labelsize=FONT_PT, width=0.6, length=2.5)
        axes.xaxis.label.set_size(FONT_PT + 0.5)
        axes.yaxis.label.set_size(FONT_PT + 0.5)
        axes.title.set_size(FONT_PT + 0.5)


def slug(text: str) -> str:
    """A text as part of a file's name."""
    words = "".join(letter if letter.isalnum() else " " for letter in text.lower()).split()
    return "_".join(words) or "figure"


def _differences(compared: Compared, first: str) -> Iterator[Drawing]:
    for metric in METRICS:
        own = {name: one for (name, key), one in compared.differences.items() if key == metric.key and one.draws}
        if own:
            with figure(COLUMN_IN, 0.62 + 0.2 * len(own)) as (drawing, axes):
                _forest(axes, own)
                axes.set_xlabel(f"difference from {first}, {metric.unit or 'targets'}")
                small(drawing)
                yield finished(f"difference_{slug(metric.title)}", "differences", metric.title, drawing)


def _common_noise(compared: Compared, recipes: Sequence[str]) -> Iterator[Drawing]:
    """How many times narrower common noise makes the interval of each figure's difference, and of a single centre's."""
    found = {
        (name, TITLES_OF_NOISE.get(key, "")): one.unpaired_u / one.estimate.u
        for (name, key), one in compared.differences.items()
        if one.estimate.freedom > 0 and one.estimate.u > 0 and key in TITLES_OF_NOISE
    }
    found |= {(row.recipe, "a centre"): row.narrower for row in compared.noise.itertuples() if row.items}
    found = {pair: times for pair, times in found.items() if np.isfinite(times)}
    if not found:
        return
    titles = list(dict.fromkeys(title for _, title in found))
    with figure(COLUMN_IN, 0.95 + 0.2 * (len(recipes) - 1)) as (drawing, axes):
        axes.axvline(1, color=INK, linewidth=0.6)
        for title, mark, colour in zip(titles, "osD^v", (ACCENT, WARM, INK, FAINT, INK), strict=False):
            own = [(times, recipes.index(name) - 1) for (name, other), times in found.items() if other == title]
            axes.plot(*zip(*own, strict=True), mark, color=colour, markersize=3.5, label=title, linestyle="none")
        axes.set_yticks(range(len(recipes) - 1), recipes[1:])
        axes.set_ylim(len(recipes) - 1.4, -0.6)
        axes.set_xlabel("times narrower by common noise")
        axes.set_xlim(left=0)
        above = {"loc": "lower left", "bbox_to_anchor": (0, 1), "ncols": 4, "columnspacing": 1.0}
        axes.legend(frameon=False, fontsize=FONT_PT - 0.5, handlelength=0.8, handletextpad=0.3, **above)
        small(drawing)
        yield finished("common_noise", "differences", "What common noise is worth", drawing)


TITLES_OF_NOISE = {CENTRE.key: "centres, rms", CORNER.key: "worst corner", POINTS.key: "check points"}
"""Figures whose intervals are held against those without common noise."""


def _forest(axes: Any, differences: dict[str, Difference]) -> None:
    """Differences with their intervals, and the band in which they do not matter."""
    matters = max(one.matters for one in differences.values())
    axes.axvspan(-matters, matters, color=FAINT, alpha=0.25, linewidth=0)
    axes.axvline(0, color=INK, linewidth=0.6)
    for k, one in enumerate(differences.values()):
        low, high = one.estimate.interval()
        if one.estimate.freedom > 0:
            axes.plot([low, high], [k, k], color=COLOURS[one.word], linewidth=1.8, solid_capstyle="butt")
        axes.plot(one.estimate.value, k, "o", color=COLOURS[one.word], markersize=3.5)
    axes.set_yticks(range(len(differences)), [f"{name}: {one.word.value}" for name, one in differences.items()])
    axes.set_ylim(len(differences) - 0.4, -0.6)
    axes.locator_params(axis="x", nbins=4)


def _curves(curves: pd.DataFrame, comparison: Comparison, recipes: Sequence[str], floor: Floor) -> Iterator[Drawing]:
    for factor in comparison.factors:
        for metric in METRICS:
            part = curves[(curves.factor == factor.name) & (curves.figure == metric.title)] if len(curves) else curves
            if not len(part) or not np.isfinite(part["mean"]).any():
                continue
            with figure(COLUMN_IN, 2.3) as (drawing, axes):
                for name, colour in colours_of(recipes).items():
                    own = part[part.recipe == name].sort_values("at")
                    axes.plot(own["at"], own["mean"], "o-", color=colour, linewidth=1.1, markersize=2.5, label=name)
                    good = np.isfinite(own.low) & np.isfinite(own.high)
                    axes.fill_between(own["at"][good], own.low[good], own.high[good], color=colour, alpha=0.18, lw=0)
                _floor_line(axes, metric, floor)
                at, words = axis_of(factor.values)
                if words is not None:
                    axes.set_xticks(at, words)
                axes.set_xlabel(factor.name)
                axes.set_ylabel(f"{metric.title}, {metric.unit}" if metric.unit else metric.title)
                _legend(axes)
                small(drawing)
                name = f"curve_{slug(factor.name)}_{slug(metric.title)}"
                yield finished(name, "curves", f"{metric.title} over {factor.name}", drawing)


def _floor_line(axes: Any, metric: Metric, floor: Floor) -> None:
    level = {"px": floor.px, "um": floor.um}.get(metric.unit) if metric.floor else None
    if level:
        axes.axhline(level, color=FAINT, linewidth=0.8, linestyle=":")


def _legend(axes: Any) -> None:
    axes.legend(frameon=False, fontsize=FONT_PT - 0.5, ncols=2, loc="best", handlelength=1.2, columnspacing=1.0)


def _recall(own: pd.DataFrame, recipes: Sequence[str]) -> Iterator[Drawing]:
    if CENTRE.key not in own or not pd.to_numeric(own[CENTRE.key], errors="coerce").notna().any():
        return
    with figure(COLUMN_IN, 2.3) as (drawing, axes):
        for name, colour in colours_of(recipes).items():
            rows = own[own.recipe == name]
            found = 100 * pd.to_numeric(rows["detection.found_fraction"], errors="coerce").groupby(rows.scene).mean()
            error = pd.to_numeric(rows[CENTRE.key], errors="coerce").groupby(rows.scene).mean()
            axes.plot(found, error, "o", color=colour, markersize=3.5, label=name)
        axes.set_yscale("log")
        axes.set_xlabel("found of those expected, %")
        axes.set_ylabel(f"{CENTRE.title}, px")
        _legend(axes)
        small(drawing)
        yield finished("accuracy_over_recall", "recall", "Accuracy over recall, a mark a scene", drawing)


def _lengths(own: pd.DataFrame, recipes: Sequence[str]) -> Iterator[Drawing]:
    tables = {name: length_curve(own[own.recipe == name]) for name in recipes}
    if not any(len(table) for table in tables.values()):
        return
    with figure(COLUMN_IN, 2.3) as (drawing, axes):
        for name, colour in colours_of(recipes).items():
            table = tables[name]
            axes.plot(table.length_mm, table.rms, "o-", color=colour, linewidth=1.1, markersize=2.5, label=name)
            axes.plot(table.length_mm, table["mean"], "--", color=colour, linewidth=0.8)
        axes.axhline(0, color=INK, linewidth=0.5)
        axes.set_xlabel("length, mm")
        axes.set_ylabel("length error, µm")
        _legend(axes)
        small(drawing)
        yield finished("length_error_over_length", "lengths", "Length error: rms, and broken the mean", drawing)


def _maps(own: pd.DataFrame, recipes: Sequence[str]) -> Iterator[Drawing]:
    """Mean error vectors over the image, of all recipes at one scale."""
    size = _size_of(own)
    for what, title, key in (("centre", "centres", centre_map), ("camera", "camera", camera_map)):
        rows = {name: own[own.recipe == name] for name in recipes}
        tables = {name: key(part, size) for name, part in rows.items()}
        lengths = [np.hypot(table.dx.astype(float), table.dy.astype(float)) for table in tables.values() if len(table)]
        if not lengths or not size[0]:
            continue
        unit = _rounded(float(np.percentile(np.concatenate(lengths), ARROW_PERCENTILE)))
        for name, table in tables.items():
            if len(table):
                with figure(COLUMN_IN, COLUMN_IN * size[1] / size[0] + 0.35) as (drawing, axes):
                    _arrows(axes, table, size, unit)
                    small(drawing)
                    yield finished(f"bias_{what}_{slug(name)}", "maps", f"{name}: bias of {title}", drawing)


def _arrows(axes: Any, table: pd.DataFrame, size: tuple[float, float], unit: float) -> None:
    arrows = axes.quiver(
        *(table[name].to_numpy(float) for name in ("x", "y", "dx", "dy")),
        angles="xy",
        scale_units="xy",
        scale=unit / (size[0] / 12),
        color=ACCENT,
        width=0.0035,
    )
    key = axes.quiverkey(arrows, 0.76, 1.05, unit, f"{unit:g} px", labelpos="E")
    key.text.set_size(FONT_PT)
    axes.set_xlim(0, size[0])
    axes.set_ylim(size[1], 0)
    axes.set_aspect("equal")
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")


def _size_of(own: pd.DataFrame) -> tuple[float, float]:
    """Width and height in px that no true centre exceeds, of the image where a camera was measured."""
    largest = [0.0, 0.0]
    for k, names in enumerate((("camera_x_px", "x_px"), ("camera_y_px", "y_px"))):
        for values in own.get(names[0], own.get(names[1], pd.Series(dtype=object))):
            if values is not None and not isinstance(values, float) and len(values):
                largest[k] = max(largest[k], float(np.max(values)))
    return largest[0], largest[1]


def _rounded(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)))
