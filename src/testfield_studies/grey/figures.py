"""Figures of the study of grey methods: what drives accuracy, and how the methods rank it."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield_studies.grey.factors import DUMMY, NAMES
from testfield_studies.grey.rankings import ANOVA, GREY, METHODS
from testfield_studies.grey.samples import LAWS
from testfield_studies.grey.small_samples import BESSEL, SHOWN, SUP


def draw_shares(axes: Any, data: pd.DataFrame) -> None:
    """Shares of variance and total Sobol indices, with what bootstraps give."""
    place = np.arange(len(data))[::-1]
    for ax, key in zip(axes, ("share", "total Sobol"), strict=True):
        colour = [WARM if name == DUMMY else ACCENT for name in data["factor"]]
        ax.barh(place, data[key], color=colour, height=0.62)
        ax.hlines(place, data[f"{key}, low"], data[f"{key}, high"], color=INK, lw=1)
        ax.set(xlabel={"share": "share of variance", "total Sobol": "total Sobol index"}[key])
        ax.set_xlim(0, min(ax.get_xlim()[1], 1.5))  # intervals of small designs have no end
    axes[1].axvline(data.loc[data["factor"] == DUMMY, "total Sobol"].iloc[0], color=WARM, ls=":", lw=1)
    axes[0].set_yticks(place, data["factor"])
    axes[1].set_yticks(place, [""] * len(place))


def draw_ranks(ax: Any, data: pd.DataFrame) -> None:
    """Ranks of the factors by every method."""
    wide = data.pivot(index="factor", columns="method", values="rank")[list(METHODS)].sort_values(ANOVA, kind="stable")
    ax.imshow(-wide.to_numpy(), cmap="Blues", aspect="auto", vmin=-len(NAMES) - 2, vmax=2)
    for i, row in enumerate(wide.to_numpy()):
        for j, rank in enumerate(row):
            ax.text(
                j,
                i,
                str(rank),
                ha="center",
                va="center",
                fontsize=7.5,
                color="white" if rank <= 4 else INK,
                fontweight="bold" if wide.index[i] == DUMMY else "normal",
            )
    ax.set_xticks(range(len(METHODS)), list(METHODS), rotation=35, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(wide)), wide.index)
    for label in ax.get_yticklabels():
        if label.get_text() == DUMMY:
            label.set_color(WARM)
    ax.tick_params(length=0)


def draw_agreement(axes: Any, data: pd.DataFrame) -> None:
    """Agreement with the analysis of variance, and how often the dummy stands above an acting factor, if any acts."""
    place = np.arange(len(data))[::-1]
    colour = [WARM if name in GREY else ACCENT for name in data["method"]]
    axes[0].hlines(place, data["low"], data["high"], color=colour, lw=1.6)
    axes[0].scatter(data["tau"], place, color=colour, s=22, zorder=3)
    axes[0].axvline(0, color=FAINT, lw=0.8)
    axes[0].set_yticks(place, data["method"])
    axes[0].set(xlabel="Kendall's tau", xlim=(-1.05, 1.05), xticks=[-1, -0.5, 0, 0.5, 1])
    if "dummy above an acting factor" in data:
        axes[1].barh(place, data["dummy above an acting factor"], color=colour, height=0.62)
        axes[1].axvline(0.05, color=INK, ls=":", lw=1)
        axes[1].set_yticks(place, [""] * len(place))
        axes[1].set(xlabel="dummy above an acting factor", xlim=(0, 1.02))
    else:
        axes[1].set_axis_off()  # no factor acts
    for ax in axes:
        ax.set_ylim(-0.7, len(data) - 0.3)


def draw_sweeps(axes: Any, data: pd.DataFrame) -> None:
    """Slopes with their 95 % intervals, the dummy's as what is noise, and Deng's degrees."""
    place = np.arange(len(data))[::-1]
    colour = [WARM if name == DUMMY else ACCENT for name in data["factor"]]
    axes[0].barh(place, data["change of ln RMSE"], color=colour, height=0.62)
    axes[0].errorbar(data["change of ln RMSE"], place, xerr=data["u95"], fmt="none", color=INK, lw=1)
    axes[0].axvline(0, color=FAINT, lw=0.8)
    axes[1].barh(place, data["Deng"], color=colour, height=0.62)
    axes[1].axvline(1 / 3, color=INK, ls=":", lw=1)
    axes[0].set_yticks(place, data["factor"])
    axes[1].set_yticks(place, [""] * len(place))
    axes[0].set(xlabel="change of ln RMSE from one end to the other")
    axes[1].set(xlabel="Deng's degree", xlim=(0, 1))


def draw_bias(axes: Any, data: pd.DataFrame) -> None:
    """What each estimator gives of sigma by the size of the sample, a line for each law and for real errors."""
    for ax, estimator in zip(axes, SHOWN, strict=True):
        ax.axhline(1, color=INK, lw=0.8, ls=":")
        for law, own in data[data["estimator"] == estimator].groupby("law", sort=False):
            real = law not in LAWS
            colour = FAINT if not real else ACCENT if "forward" in law else WARM
            style = "--" if law.startswith("one image") else "-"
            ax.plot(
                own["n"],
                own["mean_ratio"],
                color=colour,
                ls=style,
                lw=1.4 if real else 1.0,
                label=law if real else None,
            )
            if not real and estimator == SUP:
                ax.annotate(
                    law,
                    (own["n"].iloc[-1], own["mean_ratio"].iloc[-1]),
                    xytext=(2, 0),
                    fontsize=6,
                    textcoords="offset points",
                    va="center",
                    color="#5f717d",
                )
        ax.set(title=estimator, xscale="log", xlabel="values in a sample", xlim=(2.8, 50), ylim=(0.7, 1.15))
        _size_ticks(ax)
    axes[0].set_ylabel("estimate / sigma")
    if axes[2].get_legend_handles_labels()[0]:
        axes[2].legend(frameon=False, fontsize=6.3, loc="lower right")


def draw_scatter(axes: Any, data: pd.DataFrame) -> None:
    """Relative scatter, and how often the truth is covered, of normal values."""
    for estimator, colour in zip(SHOWN, (WARM, ACCENT, INK), strict=True):
        own = data[data["estimator"] == estimator]
        axes[0].plot(own["n"], own["scatter"], color=colour, marker="o", ms=3, label=estimator)
        axes[1].plot(own["n"], own["mean_covered_2"], color=colour, marker="o", ms=3, label=f"{estimator}, k = 2")
    own = data[data["estimator"] == BESSEL]
    axes[1].plot(own["n"], own["mean_covered_t"], color=INK, ls="--", lw=1, label="Bessel, Student's t")
    axes[1].axhline(0.95, color=FAINT, lw=0.8)
    axes[0].set(xscale="log", yscale="log", xlabel="values in a sample", ylabel="relative scatter")
    axes[0].set_yticks([0.1, 0.2, 0.5], ["0.1", "0.2", "0.5"])
    axes[0].yaxis.set_minor_formatter(lambda *_: "")
    axes[1].set(xscale="log", xlabel="values in a sample", ylabel="share of intervals that hold the truth")
    for ax in axes:
        _size_ticks(ax)
        ax.legend(frameon=False, fontsize=7)


def _size_ticks(ax: Any) -> None:
    ax.set_xticks([3, 5, 10, 30], ["3", "5", "10", "30"])
    ax.xaxis.set_minor_formatter(lambda *_: "")
