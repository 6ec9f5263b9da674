"""The page of `testfield accept`: what standards would ask of a run."""

from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.colors import LinearSegmentedColormap

from testfield.report.pages import page
from testfield.report.plan import ELEVATION, PLAN, draw_field
from testfield.report.style import ACCENT, FAINT, WARM, figure, svg_of
from testfield.scene.world import World
from testfield.score.length_test import Limit, MeasuredLengths, slope, smallest_a

MOST_ROWS = 60
MOST_DRAWN = 100
"""Of more lengths than this the plan shows those of the largest errors."""


def sentence(card: dict[str, Any]) -> str:
    """The verdict in words, and where the test was not the one that the standard asks for."""
    found, verdict = card["lengths"], card["verdict"]
    largest = f"largest of {found['lengths']} errors {found['max_abs_dl_mm']:.4f} mm"
    if verdict is None:
        envelope = found["envelope"]
        return (
            f"No limit was given, so there is no verdict; {largest}. All lengths are within "
            f"{envelope['a_mm']:.4f} mm + {envelope['k_ppm']:.2f} ppm L."
        )
    most = "" if verdict["b_mm"] is None else f", at most {verdict['b_mm']:g} mm"
    limit = f"E = {verdict['a_mm']:g} mm + {verdict['k_ppm']:g} ppm L{most}"
    shown = {
        "shown": "This holds with the test's own expanded uncertainty (k = 2, of the calibrated lengths) counted in.",
        "refuted": "The test's own expanded uncertainty (k = 2, of the calibrated lengths) does not explain it.",
        "open": "With the test's own expanded uncertainty (k = 2, of the calibrated lengths) or what is missing "
        "counted in, it is open.",
    }[verdict["with_test_uncertainty"]]
    worst = f"targets {verdict['worst_codes'][0]} and {verdict['worst_codes'][1]}"
    size = f"{verdict['worst_dl_mm']:+.4f} mm where {verdict['worst_limit_mm']:.4f} mm are allowed"
    if verdict["verdict"] == "failed":
        said = f"Failed: {verdict['outside']} of {verdict['of']} errors exceed {limit}; worst {size} ({worst})."
    elif verdict["verdict"] == "incomplete":
        said = (
            f"Incomplete: {verdict['missing']} of the lengths were not measured; the other {verdict['of']} are within "
            f"{limit}."
        )
    else:
        said = f"Passed: all {verdict['of']} errors are within {limit}; nearest to it {size} ({worst})."
    return " ".join([said, shown, *_arrangement(card["arrangement"])])


def _arrangement(rows: list[dict[str, Any]] | None) -> list[str]:
    """What the arrangement of the measuring lines leaves to be said."""
    if rows is None:
        return ["The run has no measuring lines, so this is not the test of part 1."]
    lacking = "; ".join(f"{row['what']} ({row['found']}, asked: {row['asked']})" for row in rows if not row["met"])
    return [f"The recommended arrangement is not met in: {lacking}."] if lacking else []


def accept_page(
    world: World, card: dict[str, Any], lengths: MeasuredLengths, limit: Limit | None, warnings: list[str]
) -> str:
    """The page as text."""
    rows = card["rows"]
    if len(rows) > MOST_ROWS:
        rows = sorted(rows, key=lambda row: -abs(row["dl_mm"]))[:MOST_ROWS]
    return page(
        "accept.html",
        card=card,
        rows=rows,
        sentence=sentence(card),
        warnings=warnings,
        errors=errors_over_length(lengths, limit),
        envelope=envelopes(lengths, card["lengths"]["envelope"]),
        plan=plan_of_lengths(world, lengths),
    )


def errors_over_length(lengths: MeasuredLengths, limit: Limit | None) -> Markup:
    """Errors with their expanded uncertainties over length, the limit, the slope and its band."""
    with figure(6.1, 3.9) as (drawing, axes):
        length, um = lengths.calibrated_mm, 1000.0
        axes.axhline(0, color=FAINT, lw=0.8)
        axes.errorbar(
            length,
            um * lengths.dl_mm,
            um * 2 * lengths.u_dl_mm,
            fmt="o",
            ms=3.2,
            color=ACCENT,
            lw=0.8,
            mew=0,
            alpha=1.0 if len(lengths) <= MOST_DRAWN else 0.35,
        )
        reach = np.linspace(0, 1.04 * length.max(), 200)
        if limit is not None:
            for side in (1, -1):
                axes.plot(reach, side * um * limit.of(reach), color=WARM, lw=1.4)
        if line := slope(lengths):
            middle = length.mean()
            at_middle = line["offset_mm"] + 1e-6 * line["slope_ppm"] * middle
            axes.plot(reach, um * (at_middle + 1e-6 * line["slope_ppm"] * (reach - middle)), color=ACCENT, lw=1)
            ends = [at_middle + 1e-6 * line[key] * (reach - middle) for key in ("ci_low_ppm", "ci_high_ppm")]
            axes.fill_between(reach, um * ends[0], um * ends[1], color=ACCENT, alpha=0.12, lw=0)
        axes.set_xlim(0, reach[-1])
        axes.set_xlabel("calibrated length L, mm")
        axes.set_ylabel("length measurement error Δl, µm")
        return _inline(drawing)


def envelopes(lengths: MeasuredLengths, smallest: dict[str, float]) -> Markup:
    """The smallest A over K."""
    with figure(6.1, 3.9) as (drawing, axes):
        k = np.linspace(0, max(smallest["k_without_a_ppm"], 1e-9), 300)
        axes.plot(k, 1000 * smallest_a(lengths, k), color=ACCENT, lw=1.4)
        axes.fill_between(k, 1000 * smallest_a(lengths, k), 1000 * smallest["a_without_k_mm"], color=ACCENT, alpha=0.08)
        axes.scatter([smallest["k_ppm"]], [1000 * smallest["a_mm"]], color=WARM, s=24, zorder=5, clip_on=False)
        axes.set_xlim(0, k[-1])
        axes.set_ylim(0, 1050 * max(smallest["a_without_k_mm"], 1e-9))
        axes.set_xlabel("K, ppm")
        axes.set_ylabel("smallest A, µm")
        return _inline(drawing)


def plan_of_lengths(world: World, lengths: MeasuredLengths) -> Markup:
    """Elevation and plan with the test lengths, coloured by the size of their errors."""
    place = {int(code): xyz for code, xyz in zip(world.marks.code, world.mark_world_mm, strict=True) if code > 0}
    size = np.abs(lengths.dl_mm) / max(float(np.abs(lengths.dl_mm).max()), 1e-12)
    drawn = np.argsort(size)[-MOST_DRAWN:]
    tint = LinearSegmentedColormap.from_list("size", [FAINT, ACCENT, WARM])
    with figure(11.6, 4.6, columns=2) as (drawing, both):
        for axes, plane, title in zip(both, (ELEVATION, PLAN), ("elevation", "plan"), strict=True):
            draw_field(axes, world, plane, stations=False)
            for k in drawn:
                ends = np.array([place[int(code)] for code in lengths.codes[k]])[:, plane] / 1000
                axes.plot(*ends.T, color=tint(size[k]), lw=0.8 + 1.6 * size[k], zorder=4)
            low, high = (f(world.mark_world_mm[:, plane] / 1000, axis=0) for f in (np.min, np.max))
            axes.set_xlim(low[0] - 0.3, high[0] + 0.3)
            axes.set_ylim(low[1] - 0.3, high[1] + 0.3)
            axes.set_title(title, loc="left")
        return _inline(drawing)


def _inline(drawing: Any) -> Markup:
    svg = svg_of(drawing)
    return Markup(svg[svg.index(b"<svg") :].decode())
