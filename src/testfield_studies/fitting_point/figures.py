"""`study fitting_point`, the drawings."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2

from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield_studies.fitting_point.experiment import LAYOUTS, SCALE_ERROR
from testfield_studies.fitting_point.tables import AXES, LIMIT, WAYS, of


def draw_chi2(both: Any, data: pd.DataFrame) -> None:
    """Shares of squared biases beyond each size, one drawing a layout."""
    top = np.linspace(0, 20, 200)
    for axes, layout in zip(both, LAYOUTS, strict=True):
        for way, colour in (("covariance", ACCENT), ("alone", WARM)):
            values = np.sort(of(data, layout, way)["bias_chi2"])
            axes.step(values, 1 - (np.arange(len(values)) + 0.5) / max(len(values), 1), color=colour, label=WAYS[way])
        axes.plot(top, chi2.sf(top, 3), color=INK, lw=1, label="true claims")
        axes.axvline(LIMIT, color=FAINT, ls="--", lw=1)
        axes.set_yscale("log")
        axes.set_ylim(1e-3, 1)
        axes.set_xlim(0, 20)
        axes.set_title(layout, loc="left")
        axes.set_xlabel("squared bias over its covariance")
    both[0].set_ylabel("share beyond")
    both[1].legend(frameon=False, fontsize=7.5)


def draw_blocks(axes: Any, data: pd.DataFrame) -> None:
    """Biases beyond their limit in each block, with the bands of a true 95 % and a true 99 % limit."""
    for band in ("band", "band_99"):
        low, high = data[f"{band}_low"].min(), data[f"{band}_high"].max()
        axes.axhspan(low, high, color=FAINT, alpha=0.2, lw=0)
    for layout, colour, shift in zip(LAYOUTS, (ACCENT, WARM), (-0.12, 0.12), strict=True):
        found = data[data["layout"] == layout]
        axes.plot(found["block"] + shift, found["beyond"], "o", ms=5, color=colour, label=layout)
    axes.axhline(1, color=INK, lw=0.8, ls=":")
    axes.set_xlabel(f"block of {data['trials'].max()} trials")
    axes.set_ylabel("beyond the 95 % limit")
    axes.set_xlim(0.5, data["block"].max() + 0.5)
    axes.set_ylim(-0.5, max(12.5, data["beyond"].max() + 2.5))
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(frameon=False, loc="upper left", ncols=2)


def draw_scale(both: Any, data: pd.DataFrame) -> None:
    """Size of the bias, and mean relative residual, of every trial with a wrong bar."""
    names = [(layout, way) for layout in LAYOUTS for way in ("equal", "covariance")]
    rng = np.random.default_rng(0)
    for k, (layout, way) in enumerate(names):
        found = of(data, layout, way)
        size = np.sqrt(sum(found[f"bias_{axis}_mm"] ** 2 for axis in AXES))
        beside = k + 0.25 * (rng.random(len(found)) - 0.5)
        for axes, values in zip(both, (size, found["mean_relative_ppm"]), strict=True):
            axes.plot(beside, values, "o", ms=3, mew=0, alpha=0.7, color=ACCENT if way == "equal" else WARM)
    both[1].axhline(-1e6 * SCALE_ERROR, color=INK, lw=0.8, ls=":")
    both[0].set_ylim(0, None)
    both[0].set_ylabel("bias, mm")
    both[1].set_ylabel("mean relative residual, ppm")
    for axes in both:
        axes.set_xticks(range(len(names)), [f"{layout}\n{way}" for layout, way in names], fontsize=7)


def draw_claims(axes: Any, data: pd.DataFrame) -> None:
    """Actual over claimed variances."""
    quantities = ["fitted point", "mean residual", "bias"]
    for k, (layout, way) in enumerate((layout, way) for layout in LAYOUTS for way in ("covariance", "alone")):
        found = of(data, layout, way).set_index("quantity")["actual_over_claimed"].reindex(quantities)
        axes.bar(
            np.arange(3) + 0.2 * (k - 1.5),
            found,
            0.18,
            color=ACCENT if way == "covariance" else WARM,
            alpha=1.0 if layout == "symmetric" else 0.55,
            label=f"{layout}, {WAYS[way]}",
        )
    axes.axhline(1, color=INK, lw=0.8)
    axes.set_xticks(range(3), quantities)
    axes.set_ylabel("actual over claimed variance")
    axes.legend(frameon=False, fontsize=7)
