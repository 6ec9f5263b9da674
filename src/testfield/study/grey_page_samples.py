"""What the study of grey methods found of the grey uncertainty of small samples."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import kurtosis, skew

from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield.study.grey_samples import BATCHES, LAWS, SIZES, judge, population_draw
from testfield.study.study import Findings, Plot, Table

SUP, SUM, BESSEL = "grey, largest gap", "grey, sum of gaps", "Bessel"
SHOWN = (SUP, SUM, BESSEL)
NAMED = {"forward_model": "forward model", "grey_centroid": "grey centroid"}


def read_samples(table: pd.DataFrame) -> Findings:
    """Findings from the rows of the laws and of the exposures."""
    laws = table[table["part"] == "law"]
    shots = table[table["part"] == "exposures"]
    count = int(laws["samples"].max()) // 4
    real = populations(shots)
    rows = [
        row for name, groups in real.items() for n in SIZES for row in judge(name, population_draw(groups), n, count)
    ]
    columns = list(rows[0]) if rows else list(laws.columns)
    judged = pd.concat([laws[columns], pd.DataFrame(rows)], ignore_index=True)
    described = pd.DataFrame([_described(name, groups) for name, groups in real.items()])

    def of(law: str, estimator: str, n: int, key: str = "mean_ratio") -> float:
        own = judged[(judged["law"] == law) & (judged["estimator"] == estimator) & (judged["n"] == n)]
        return float(own[key].iloc[0])

    at_30 = {law: of(law, SUP, 30) for law in (*LAWS, *real)}
    low, high = min(at_30, key=lambda law: at_30[law]), max(at_30, key=lambda law: at_30[law])
    scatters = [of("normal", name, 3, "scatter") for name in SHOWN]
    wins = [law for law in (*LAWS, *real)
            if _clearly_less(judged, law, SUP, BESSEL)]  # fmt: skip
    losses = [law for law in (*LAWS, *real) if _clearly_less(judged, law, BESSEL, SUP)]
    dots = [law for law in real if law.startswith("one dot")]
    images = [law for law in real if law.startswith("one image")]
    sentences = [
        "The grey standard uncertainty of a sorted sample is Peters' formula, 1.25 times the mean absolute "
        "deviation, and the sum of the same gaps is Downton's estimator (Gini's mean difference): both to the last "
        "digit. They are statistics of the order statistics, known since 1856 and 1966, and not a way around "
        "statistics.",
        f"On the mean the largest gap gives {of('normal', SUP, 3):.3f} sigma of 3 normal values, "
        f"{of('normal', SUP, 5):.3f} of 5 and {of('normal', SUP, 10):.3f} of 10 (Bessel: "
        f"{of('normal', BESSEL, 3):.3f}, {of('normal', BESSEL, 5):.3f}, {of('normal', BESSEL, 10):.3f}): of small "
        "samples it is the more optimistic of the two. The sum of gaps has no bias there "
        f"({of('normal', SUM, 3):.3f}, {of('normal', SUM, 5):.3f}, {of('normal', SUM, 10):.3f}).",
        f"It is not free of a law: of 30 values it gives from {at_30[low]:.3f} sigma ({low}) to {at_30[high]:.3f} "
        f"sigma ({high}), and more values do not mend that; Bessel's formula gives from "
        f"{min(of(law, BESSEL, 30) for law in at_30):.3f} to {max(of(law, BESSEL, 30) for law in at_30):.3f}, the sum "
        f"of gaps from {min(of(law, SUM, 30) for law in at_30):.3f} to {max(of(law, SUM, 30) for law in at_30):.3f}.",
        "There is no small-sample miracle: of 3 normal values the three estimators scatter by "
        f"{100 * scatters[0]:.0f}, {100 * scatters[1]:.0f} and {100 * scatters[2]:.0f} % of themselves (largest gap, "
        f"sum, Bessel). At n = 10 the largest gap scatters less than Bessel for {_list(wins) or 'none of the laws'}, "
        f"and more for {_list(losses) or 'none'}.",
        "A mean of 3 normal values plus or minus twice the grey uncertainty over sqrt(3), without degrees of "
        f"freedom, holds the truth in {100 * of('normal', SUP, 3, 'mean_covered_2'):.0f} of 100 cases, not in 95; of "
        f"5 in {100 * of('normal', SUP, 5, 'mean_covered_2'):.0f}. With the factor that its own scatter asks for it "
        f"is right ({100 * of('normal', SUP, 3, 'mean_covered_t'):.1f}), as Bessel's is with Student's "
        f"({100 * of('normal', BESSEL, 3, 'mean_covered_t'):.1f}).",
        "Without sorting, the same formula depends on the order of the values: on the mean it gives "
        f"{of('normal', 'grey, not sorted', 5):.3f} sigma of 5 normal values and scatters by "
        f"{100 * of('normal', 'grey, not sorted', 5, 'scatter'):.0f} % (sorted: "
        f"{100 * of('normal', SUP, 5, 'scatter'):.0f} %).",
    ]
    for law in dots:
        own = described[described["errors"] == law].iloc[0]
        sentences.append(
            f"Real centre errors, {law}: excess kurtosis {own['excess kurtosis']:+.2f}, skewness "
            f"{own['skewness']:+.2f}; 5 of them give {of(law, SUP, 5):.3f} sigma by the largest gap, "
            f"{of(law, SUM, 5):.3f} by the sum, {of(law, BESSEL, 5):.3f} by Bessel (normal: "
            f"{of('normal', SUP, 5):.3f}, {of('normal', SUM, 5):.3f}, {of('normal', BESSEL, 5):.3f}). A dot's own "
            f"bias is {own['bias over scatter']:.2f} of this scatter, and no estimator sees it in repeated images."
        )
    for law in images:
        own = described[described["errors"] == law].iloc[0]
        sentences.append(
            f"Real centre errors, {law}, where dots differ in size, light and bias: excess kurtosis "
            f"{own['excess kurtosis']:+.2f}; 30 of them give {of(law, SUP, 30):.3f} sigma by the largest gap and "
            f"{of(law, BESSEL, 30):.3f} by Bessel."
        )
    figures: dict[str, Any] = {
        "largest gap over sigma, 3 normal values": of("normal", SUP, 3),
        "largest gap over sigma, 30 values, least and most": [at_30[low], at_30[high]],
        "relative scatter of 3 normal values (largest gap, sum, Bessel)": scatters,
        "covered by mean +- 2 u / sqrt(n), n = 3": of("normal", SUP, 3, "mean_covered_2"),
    } | {f"largest gap over sigma, 5 real errors, {law}": of(law, SUP, 5) for law in real}
    verdict = (
        "As an estimator of a standard uncertainty the grey method is sound, but it is Peters' and Downton's under "
        f"other names: no better than Bessel's formula at three values ({100 * scatters[0]:.0f} % scatter against "
        f"{100 * scatters[2]:.0f} %), more dependent on the law ({at_30[low]:.2f} to {at_30[high]:.2f} sigma of 30 "
        "values), and its expanded uncertainty without degrees of freedom is too small."
    )
    return Findings(verdict, sentences, _tables(judged, described), _plots(judged), figures)


def populations(shots: pd.DataFrame) -> dict[str, list[np.ndarray]]:
    """Centre errors by name, as populations to draw from: a dot's coordinate over all exposures; all dots' coordinates
    of an exposure. Dots that were not measured in every exposure are left out."""
    found: dict[str, list[np.ndarray]] = {}
    for centroid, own in shots.groupby("centroid"):
        number = own["exposure"].nunique()
        wide = own.pivot(index="exposure", columns=["station", "mark"], values=["error_x_px", "error_y_px"])
        errors = wide.dropna(axis=1).to_numpy(float)
        if number < 3 or errors.shape[1] < BATCHES:
            continue
        name = NAMED.get(str(centroid), str(centroid))
        found[f"one dot, many images ({name})"] = list(errors.T)
        half = errors.shape[1] // 2
        # x and y by themselves: a sample is of one coordinate.
        found[f"one image, many dots ({name})"] = [part for row in errors for part in (row[:half], row[half:])]
    return found


def _described(name: str, groups: list[np.ndarray]) -> dict[str, Any]:
    pooled = np.concatenate([(g - g.mean()) / g.std() for g in groups])
    scatter = float(np.sqrt(np.mean([g.var() for g in groups])))
    bias = float(np.sqrt(np.mean([g.mean() ** 2 for g in groups])))
    return {
        "errors": name, "populations": len(groups), "values in each": len(groups[0]), "scatter, px": scatter,
        "bias, px": bias, "bias over scatter": bias / scatter, "skewness": float(skew(pooled)),
        "excess kurtosis": float(kurtosis(pooled)),
    }  # fmt: skip


def _clearly_less(judged: pd.DataFrame, law: str, one: str, other: str) -> bool:
    """Whether one estimator's relative scatter at n = 10 is below another's by more than three standard "
    "uncertainties."""
    own = judged[(judged["law"] == law) & (judged["n"] == 10)].set_index("estimator")
    off = own.loc[other, "scatter"] - own.loc[one, "scatter"]
    return bool(off > 3 * np.hypot(own.loc[one, "u_scatter"], own.loc[other, "u_scatter"]))


def _list(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _tables(judged: pd.DataFrame, described: pd.DataFrame) -> list[Table]:
    sizes = [3, 5, 10, 30]
    tables = []
    for key, title, note in (
        ("mean_ratio", "Estimate over sigma, on the mean", "1 is right. Plus or minus: 95 % interval."),
        ("scatter", "Relative scatter of the estimate", "Standard deviation over mean, with its 95 % interval."),
        ("sigma_covered", "How often a 95 % interval for sigma holds it", "The interval is right for the normal law."),
        ("mean_covered_2", "How often mean plus or minus 2 u / sqrt(n) holds the truth",
         "0.95 is wanted; no degrees of freedom are used."),
        ("mean_covered_t", "How often mean plus or minus k u / sqrt(n) holds the truth",
         "k by the estimator and n, right for the normal law (Bessel: Student's t)."),
    ):  # fmt: skip
        rows = []
        for (law, estimator), own in judged.groupby(["law", "estimator"], sort=False):
            by = own.set_index("n")
            cells = {f"n = {n}": f"{by.loc[n, key]:.3f} ± {1.96 * by.loc[n, f'u_{key}']:.3f}" for n in sizes}
            rows.append({"law": law, "estimator": estimator} | cells)
        tables.append(Table(title, pd.DataFrame(rows), note))
    if len(described):
        tables.append(Table(
            "Centre errors of the rendered scene", described,
            "Errors against the truth, one coordinate; sigma of a population is that of all its values.",
            {"scatter, px": "{:.5f}", "bias, px": "{:.5f}", "bias over scatter": "{:.2f}", "skewness": "{:+.2f}",
             "excess kurtosis": "{:+.2f}"},
        ))  # fmt: skip
    return tables


def _plots(judged: pd.DataFrame) -> list[Plot]:
    keys = ["law", "estimator", "n", "mean_ratio", "u_mean_ratio", "scatter", "u_scatter", "mean_covered_2",
            "u_mean_covered_2", "mean_covered_t", "u_mean_covered_t"]  # fmt: skip
    data = judged[judged["estimator"].isin(SHOWN)][keys]
    return [
        Plot("bias", "What small samples give of sigma",
             "Estimate over sigma on the mean. Grey lines: five laws; blue and red: real centre errors.",
             data, _draw_bias, (9.5, 3.6), columns=3),
        Plot("scatter", "How much the estimates scatter, and what is covered",
             "Left: relative scatter, normal values; right: how often the mean plus or minus 2 u / sqrt(n) holds the "
             "truth.", data[data["law"] == "normal"], _draw_scatter, (8.2, 3.3), columns=2),
    ]  # fmt: skip


def _draw_bias(axes: Any, data: pd.DataFrame) -> None:
    for ax, estimator in zip(axes, SHOWN, strict=True):
        ax.axhline(1, color=INK, lw=0.8, ls=":")
        for law, own in data[data["estimator"] == estimator].groupby("law", sort=False):
            real = law not in LAWS
            colour = FAINT if not real else ACCENT if "forward" in law else WARM
            style = "--" if law.startswith("one image") else "-"
            ax.plot(own["n"], own["mean_ratio"], color=colour, ls=style, lw=1.4 if real else 1.0,
                    label=law if real else None)  # fmt: skip
            if not real and estimator == SUP:
                ax.annotate(law, (own["n"].iloc[-1], own["mean_ratio"].iloc[-1]), xytext=(2, 0), fontsize=6,
                            textcoords="offset points", va="center", color="#5f717d")  # fmt: skip
        ax.set(title=estimator, xscale="log", xlabel="values in a sample", xlim=(2.8, 50), ylim=(0.7, 1.15))
        _size_ticks(ax)
    axes[0].set_ylabel("estimate / sigma")
    if axes[2].get_legend_handles_labels()[0]:
        axes[2].legend(frameon=False, fontsize=6.3, loc="lower right")


def _draw_scatter(axes: Any, data: pd.DataFrame) -> None:
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
