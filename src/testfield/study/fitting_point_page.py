"""`study fitting_point`, the findings: does the fitted point tell the accuracy, and what can it not see?"""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2

from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield.study.fitting_point import LAYOUTS, SCALE_ERROR, cases
from testfield.study.study import Findings, Plot, Study, Table
from testfield.uncertainty.consistency import hit_band

LIMIT = float(chi2.ppf(0.95, 3))
THESIS = 88
"""Points of the thesis, of which one lay beyond its limit."""
WAYS = {
    "equal": "equal weights, full covariance",
    "covariance": "weights and claim of the full covariance",
    "alone": "the same without correlations",
}


def read(table: pd.DataFrame) -> Findings:
    """What the table of all trials says."""
    right, wrong = table[table["bar"] == "right"], table[table["bar"] == "wrong"]
    hits, spread, scale = hit_table(right), spread_table(right), scale_table(wrong)
    blocks = block_table(right)
    own = hits[hits["way"] == WAYS["covariance"]]
    accepted = bool(own["accepted"].all())
    trials = int(own["trials"].min())
    first = blocks[blocks["block"] == 1]
    counts = ", ".join(f"{row.beyond} of {row.trials} ({row.layout})" for row in first.itertuples())
    said = "hold" if accepted else "do not hold"
    symmetric, one_sided = (_row(scale, layout, "equal") for layout in LAYOUTS)
    verdict = (
        f"With the bundle's full covariance the limits {said}: "
        + "; ".join(f"{row.within} of {row.trials} within the 95 % limit ({row.layout})" for row in own.itertuples())
        + f". A count of {first['trials'].max()} cannot tell that: {counts} lay beyond. "
        f"Mirror-image end points with equal weights are blind to scale: {1e6 * SCALE_ERROR:.0f} ppm were flagged in "
        f"{100 * symmetric['flagged']:.0f} % of the trials, one-sided ones in {100 * one_sided['flagged']:.0f} %."
    )
    return Findings(
        verdict, sentences(right, hits, spread, scale, blocks),
        [
            Table("Biases within their 95 % limit", hits, "Bias: measured vertex minus fitted point, with its claimed "
                  "covariance. Accepted are counts that true claims give in 99 cases of 100. NEES: mean chi-squared "
                  "of three components over three; 1 where claims are true, more where they are too bold.",
                  {"share": "{:.3f}", "NEES of the bias": "{:.2f}", "NEES of the fitted point": "{:.2f}"}),
            Table("What is claimed and what is", spread, "Root mean squares over all trials and the three axes, µm. "
                  "s_sys is not divided by the number of end points; the dispersion is.",
                  {name: "{:.1f}" for name in spread.columns[2:]}),
            Table(f"A scale bar that is wrong by {1e6 * SCALE_ERROR:.0f} ppm", scale, "Bias: mean over the trials and "
                  "what the closed form foretells, mm. Flagged: trials with a bias beyond its 95 % limit, and with "
                  "a mean relative residual beyond its own.",
                  {"bias_mm": "{:.3f}", "foretold_mm": "{:.3f}", "flagged": "{:.2f}", "residual_ppm": "{:+.0f}",
                   "flagged_by_residual": "{:.2f}"}),
        ],
        [
            Plot("bias_chi2", "Biases over their claimed covariance", "Of true claims they follow the line; beyond the "
                 "dashed limit lie 5 %.", right[["layout", "way", "bias_chi2"]], _draw_chi2, (7.2, 3.4), columns=2),
            Plot("blocks_of_88", f"{THESIS} points, again and again", f"Biases beyond their 95 % limit among {THESIS} "
                 "independent trials, one block after the other. The band holds 99 % of the counts that a true limit "
                 "gives, so every count in it is compatible with it; the thesis' count is 1.", blocks, _draw_blocks,
                 (7.2, 3.0)),
            Plot("scale", "The blind layout", f"A scale bar wrong by {1e6 * SCALE_ERROR:.0f} ppm: the bias of every "
                 "trial (left) and the mean relative residual (right).",
                 wrong[["layout", "way", "bias_x_mm", "bias_y_mm", "bias_z_mm", "mean_relative_ppm"]], _draw_scale,
                 (7.2, 3.2), columns=2),
            Plot("claims", "What ignoring the correlations does", "Actual over claimed variance. 1: the claim is "
                 "true; more: too bold; less: too cautious.", claims_table(right), _draw_claims, (7.2, 3.0)),
        ],
        {
            "trials": trials, "accepted": accepted,
            **{f"within_{row.layout}_{key}": int(row.within) for key, way in WAYS.items()
               for row in hits[hits["way"] == way].itertuples()},
            **{f"beyond_of_{row.trials}_{row.layout}": int(row.beyond) for row in first.itertuples()},
            "scale_flagged_symmetric": symmetric["flagged"], "scale_flagged_one_sided": one_sided["flagged"],
            "points_anees": float(right["points_anees"].mean()),
        },
    )  # fmt: skip


def sentences(
    right: pd.DataFrame, hits: pd.DataFrame, spread: pd.DataFrame, scale: pd.DataFrame, blocks: pd.DataFrame
) -> list[str]:
    """What was found, question by question."""
    found = []
    for layout in LAYOUTS:
        row = hits[(hits["layout"] == layout) & (hits["way"] == WAYS["covariance"])].iloc[0]
        found.append(
            f"{layout}: {row['within']} of {row['trials']} biases lie within their 95 % limit; {row['low']} to "
            f"{row['high']} are accepted, so the limit is {'accepted' if row['accepted'] else 'refused'}."
        )
    whole = blocks[blocks["trials"] == THESIS]
    if len(whole):
        found.append(
            f"Blocks of {THESIS} independent trials had {whole['beyond'].min()} to {whole['beyond'].max()} biases "
            f"beyond the limit, and {(whole['beyond'] <= 1).sum()} of {len(whole)} blocks had one or none, as the "
            f"thesis had. True 95 % and 99 % limits are both compatible with one of {THESIS}."
        )
    claims = claims_table(right)
    for layout in LAYOUTS:
        of = claims[claims["layout"] == layout].set_index(["quantity", "way"])["actual_over_claimed"]
        point, mean, bias = (of[(quantity, "alone")] for quantity in ("fitted point", "mean residual", "bias"))
        full = of[("fitted point", "covariance")]
        found.append(
            f"{layout}, correlations ignored: actual over claimed variance is {point:.1f} for the fitted point (with "
            f"the full covariance {full:.2f}), {mean:.1f} for the mean relative residual and {bias:.2f} for the bias. "
            "Errors that all points share make the fitted point worse than that claim, and cancel in the bias."
        )
    for layout in LAYOUTS:
        row = spread[(spread["layout"] == layout) & (spread["way"] == WAYS["equal"])].iloc[0]
        found.append(
            f"{layout}, equal weights: dispersion {row['dispersion']:.1f} µm, where the fitted point is off by "
            f"{row['fitted point, actual']:.1f} µm: residuals do not see what all points share. s_sys "
            f"{row['s_sys']:.1f} µm ({row['s_sys, foretold']:.1f} foretold), where a length is uncertain by "
            f"{row['length, claimed']:.1f} µm."
        )
    for layout in LAYOUTS:
        of = _of(right, layout, "covariance")[[f"bias_{axis}_mm" for axis in "xyz"]]
        mean, error = 1e3 * of.mean(), 1e3 * of.std() / np.sqrt(len(of))
        told = ", ".join(f"{m:+.1f} ± {e:.1f}" for m, e in zip(mean, error, strict=True))
        found.append(
            f"{layout}: the mean bias of all trials is ({told}) µm, with its standard errors. What differs from zero "
            "there is the same in every exposure: light, lens and detector, not noise or certificates."
        )
    for layout in LAYOUTS:
        row = _row(scale, layout, "equal")
        found.append(
            f"{layout}, equal weights, scale wrong by {1e6 * SCALE_ERROR:.0f} ppm: bias {row['bias_mm']:.3f} mm "
            f"({row['foretold_mm']:.3f} foretold), mean relative residual {row['residual_ppm']:+.0f} ppm."
        )
    weighted = _row(scale, "symmetric", "covariance")
    found.append(
        f"Symmetry is lost with weights that differ: weighted by the covariance, the symmetric layout's bias is "
        f"{weighted['bias_mm']:.3f} mm ({weighted['foretold_mm']:.3f} foretold)."
    )
    found.append(
        "So publish both layouts' bias, and the mean relative residual beside it: what one of them does not see, "
        "another does."
    )
    return found


def hit_table(right: pd.DataFrame) -> pd.DataFrame:
    """Biases within their limit, by layout and way."""
    rows = []
    for layout in LAYOUTS:
        for way, words in WAYS.items():
            of = _of(right, layout, way)
            n, within = len(of), int((of["bias_chi2"] <= LIMIT).sum())
            low, high = hit_band(n, 0.95)
            rows.append({
                "layout": layout, "way": words, "trials": n, "within": within, "share": within / max(n, 1), "low": low,
                "high": high, "accepted": low <= within <= high, "NEES of the bias": of["bias_chi2"].mean() / 3,
                "NEES of the fitted point": of["point_chi2"].mean() / 3,
            })  # fmt: skip
    return pd.DataFrame(rows)


def block_table(right: pd.DataFrame) -> pd.DataFrame:
    """Biases beyond their limit in blocks of 88 trials, with the band of a true limit; a lone shorter one is told."""
    rows = []
    for layout in LAYOUTS:
        beyond = (_of(right, layout, "covariance").sort_values(["seed", "trial"])["bias_chi2"] > LIMIT).to_numpy()
        size = min(THESIS, len(beyond))
        for k in range(len(beyond) // size if size else 0):
            low, high = hit_band(size, 0.05)
            count = int(beyond[k * size : (k + 1) * size].sum())
            rows.append(
                {"layout": layout, "block": k + 1, "trials": size, "beyond": count, "band_low": low, "band_high": high}
            )
    return pd.DataFrame(rows)


def spread_table(right: pd.DataFrame) -> pd.DataFrame:
    """Root mean squares in µm of what is claimed and what is."""
    rows = []
    for layout in LAYOUTS:
        for way, words in WAYS.items():
            of = _of(right, layout, way)
            rows.append({
                "layout": layout, "way": words, "dispersion": _rms(of, "dispersion"),
                "fitted point, claimed": _rms(of, "u_off"), "fitted point, actual": _rms(of, "off"),
                "bias, claimed": _rms(of, "u_bias"), "bias, actual": _rms(of, "bias"),
                "s_sys": 1e3 * float(np.sqrt((of["s_sys_mm"] ** 2).mean())),
                "s_sys, foretold": 1e3 * float(np.sqrt((of["expected_s_sys_mm"] ** 2).mean())),
                "length, claimed": 1e3 * float(np.sqrt((of["u_radial_mm"] ** 2).mean())),
            })  # fmt: skip
    return pd.DataFrame(rows)


def claims_table(right: pd.DataFrame) -> pd.DataFrame:
    """Actual over claimed variance: mean chi-squared over its degrees of freedom."""
    rows = []
    for layout in LAYOUTS:
        for way in ("covariance", "alone"):
            of = _of(right, layout, way)
            z = of["mean_relative_ppm"] / of["u_mean_relative_ppm"]
            for quantity, ratio in (
                ("fitted point", of["point_chi2"].mean() / 3), ("bias", of["bias_chi2"].mean() / 3),
                ("mean residual", (z**2).mean()),
            ):  # fmt: skip
                rows.append({"layout": layout, "way": way, "quantity": quantity, "actual_over_claimed": float(ratio)})
    return pd.DataFrame(rows)


def scale_table(wrong: pd.DataFrame) -> pd.DataFrame:
    """What a wrong bar does to bias and residuals."""
    rows = []
    for layout in LAYOUTS:
        for way, words in WAYS.items():
            of = _of(wrong, layout, way)
            bias, foretold = (
                float(np.linalg.norm([of[f"{name}_{axis}_mm"].mean() for axis in "xyz"]))
                for name in ("bias", "scale_bias")
            )
            z = of["mean_relative_ppm"] / of["u_mean_relative_ppm"]
            rows.append({
                "layout": layout, "way": words, "trials": len(of), "bias_mm": bias, "foretold_mm": foretold,
                "flagged": float((of["bias_chi2"] > LIMIT).mean()),
                "residual_ppm": float(of["mean_relative_ppm"].mean()),
                "flagged_by_residual": float((z.abs() > 1.96).mean()),
            })  # fmt: skip
    return pd.DataFrame(rows)


def _of(table: pd.DataFrame, layout: str, way: str) -> pd.DataFrame:
    return table[(table["layout"] == layout) & (table["way"] == way)]


def _row(scale: pd.DataFrame, layout: str, way: str) -> Any:
    return scale[(scale["layout"] == layout) & (scale["way"] == WAYS[way])].iloc[0]


def _rms(of: pd.DataFrame, name: str) -> float:
    return 1e3 * float(np.sqrt(np.mean([(of[f"{name}_{axis}_mm"] ** 2).mean() for axis in "xyz"])))


def _draw_chi2(both: Any, data: pd.DataFrame) -> None:
    top = np.linspace(0, 20, 200)
    for axes, layout in zip(both, LAYOUTS, strict=True):
        for way, colour in (("covariance", ACCENT), ("alone", WARM)):
            values = np.sort(_of(data, layout, way)["bias_chi2"])
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


def _draw_blocks(axes: Any, data: pd.DataFrame) -> None:
    if len(data):
        axes.axhspan(data["band_low"].iloc[0], data["band_high"].iloc[0], color=FAINT, alpha=0.2, lw=0)
    for layout, colour, shift in zip(LAYOUTS, (ACCENT, WARM), (-0.12, 0.12), strict=True):
        of = data[data["layout"] == layout]
        axes.plot(of["block"] + shift, of["beyond"], "o", ms=5, color=colour, label=layout)
    axes.axhline(1, color=INK, lw=0.8, ls=":")
    axes.set_xlabel(f"block of {data['trials'].iloc[0] if len(data) else THESIS} trials")
    axes.set_ylabel("beyond the 95 % limit")
    axes.set_xlim(0.5, data["block"].max() + 0.5 if len(data) else 1.5)
    axes.set_ylim(-0.5, max(12.5, data["beyond"].max() + 2.5) if len(data) else 12.5)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(frameon=False, loc="upper left", ncols=2)


def _draw_scale(both: Any, data: pd.DataFrame) -> None:
    names = [(layout, way) for layout in LAYOUTS for way in ("equal", "covariance")]
    rng = np.random.default_rng(0)
    for k, (layout, way) in enumerate(names):
        of = _of(data, layout, way)
        size = np.sqrt(sum(of[f"bias_{axis}_mm"] ** 2 for axis in "xyz"))
        beside = k + 0.25 * (rng.random(len(of)) - 0.5)
        for axes, values in zip(both, (size, of["mean_relative_ppm"]), strict=True):
            axes.plot(beside, values, "o", ms=3, mew=0, alpha=0.7, color=ACCENT if way == "equal" else WARM)
    both[1].axhline(-1e6 * SCALE_ERROR, color=INK, lw=0.8, ls=":")
    both[0].set_ylim(0, None)
    both[0].set_ylabel("bias, mm")
    both[1].set_ylabel("mean relative residual, ppm")
    for axes in both:
        axes.set_xticks(range(len(names)), [f"{layout}\n{way}" for layout, way in names], fontsize=7)


def _draw_claims(axes: Any, data: pd.DataFrame) -> None:
    quantities = ["fitted point", "mean residual", "bias"]
    for k, (layout, way) in enumerate((layout, way) for layout in LAYOUTS for way in ("covariance", "alone")):
        of = data[(data["layout"] == layout) & (data["way"] == way)].set_index("quantity")["actual_over_claimed"]
        axes.bar(
            np.arange(3) + 0.2 * (k - 1.5), of[quantities], 0.18, color=ACCENT if way == "covariance" else WARM,
            alpha=1.0 if layout == "symmetric" else 0.55, label=f"{layout}, {WAYS[way]}",
        )  # fmt: skip
    axes.axhline(1, color=INK, lw=0.8)
    axes.set_xticks(range(3), quantities)
    axes.set_ylabel("actual over claimed variance")
    axes.legend(frameon=False, fontsize=7)


STUDY = Study(
    "fitting_point",
    "Accuracy from distances with a common vertex",
    "A point fitted to known distances from measured end points tells the accuracy of a measuring system without a "
    "registration: its bias and dispersion hold their confidence level, for of 88 points one was beyond its limit.",
    cases,
    read,
)
