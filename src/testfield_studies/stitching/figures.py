"""The figures of the study on stitched boards."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.report.style import ACCENT, FAINT, INK, WARM

LOOKS = {
    "planned": (ACCENT, "o", "-"),
    "random": (WARM, "s", "-"),
    "flat": ("#6b8e23", "^", "-"),
    "full-size": (INK, "D", "--"),
    "ChArUco, OpenCV": ("#8a4fa3", "v", ":"),
    "ChArUco, this bundle": ("#c79bd6", "v", ":"),
    "ChArUco, this bundle, no bar": ("#8a4fa3", "1", ":"),
    "one of them alone": (FAINT, "x", "-"),
}
WIDE = {
    0: ("close views only", WARM, "o"),
    1: ("with 1 wide view", FAINT, "s"),
    2: ("with 2 wide views", FAINT, "s"),
    4: ("with 4 wide views", ACCENT, "D"),
}
BEYOND = 100.0
"""A lens that errs by more px, or points by more mm, are not shown: nothing was determined."""


def draw_counts(axes: Any, data: pd.DataFrame) -> None:
    """Left the corner error, right the check points, over the number of boards; drawn pixels as lines, rendered images
    as open marks."""
    for axis, quantity in zip(axes, ("corner_px", "check_rmse_mm"), strict=True):
        here = data[(data["quantity"] == quantity) & (data["median"] < BEYOND)]
        for name, (colour, mark, line) in LOOKS.items():
            for evidence, rows in here[here["target"] == name].sort_values("boards").groupby("evidence"):
                drawn = evidence == "drawn"
                bars = [rows["median"] - rows["low"], np.minimum(rows["high"], BEYOND) - rows["median"]]
                axis.errorbar(
                    rows["boards"] * (1 if drawn else 1.05),
                    rows["median"],
                    bars,
                    color=colour,
                    marker=mark,
                    ms=4,
                    lw=1 if drawn or ":" in line else 0,
                    ls=line,
                    elinewidth=0.7,
                    mfc=colour if drawn else "white",
                    label=name
                    if drawn or not len(here[(here["target"] == name) & (here["evidence"] == "drawn")])
                    else None,
                )
        for name, style in (("sub-board, close", "-"), ("charuco, close", ":")):
            rows = here[here["target"] == name]
            if len(rows):
                axis.axhline(rows["median"].iloc[0], color=FAINT, ls=style, lw=1.2, label=f"one {name}")
        axis.set_yscale("log")
        axis.set_xticks(sorted(data["boards"].unique()))
        axis.set_xlabel("sub-boards, or marks of a single board in units of a sub-board's 36")
    axes[0].set_ylabel("error of the camera at the worst corner, px")
    axes[1].set_ylabel("check points, RMSE after 6-parameter fit, mm")
    axes[0].legend(frameon=False, fontsize=7)


def draw_chain(axes: Any, data: pd.DataFrame) -> None:
    """Above boards printed exactly, below with print errors; left out of the chain's plane, right upwards: errors
    across the chain, predictions, wide views."""
    for row, (exact, prints) in zip(
        axes, ((True, "printed exactly"), (False, "with print errors of 0.01 mm")), strict=True
    ):
        for axis, (name, title) in zip(row, (("out", "out of the plane"), ("up", "upwards")), strict=True):
            _draw_growth(axis, data[((data["print_mm"] == 0) == exact) & (data["axis"] == name)])
            axis.set_title(f"{title}, boards {prints}", fontsize=8.5)
            axis.set_ylim(0)
    for axis in axes[1]:
        axis.set_xlabel("links from the first board")
    for axis in axes[:, 0]:
        axis.set_ylabel("error across the chain, rms, µm")
    axes[0, 0].legend(frameon=False, fontsize=7, loc="upper left")


def _draw_growth(axis: Any, data: pd.DataFrame) -> None:
    for wide in (0, 4):
        name, colour, mark = WIDE[wide]
        for evidence, rows in data[data["wide"] == wide].groupby("evidence"):
            drawn = evidence == "drawn"
            bars = [1e3 * (rows["rms_mm"] - rows["low_mm"]), 1e3 * (rows["high_mm"] - rows["rms_mm"])]
            axis.errorbar(
                rows["links"] + (0 if drawn else 0.12),
                1e3 * rows["rms_mm"],
                bars if rows["worlds"].min() >= 3 else None,  # the interval of a single world says nothing
                color=colour,
                marker=mark,
                ms=3.5,
                lw=0,
                elinewidth=0.8,
                mfc=colour if drawn else "white",
                label=name + ("" if drawn else ", rendered"),
            )
            if drawn:
                label = "    claimed by the bundle" if wide == 0 else None
                axis.plot(rows["links"], 1e3 * rows["claimed_mm"], color=colour, lw=1.2, label=label)
    rows = data[(data["wide"] == 0) & (data["evidence"] == "drawn")]
    axis.plot(rows["links"], 1e3 * rows["law_mm"], color=INK, ls="--", lw=1, label="law of independent links")
    axis.plot(
        rows["links"], 1e3 * rows["law_shared_mm"], color=INK, ls=":", lw=1, label="    with shift-turn covariance"
    )


def draw_faults(axes: Any, data: pd.DataFrame) -> None:
    """Left bent boards, right boards with scale errors of their own: corner errors."""
    for axis, fault in zip(axes, ("bent", "scale"), strict=True):
        here = data[(data["experiment"] == fault)]
        for target, rows in here.groupby("target"):
            colour, mark, _ = LOOKS[str(target)]
            for evidence, part in rows.sort_values("level").groupby("evidence"):
                drawn = evidence == "drawn"
                bars = [part["median"] - part["low"], part["high"] - part["median"]]
                axis.errorbar(
                    part["level"] * (1 if drawn else 1.06),
                    part["median"],
                    bars,
                    color=colour,
                    marker=mark,
                    ms=4,
                    lw=1 if drawn else 0,
                    elinewidth=0.7,
                    mfc=colour if drawn else "white",
                    label={"planned": "six stitched", "full-size": "full-size, same curvature"}.get(str(target))
                    if drawn
                    else None,
                )
        axis.set_xscale("log")
        axis.set_yscale("log")
    axes[0].set_xlabel("bow of a sub-board, mm over 400 mm")
    axes[1].set_xlabel("standard deviation of the boards' own scales, ppm")
    axes[0].set_ylabel("error of the camera at the worst corner, px")
    axes[0].legend(frameon=False, fontsize=7)


def draw_coverage(axes: Any, data: pd.DataFrame) -> None:
    """Left observations confined to the image's middle against as many from all over it; right all fields."""
    cut = data[data["what"] == "cut"]
    for name, colour, label in (
        ("middle", WARM, "the middle of the image only"),
        ("spread", ACCENT, "as many, from all over"),
    ):
        rows = cut[(cut["name"] == name) & (cut["evidence"] == "drawn")].sort_values("window")
        axes[0].errorbar(
            100 * rows["window"],
            rows["median"],
            [rows["median"] - rows["low"], rows["high"] - rows["median"]],
            color=colour,
            marker="o",
            ms=4,
            lw=1,
            elinewidth=0.7,
            label=label,
        )
    axes[0].set_xlabel("part of the image's sides, %")
    axes[0].set_ylabel("error of the camera at the worst corner, px")
    axes[0].legend(frameon=False, fontsize=7)
    rest = data[(data["what"] == "field") & (data["median"] < BEYOND)]
    for name, rows in rest.groupby("name"):
        colour, mark, _ = LOOKS.get(str(name), (FAINT, "x", "-"))
        axes[1].plot(100 * rows["coverage"], rows["median"], mark, color=colour, ms=4, label=str(name))
    axes[1].set_xlabel("coverage: part of the image's 8 x 6 cells with a mark, %")
    if len(rest):
        axes[1].legend(frameon=False, fontsize=7)
    for axis in axes:
        axis.set_yscale("log")
