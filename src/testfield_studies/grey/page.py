"""The study of grey methods: its tables, its plots and what makes it a study."""

from pathlib import Path
from typing import Any

import pandas as pd

from testfield.study.study import Plot, Results, Study, Table
from testfield_studies.grey.design import Design, design_of
from testfield_studies.grey.factors import NAMES
from testfield_studies.grey.figures import (
    draw_agreement,
    draw_bias,
    draw_ranks,
    draw_scatter,
    draw_shares,
    draw_sweeps,
)
from testfield_studies.grey.plan import cases
from testfield_studies.grey.rankings import ANOVA, places, turned_round
from testfield_studies.grey.relation_findings import relation_findings, sweeps_of
from testfield_studies.grey.sample_findings import sample_findings
from testfield_studies.grey.small_samples import ALIKE, DOT, SHOWN, samples_of

ABOVE = ("dummy above an acting factor", "acting factors below the dummy")
"""Columns that ask for factors that act."""


def read(table: pd.DataFrame) -> Results:
    """Both halves of the claim, from the rows that there are."""
    samples, runs = samples_of(table), table[table["part"] == "runs"]
    design = sweep = None
    if len(runs):
        design, sweep = design_of(runs[runs["set"] == "design"]), sweeps_of(runs[runs["set"] == "sweep"])
    tables: list[Table] = []
    plots: list[Plot] = []
    if samples:
        tables += _sample_tables(samples.judged.rows, samples.described)
        plots += _sample_plots(samples.judged.rows)
    if design:
        tables += _design_tables(design)
        plots += _design_plots(design)
    if sweep is not None:
        tables.append(_sweep_table(sweep))
        plots.append(_sweep_plot(sweep))
    return Results([*sample_findings(samples), *relation_findings(design, sweep)], tables, plots)


def _sample_tables(judged: pd.DataFrame, described: list[dict[str, Any]]) -> list[Table]:
    sizes = [3, 5, 10, 30]
    tables = []
    for key, title, note in (
        ("mean_ratio", "Estimate over sigma, on the mean", "1 is right. Plus or minus: 95 % interval."),
        ("scatter", "Relative scatter of the estimate", "Standard deviation over mean, with its 95 % interval."),
        ("sigma_covered", "How often a 95 % interval for sigma holds it", "The interval is right for the normal law."),
        (
            "mean_covered_2",
            "How often mean plus or minus 2 u / sqrt(n) holds the truth",
            "0.95 is wanted; no degrees of freedom are used.",
        ),
        (
            "mean_covered_t",
            "How often mean plus or minus k u / sqrt(n) holds the truth",
            "k by the estimator and n, right for the normal law (Bessel: Student's t).",
        ),
    ):
        rows = []
        for (law, estimator), own in judged.groupby(["law", "estimator"], sort=False):
            by = own.set_index("n")
            cells = {f"n = {n}": f"{by.loc[n, key]:.3f} ± {1.96 * by.loc[n, f'u_{key}']:.3f}" for n in sizes}
            rows.append({"law": law, "estimator": estimator} | cells)
        tables.append(Table(title, pd.DataFrame(rows), note))
    if described:
        frame = pd.DataFrame(
            [
                {
                    "errors": row["errors"],
                    "populations": row["populations"],
                    "values in each": row["values in each"],
                    "scatter, px": f"{row['scatter']:.5f}" if row["kind"] == DOT else "",
                    "bias, px": f"{row['bias']:.5f}" if row["kind"] == DOT else "",
                    "skewness": f"{row['skewness']:+.2f}",
                    "excess kurtosis": f"{row['excess kurtosis']:+.2f}",
                    "normal ones": f"{row['normal kurtosis, low']:+.2f} to {row['normal kurtosis, high']:+.2f}",
                    "largest gap of all, over sigma": f"{row['gap of all']:.3f}",
                    "of normal ones": f"{row['normal gap, low']:.3f} to {row['normal gap, high']:.3f}",
                }
                for row in described
            ]
        )
        tables.append(
            Table(
                "Centre errors of the rendered scene",
                frame,
                "Errors against the truth, one coordinate. Skewness and kurtosis are free of bias for normal values, "
                f"and the bias is without what chance adds to a mean. Beside them, where 95 % of {ALIKE} sets of "
                "normal errors of the same shape lie: as many dots and images, the same scatter, normal biases.",
            )
        )
    return tables


def _sample_plots(judged: pd.DataFrame) -> list[Plot]:
    keys = [
        "law",
        "estimator",
        "n",
        "mean_ratio",
        "u_mean_ratio",
        "scatter",
        "u_scatter",
        "mean_covered_2",
        "u_mean_covered_2",
        "mean_covered_t",
        "u_mean_covered_t",
    ]
    data = judged[judged["estimator"].isin(SHOWN)][keys]
    normal = data[data["law"] == "normal"]
    plots = [
        Plot(
            "bias",
            "What small samples give of sigma",
            "Estimate over sigma on the mean. Grey lines: five laws; blue and red: real centre errors.",
            data,
            draw_bias,
            (9.5, 3.6),
            columns=3,
        ),
        Plot(
            "scatter",
            "How much the estimates scatter, and what is covered",
            "Left: relative scatter, normal values; right: how often the mean plus or minus 2 u / sqrt(n) holds the "
            "truth.",
            normal,
            draw_scatter,
            (8.2, 3.3),
            columns=2,
        ),
    ]
    return plots if len(normal) else plots[:1]


def _design_tables(d: Design) -> list[Table]:
    acts = bool(d.acting.any())
    summary = d.summary if acts else d.summary.drop(columns=list(ABOVE))
    offsets = d.offsets if acts else d.offsets.drop(columns="above an acting factor")
    ranks = pd.DataFrame({"factor": NAMES} | {name: places(s).astype(int) for name, s in d.score.items()})
    ranks = ranks.iloc[(-d.score[ANOVA]).argsort()].reset_index(drop=True)
    factors, orders, turned_levels = d.factors, d.orders, turned_round(d.runs)
    return [
        Table(
            "Factors",
            factors,
            "Shares of the variance of ln RMSE and total Sobol indices; low and high: "
            f"{d.drawn}. p: part of shuffles of the factor between base rows in which it explains as much. The "
            "dummy's total index is what the runs' own noise gives to every factor.",
            {"p": "{:.1e}"},
        ),
        Table("Ranks by every method", ranks, "1 is the most important; ordered by the analysis of variance."),
        Table(
            "Methods",
            summary,
            "tau: Kendall's, with the ranking of the analysis of variance; low and high: "
            f"{d.drawn}; both rankings are drawn anew, so they agree less than those of all runs."
            + (" The dummy must not stand above any factor that acts." if acts else ""),
            _there(
                summary,
                {
                    "tau": "{:+.2f}",
                    "low": "{:+.2f}",
                    "high": "{:+.2f}",
                    "tau with total Sobol": "{:+.2f}",
                    ABOVE[0]: "{:.0%}",
                    ABOVE[1]: "{:.1f}",
                },
            ),
        ),
        Table(
            "The dummy counted from another zero",
            offsets,
            "The same runs, the same dummy; Deng's degree.",
            _there(offsets, {"degree": "{:.3f}", "above an acting factor": "{:.0%}"}),
        ),
        Table(
            "Blind to sign",
            turned_levels,
            "Degrees of the levels as they are, and turned round, the highest where the lowest was.",
            {name: "{:+.3f}" for name in turned_levels.columns if name != "factor"},
        ),
        Table(
            "The same runs in other orders",
            orders,
            "Of degrees that compare steps from run to run.",
            _there(orders, {"tau, median": "{:+.2f}", ABOVE[0]: "{:.0%}"}),
        ),
    ]


def _there(frame: pd.DataFrame, formats: dict[str, str]) -> dict[str, str]:
    """Formats of those columns that a table has."""
    return {name: form for name, form in formats.items() if name in frame}


def _design_plots(found: Design) -> list[Plot]:
    ranks = pd.DataFrame(
        [
            {"factor": name, "method": method, "rank": int(rank)}
            for method, s in found.score.items()
            for name, rank in zip(NAMES, places(s), strict=True)
        ]
    )
    acts = bool(found.acting.any())
    summary = found.summary if acts else found.summary.drop(columns=list(ABOVE))
    above = "; right: share of bootstraps in which the dummy stands above an acting factor"
    return [
        Plot(
            "shares",
            "What drives accuracy",
            f"Shares of the variance of ln RMSE and total Sobol indices on the same runs; lines: {found.drawn}; "
            "dotted: the dummy's total index, the runs' own noise.",
            found.factors,
            draw_shares,
            (8.2, 3.8),
            columns=2,
        ),
        Plot(
            "ranks",
            "Ranks by every method",
            "1, dark: the most important. Factors in the order of the analysis of variance.",
            ranks,
            draw_ranks,
            (8.2, 4.2),
        ),
        Plot(
            "agreement",
            "How the methods agree, and what they make of nothing",
            f"Left: Kendall's tau with the analysis of variance; lines: {found.drawn}{above if acts else ''}.",
            summary,
            draw_agreement,
            (8.2, 3.8),
            columns=2,
        ),
    ]


def _sweep_table(sweep: pd.DataFrame) -> Table:
    formats = {name: "{:.3f}" for name in sweep.columns if name not in ("factor", "repeats")}
    formats |= {"change of ln RMSE": "{:+.2f}", "u": "{:.2f}", "u95": "{:.2f}"}
    return Table(
        "One factor at a time",
        sweep.drop(columns="repeats"),
        "As published analyses do it: a sweep of each "
        "factor, all others at their middles. Change of ln RMSE from one end to the other by a straight line, "
        "its standard uncertainty u and half its 95 % interval, from repeats at the same level; the dummy's is "
        "noise.",
        formats,
    )


def _sweep_plot(sweep: pd.DataFrame) -> Plot:
    return Plot(
        "sweeps",
        "One factor at a time",
        "Left: what each factor changes in its sweep, with 95 % intervals, the "
        "dummy's in red; right: Deng's degree of the same sweep, dotted its floor of 1/3.",
        sweep,
        draw_sweeps,
        (8.2, 3.6),
        columns=2,
    )


STUDY = Study(
    name="grey",
    title="Grey system theory: the uncertainty of small samples, and what drives accuracy",
    claim="The grey uncertainty, by a grey coefficient vector, evaluates small samples of an unknown law where "
    "statistics cannot; grey relational analysis finds which of many factors drive the accuracy of a vision "
    "measurement.",
    rests_on=("scatter", "interval", "laws", "nothing_above", "ranking"),
    cases=cases,
    read=read,
    conclusion=Path(__file__).with_name("conclusion.md"),
)
