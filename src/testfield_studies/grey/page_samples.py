"""What the study of grey methods found of the grey uncertainty of small samples.

Real centre errors are brought to sigma 1 by their own few exposures, which makes exactly normal errors look a little
unlike a normal law. So beside them stand normal errors of the same shape: as many dots and images, the same scatter,
biases of dots that are normal too.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import kurtosis, skew

from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield.seeds import generator
from testfield_studies.grey.samples import BATCHES, LAWS, SIZES, judge, population_draw
from testfield_studies.grey.words import chosen, listed
from testfield.study.study import Findings, Plot, Table
from testfield.uncertainty.grey_uncertainty import sup_norm_uncertainty

SUP, SUM, BESSEL, UNSORTED = "grey, largest gap", "grey, sum of gaps", "Bessel", "grey, not sorted"
SHOWN = (SUP, SUM, BESSEL)
NAMED = {"forward_model": "forward model", "grey_centroid": "grey centroid"}
DOT, IMAGE = "one dot, many images", "one image, many dots"
TYPICAL = {DOT: 5, IMAGE: 30}
"""How large a sample of either is looked at."""
ALIKE = 200
"""Sets of normal errors of the same shape; from so many, POOLED of them, samples are drawn too."""
POOLED = 20
FEWEST = 4
"""Exposures that a kurtosis needs."""
SURE = 3.0
"""A difference is one where it is more than so many standard uncertainties."""


@dataclass(frozen=True)
class Judged:
    """Rows of `judge`, of all laws and errors."""

    rows: pd.DataFrame

    def of(self, law: str, estimator: str, n: int, key: str = "mean_ratio") -> float:
        """One figure."""
        own = self.rows
        own = own[(own["law"] == law) & (own["estimator"] == estimator) & (own["n"] == n)]
        return float(own[key].iloc[0])

    def off(self, law: str, one: str, other: str, n: int, key: str = "mean_ratio") -> tuple[float, float]:
        """Interval of the difference of two estimators, one minus the other."""
        off = self.of(law, one, n, key) - self.of(law, other, n, key)
        wide = SURE * np.hypot(self.of(law, one, n, f"u_{key}"), self.of(law, other, n, f"u_{key}"))
        return off - wide, off + wide

    def spread(self, laws: list[str], estimator: str, n: int) -> tuple[str, str, float, float]:
        """The laws of the least and the largest estimate over sigma, that range, and its standard uncertainty."""
        at = {law: self.of(law, estimator, n) for law in laws}
        low, high = min(laws, key=at.__getitem__), max(laws, key=at.__getitem__)
        u = [self.of(law, estimator, n, "u_mean_ratio") for law in (low, high)]
        return low, high, at[high] - at[low], float(np.hypot(u[0], u[1]))


def read_samples(table: pd.DataFrame) -> Findings:
    """Findings from the rows of the laws and of the exposures; of what is not there, nothing is said."""
    laws = table[table["part"] == "law"]
    errors = errors_of(table[table["part"] == "exposures"])
    if laws.empty and not errors:
        return Findings("Of the grey uncertainty nothing can be said yet.", [])
    count = int(laws["samples"].max()) // 4 if len(laws) else 5000
    real = {f"{kind} ({name})": groups for name, own in errors.items() for kind, groups in populations(own).items()}
    rows = [
        row for name, groups in real.items() for n in SIZES for row in judge(name, population_draw(groups), n, count)
    ]
    columns = list(rows[0]) if rows else list(laws.columns)
    judged = Judged(pd.concat([laws[columns] for _ in laws.index[:1]] + [pd.DataFrame(rows)], ignore_index=True))
    described = [row for name, own in errors.items() for row in _described(name, own, judged, count)]
    there = [law for law in LAWS if law in set(judged.rows["law"])]
    sentences = [
        "The grey standard uncertainty of a sorted sample is Peters' formula, 1.25 times the mean absolute "
        "deviation, and the sum of the same gaps is Downton's estimator (Gini's mean difference): both to the last "
        "digit. They are statistics of the order statistics, known since 1856 and 1966, and not a way around "
        "statistics.",
        *_of_normal_values(judged, there),
        *_of_laws(judged, there, [name for name in real if name.startswith(IMAGE)]),
        *(_of_real_errors(row) for row in described),
    ]
    figures: dict[str, Any] = {
        f"largest gap over sigma, {row['n']} real errors, {row['errors']}": row["largest gap"] for row in described
    }
    if "normal" in there:
        figures |= {
            "largest gap over sigma, 3 normal values": judged.of("normal", SUP, 3),
            "relative scatter of 3 normal values (largest gap, sum, Bessel)": [
                judged.of("normal", name, 3, "scatter") for name in SHOWN],
            "covered by mean +- 2 u / sqrt(n), n = 3": judged.of("normal", SUP, 3, "mean_covered_2"),
        }  # fmt: skip
    if len(there) > 1:
        low, high, *_ = judged.spread(there, SUP, 30)
        figures["largest gap over sigma, 30 values, least and most"] = [judged.of(law, SUP, 30) for law in (low, high)]
    verdict = _verdict(judged, there)
    return Findings(verdict, sentences, _tables(judged.rows, described), _plots(judged.rows), figures)


def _verdict(judged: Judged, there: list[str]) -> str:
    if "normal" not in there:
        return "Of the grey uncertainty little can be said yet: samples of the normal law are not there."
    one, other = (100 * judged.of("normal", name, 3, "scatter") for name in (SUP, BESSEL))
    scatter = chosen(
        *judged.off("normal", SUP, BESSEL, 3, "scatter"),
        "of three normal values it scatters less than Bessel's formula",
        "of three normal values its scatter cannot be told from that of Bessel's formula",
        "of three normal values it scatters more than Bessel's formula",
    )
    words = [f"{scatter} ({one:.1f} % against {other:.1f} %)"]
    if len(there) > 1:
        low, high, *_ = judged.spread(there, SUP, 30)
        words.append(
            f"it depends on the law {_law_words(judged, there)} ({judged.of(low, SUP, 30):.2f} to "
            f"{judged.of(high, SUP, 30):.2f} sigma of 30 values)"
        )
    return (
        "As an estimator of a standard uncertainty the grey method is Peters' and Downton's under other names: "
        f"{listed(words)}. With a factor of 2 and no degrees of freedom its interval for the mean of three "
        f"{_too_small(judged)}."
    )


def _too_small(judged: Judged) -> str:
    covered, u = (judged.of("normal", SUP, 3, key) for key in ("mean_covered_2", "u_mean_covered_2"))
    words = chosen(covered - 0.95 - SURE * u, covered - 0.95 + SURE * u, "is too small", "is right", "is too large")
    return f"{words}: it holds the truth in {100 * covered:.0f} of 100 cases"


def _law_words(judged: Judged, there: list[str]) -> str:
    """More, less, or not to be told: how the largest gap depends on the law beside Bessel's formula."""
    (*_, one, u_one), (*_, other, u_other) = (judged.spread(there, name, 30) for name in (SUP, BESSEL))
    wide = SURE * float(np.hypot(u_one, u_other))
    return chosen(
        one - other - wide, one - other + wide, "less than Bessel's formula does",
        "no more and no less than Bessel's formula as far as can be told", "more than Bessel's formula does",
    )  # fmt: skip


def _of_normal_values(judged: Judged, there: list[str]) -> list[str]:
    if "normal" not in there:
        return []
    sizes = (3, 5, 10)

    def given(estimator: str) -> list[float]:
        return [judged.of("normal", estimator, n) for n in sizes]

    words = {chosen(*judged.off("normal", SUP, BESSEL, n), "below", "", "above") for n in sizes}
    optimistic = {
        "below": "of small samples the largest gap is the more optimistic of the two",
        "above": "of small samples Bessel's is the more optimistic of the two",
    }.get(words.pop() if len(words) == 1 else "", "which is the more optimistic cannot be told of all three")
    off = max(abs(x - 1) / judged.of("normal", SUM, n, "u_mean_ratio") for x, n in zip(given(SUM), sizes, strict=True))
    unbiased = "shows no bias there" if off < SURE else "is not free of bias there either"
    sup, sums, bessel = (given(name) for name in SHOWN)
    scatters = [100 * judged.of("normal", name, 3, "scatter") for name in SHOWN]
    miracle = chosen(
        *judged.off("normal", SUP, BESSEL, 3, "scatter"), "Of three values the largest gap is the steadier one",
        "There is no small-sample miracle", "There is no small-sample miracle",
    )  # fmt: skip
    of_five = 100 * judged.of("normal", SUP, 5, "mean_covered_2")
    return [
        f"On the mean the largest gap gives {sup[0]:.3f} sigma of 3 normal values, {sup[1]:.3f} of 5 and {sup[2]:.3f} "
        f"of 10 (Bessel: {bessel[0]:.3f}, {bessel[1]:.3f}, {bessel[2]:.3f}): {optimistic}. The sum of gaps "
        f"{unbiased} ({sums[0]:.3f}, {sums[1]:.3f}, {sums[2]:.3f}).",
        f"{miracle}: of 3 normal values the three estimators scatter by {scatters[0]:.1f}, {scatters[1]:.1f} and "
        f"{scatters[2]:.1f} % of themselves (largest gap, sum, Bessel).",
        "A mean of 3 normal values plus or minus twice the grey uncertainty over sqrt(3), without degrees of "
        f"freedom, {_too_small(judged)}; of 5 values in {of_five:.0f}. With the factor made for its own scatter it "
        f"holds it in {100 * judged.of('normal', SUP, 3, 'mean_covered_t'):.1f}, Bessel's with Student's in "
        f"{100 * judged.of('normal', BESSEL, 3, 'mean_covered_t'):.1f}.",
        "Without sorting, the same formula depends on the order of the values: on the mean it gives "
        f"{judged.of('normal', UNSORTED, 5):.3f} sigma of 5 normal values and scatters by "
        f"{100 * judged.of('normal', UNSORTED, 5, 'scatter'):.0f} % (sorted: "
        f"{100 * judged.of('normal', SUP, 5, 'scatter'):.0f} %).",
    ]


def _of_laws(judged: Judged, there: list[str], images: list[str]) -> list[str]:
    if len(there) < 2:
        return []
    ranges = []
    for name in SHOWN:
        low, high, *_ = judged.spread(there, name, 30)
        ranges.append(f"{judged.of(low, name, 30):.3f} ({low}) to {judged.of(high, name, 30):.3f} ({high})")
    behind: dict[str, list[str]] = {"less": [], "unknown": [], "more": []}
    for law in (*there, *images):
        behind[chosen(*judged.off(law, SUP, BESSEL, 10, "scatter"), "less", "unknown", "more")].append(law)
    unknown = f"; not to be told apart for {listed(behind['unknown'])}" if behind["unknown"] else ""
    return [
        f"Of 30 values of {len(there)} laws the largest gap gives {ranges[0]} sigma, the sum of gaps {ranges[1]}, "
        f"Bessel's formula {ranges[2]}: it depends on the law {_law_words(judged, there)}. From the one law to the "
        f"other it changes by {judged.spread(there, SUP, 10)[2]:.3f} at 10 values and "
        f"{judged.spread(there, SUP, 30)[2]:.3f} at 30.",
        f"At n = 10 the largest gap scatters less than Bessel for {listed(behind['less']) or 'none of the laws'}, and "
        f"more for {listed(behind['more']) or 'none'}{unknown}.",
    ]


def _of_real_errors(row: dict[str, Any]) -> str:
    """What a description of real centre errors says, held against normal errors of the same shape."""
    tails = chosen(
        row["excess kurtosis"] - row["normal kurtosis, high"], row["excess kurtosis"] - row["normal kurtosis, low"],
        "lighter tails than these have", "so they cannot be told from them by this", "heavier tails than these have",
    )  # fmt: skip
    words = (
        f"Real centre errors, {row['errors']}: excess kurtosis {row['excess kurtosis']:+.2f} (95 % of normal errors of "
        f"the same shape: {row['normal kurtosis, low']:+.2f} to {row['normal kurtosis, high']:+.2f}), {tails}; "
        f"{row['n']} of them give {row['largest gap']:.3f} sigma by the largest gap, {row['sum of gaps']:.3f} by the "
        f"sum, {row['Bessel']:.3f} by Bessel (normal ones alike: {row['normal largest gap']:.3f}, "
        f"{row['normal sum of gaps']:.3f}, {row['normal Bessel']:.3f})."
    )
    if row["kind"] != DOT:
        return words
    if row["bias is seen"]:
        return (
            f"{words} A dot's own bias is {row['bias over scatter']:.2f} of this scatter (what chance adds to it is "
            "taken away), and no estimator sees it in repeated images."
        )
    return f"{words} A bias of single dots cannot be told from nothing in so many images."


def errors_of(shots: pd.DataFrame) -> dict[str, np.ndarray]:
    """Centre errors (exposures, coordinates) in px by centroid estimator, all x before all y.

    Dots that were not measured in every exposure are left out.
    """
    found: dict[str, np.ndarray] = {}
    for centroid, own in shots.groupby("centroid") if len(shots) else ():
        wide = own.pivot(index="exposure", columns=["station", "mark"], values=["error_x_px", "error_y_px"])
        errors = wide.dropna(axis=1).to_numpy(float)
        if len(errors) >= FEWEST and errors.shape[1] >= BATCHES:
            found[NAMED.get(str(centroid), str(centroid))] = errors
    return found


def populations(errors: np.ndarray) -> dict[str, list[np.ndarray]]:
    """Errors (exposures, coordinates) as populations to draw from: a dot's coordinate over all exposures; all dots'
    coordinates of an exposure, x and y by themselves, for a sample is of one coordinate."""
    half = errors.shape[1] // 2
    return {DOT: list(errors.T), IMAGE: [part for row in errors for part in (row[:half], row[half:])]}


def normal_like(errors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Normal errors of the same shape, scatter and bias."""
    scatter, bias = _scatter_and_bias(errors)
    return scatter * rng.normal(size=errors.shape) + bias * rng.normal(size=errors.shape[1])


def _scatter_and_bias(errors: np.ndarray) -> tuple[float, float]:
    """Scatter of a dot's coordinate over exposures, and the dots' biases without what chance adds to means of m."""
    square = errors.var(axis=0, ddof=1).mean()
    return float(np.sqrt(square)), float(np.sqrt(max((errors.mean(axis=0) ** 2).mean() - square / len(errors), 0)))


def shape(groups: list[np.ndarray]) -> tuple[float, float, float]:
    """Skewness and excess kurtosis, free of bias for normal values, and the largest gap over sigma of populations
    (k, m), as means over them."""
    values = np.array([group for group in groups if group.std() > 0])
    gap = sup_norm_uncertainty(values) / values.std(axis=1)
    return (
        float(skew(values, axis=1, bias=False).mean()), float(kurtosis(values, axis=1, bias=False).mean()),
        float(gap.mean()),
    )  # fmt: skip


def _described(name: str, errors: np.ndarray, judged: Judged, count: int) -> list[dict[str, Any]]:
    rng = generator(0, f"grey normal errors/{name}")
    alike = [populations(normal_like(errors, rng)) for _ in range(ALIKE)]
    scatter, bias = _scatter_and_bias(errors)
    m, k = errors.shape
    rows = []
    for kind, groups in populations(errors).items():
        shapes = np.array([shape(some[kind]) for some in alike])
        low, high = np.quantile(shapes, [0.025, 0.975], axis=0)
        skewness, excess, gap = shape(groups)
        law, n = f"{kind} ({name})", TYPICAL[kind]
        pooled = population_draw([group for some in alike[:POOLED] for group in some[kind]])
        normal = Judged(pd.DataFrame(judge(f"normal like {law}", pooled, n, count)))
        row: dict[str, Any] = {
            "errors": law, "kind": kind, "populations": len(groups), "values in each": len(groups[0]),
            "scatter": scatter, "bias": bias, "bias over scatter": bias / scatter,
            # Of dots without bias, m mean^2 / s^2 is 1 on the mean of k coordinates, with a scatter of sqrt(2 / k).
            "bias is seen": bool(m * (bias / scatter) ** 2 > SURE * np.sqrt(2 / k)), "skewness": skewness,
            "excess kurtosis": excess, "normal kurtosis, low": float(low[1]), "normal kurtosis, high": float(high[1]),
            "gap of all": gap, "normal gap, low": float(low[2]), "normal gap, high": float(high[2]), "n": n,
        }  # fmt: skip
        for key, estimator in (("largest gap", SUP), ("sum of gaps", SUM), ("Bessel", BESSEL)):
            row[key] = judged.of(law, estimator, n)
            row[f"normal {key}"] = normal.of(f"normal like {law}", estimator, n)
        rows.append(row)
    return rows


def _tables(judged: pd.DataFrame, described: list[dict[str, Any]]) -> list[Table]:
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
    if described:
        frame = pd.DataFrame([{
            "errors": row["errors"], "populations": row["populations"], "values in each": row["values in each"],
            "scatter, px": f"{row['scatter']:.5f}" if row["kind"] == DOT else "",
            "bias, px": f"{row['bias']:.5f}" if row["kind"] == DOT else "", "skewness": f"{row['skewness']:+.2f}",
            "excess kurtosis": f"{row['excess kurtosis']:+.2f}",
            "normal ones": f"{row['normal kurtosis, low']:+.2f} to {row['normal kurtosis, high']:+.2f}",
            "largest gap of all, over sigma": f"{row['gap of all']:.3f}",
            "of normal ones": f"{row['normal gap, low']:.3f} to {row['normal gap, high']:.3f}",
        } for row in described])  # fmt: skip
        tables.append(Table(
            "Centre errors of the rendered scene", frame,
            "Errors against the truth, one coordinate. Skewness and kurtosis are free of bias for normal values, and "
            f"the bias is without what chance adds to a mean. Beside them, where 95 % of {ALIKE} sets of normal errors "
            "of the same shape lie: as many dots and images, the same scatter, normal biases of dots.",
        ))  # fmt: skip
    return tables


def _plots(judged: pd.DataFrame) -> list[Plot]:
    keys = ["law", "estimator", "n", "mean_ratio", "u_mean_ratio", "scatter", "u_scatter", "mean_covered_2",
            "u_mean_covered_2", "mean_covered_t", "u_mean_covered_t"]  # fmt: skip
    data = judged[judged["estimator"].isin(SHOWN)][keys]
    normal = data[data["law"] == "normal"]
    plots = [
        Plot("bias", "What small samples give of sigma",
             "Estimate over sigma on the mean. Grey lines: five laws; blue and red: real centre errors.",
             data, _draw_bias, (9.5, 3.6), columns=3),
        Plot("scatter", "How much the estimates scatter, and what is covered",
             "Left: relative scatter, normal values; right: how often the mean plus or minus 2 u / sqrt(n) holds the "
             "truth.", normal, _draw_scatter, (8.2, 3.3), columns=2),
    ]  # fmt: skip
    return plots if len(normal) else plots[:1]


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
