"""Figures of the study `wls`."""

from typing import Any

import pandas as pd

from testfield.report.style import ACCENT, FAINT, INK, WARM

LOOKS = {
    "midpoint": (WARM, "o"),
    "dlt": ("#d99a2b", "s"),
    "dlt_p34": ("#8a6d3b", "^"),
    "parametric_wls": (ACCENT, "o"),
    "ml": ("#3aa57a", "v"),
    "gls": (INK, "D"),
    "bundle": ("#8450a8", "P"),
    "opencv": (FAINT, "x"),
    "colmap": ("#777777", "+"),
}
CLAIMS = {
    "pixels alone (ml)": (WARM, "o"),
    "block-diagonal (parametric_wls)": ("#d99a2b", "s"),
    "sandwich (parametric_wls)": (ACCENT, "o"),
    "sandwich (gls)": (INK, "D"),
    "sandwich (bundle)": ("#8450a8", "P"),
}
SHOWN_AS_GAIN = ("dlt_p34", "parametric_wls", "ml", "gls", "bundle")


def draw_rmse(axes: Any, data: pd.DataFrame) -> None:
    """Errors of every method over the number of cameras, calibrations below each other, ranges side by side."""
    for place, part in _panels(axes, data, "calibration", "ranges"):
        for method, rows in part.groupby("method", sort=False):
            colour, mark = LOOKS[method]
            _points(place, rows, "rmse_um", "rmse_low_um", "rmse_high_um", colour, mark, method)
            place.plot(rows["cameras"], rows["predicted_um"], color=colour, lw=0.8, ls="--")
        _logarithmic(place)
        place.set_ylabel("RMSE a coordinate (µm)")
    _finish(axes, data)


def draw_gain(axes: Any, data: pd.DataFrame) -> None:
    """Gain over the midpoint, observed and predicted, calibrations below each other, noises side by side."""
    for place, part in _panels(axes, data, "calibration", "noise"):
        for method, rows in part.groupby("method", sort=False):
            colour, mark = LOOKS[method]
            _points(place, rows, "gain", "gain_low", "gain_high", colour, mark, method)
            place.plot(rows["cameras"], rows["gain_predicted"], color=colour, lw=0.8, ls="--")
        law = part.groupby("cameras")["law"].first().dropna()
        if len(law):
            place.plot(law.index, law, color=FAINT, lw=3, marker="s", ms=4, zorder=0, label="law of many cameras")
        place.axhline(1, color=FAINT, lw=0.8)
        place.set_ylabel("RMSE midpoint / RMSE method")
    _finish(axes, data)


def draw_claims(axes: Any, data: pd.DataFrame) -> None:
    """NEES of single points by what is claimed of them, noises below each other, ranges side by side."""
    for place, part in _panels(axes, data, "noise", "ranges"):
        for claim, rows in part.groupby("claim", sort=False):
            _points(place, rows, "nees", "nees_low", "nees_high", *CLAIMS[claim], claim)
        place.axhline(1, color=FAINT, lw=0.8)
        _logarithmic(place)
        place.set_ylabel("NEES a degree of freedom")
    _finish(axes, data)


def _points(place: Any, rows: pd.DataFrame, value: str, low: str, high: str, colour: str, mark: str, name: str) -> None:
    off = [(rows[value] - rows[low]).clip(lower=0), (rows[high] - rows[value]).clip(lower=0)]
    place.errorbar(
        rows["cameras"], rows[value], yerr=off, color=colour, marker=mark, ms=3.5, lw=0.9, elinewidth=0.8, label=name
    )


def _logarithmic(place: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    place.set_yscale("log")
    place.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    place.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    place.yaxis.set_minor_formatter(NullFormatter())


def _panels(axes: Any, data: pd.DataFrame, down: str, across: str) -> list[tuple[Any, pd.DataFrame]]:
    panels = []
    for place in axes.ravel():
        place.set_axis_off()
    for row, a in enumerate(data[down].unique()):
        for column, b in enumerate(data[across].unique()):
            place = axes[row, column]
            place.set_axis_on()
            place.set_title(f"{_named(down, a)}, {_named(across, b)}", fontsize=8.5)
            panels.append((place, data[(data[down] == a) & (data[across] == b)]))
    return panels


def _named(column: str, value: str) -> str:
    return f"{value} {column}" if column != "calibration" else f"calibration {value}"


def _finish(axes: Any, data: pd.DataFrame) -> None:
    numbers = sorted(data["cameras"].unique())
    for place in axes.ravel():
        place.set_xscale("log")
        place.set_xticks(numbers, [str(n) for n in numbers])
        place.minorticks_off()
        place.set_xlabel("cameras")
    axes[0, 0].legend(fontsize=6.5, frameon=False, ncols=2)
