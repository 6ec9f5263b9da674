"""`study fitting_point`: its tables, its plots and what makes it a study."""

from pathlib import Path

import pandas as pd

from testfield.study.study import Plot, Results, Study, Table
from testfield_studies.fitting_point.experiment import SCALE_ERROR, cases
from testfield_studies.fitting_point.figures import draw_blocks, draw_chi2, draw_claims, draw_scale
from testfield_studies.fitting_point.findings import findings_of
from testfield_studies.fitting_point.renders import alike_table, render_table
from testfield_studies.fitting_point.tables import (
    THESIS,
    block_table,
    claims_table,
    hit_table,
    scale_table,
    spread_table,
    with_all_columns,
)


def read(table: pd.DataFrame) -> Results:
    """What the table of all trials says; of what has no rows yet, nothing."""
    table = with_all_columns(table)
    right, wrong = table[table["bar"] == "right"], table[table["bar"] == "wrong"]
    return Results(
        findings_of(right, wrong),
        [table for table in _tables(right, wrong) if len(table.frame)],
        [plot for plot in _plots(right, wrong) if len(plot.data)],
    )


def _tables(right: pd.DataFrame, wrong: pd.DataFrame) -> list[Table]:
    hits, spread, scale = hit_table(right), spread_table(right), scale_table(wrong)
    renders, alike = render_table(right), alike_table(right)
    return [
        Table(
            "Biases within their 95 % limit",
            hits,
            "Bias: measured vertex minus fitted point, with its claimed "
            "covariance. Accepted are counts that true claims give in 99 cases of 100, were all trials independent. "
            "NEES: mean chi-squared of three components over three; 1 where claims are true, more where they are "
            "too bold.",
            {"share": "{:.3f}", "NEES of the bias": "{:.2f}", "NEES of the fitted point": "{:.2f}"},
        ),
        Table(
            "Render by render",
            renders,
            "The same with weights and claim of the full covariance. Trials of one "
            "render share what light, lens and detector do alike in every exposure, and are independent given that. "
            "Bias: mean over a render's trials with its standard error.",
            {name: _form(name) for name in renders.columns[4:]},
        ),
        Table(
            "Do the renders differ?",
            alike,
            "Tests of whether all renders have the same share of biases within their limit, and the same mean bias.",
            {"chi-squared": "{:.1f}", "p": "{:.2g}"},
        ),
        Table(
            "What is claimed and what is",
            spread,
            "Root mean squares over all trials and the three axes, µm. "
            "s_sys is not divided by the number of end points; the dispersion is. Mean residual: known minus "
            "measured lengths over the known ones, mean of a trial's; its mean and root mean square over the "
            "trials, ppm.",
            {name: "{:+.1f}" if name == "mean residual, ppm" else "{:.1f}" for name in spread.columns[2:]},
        ),
        Table(
            f"A scale bar that is wrong by {1e6 * SCALE_ERROR:.0f} ppm",
            scale.drop(columns="flags"),
            "Bias: mean "
            "over the trials and what the closed form foretells, mm. Flagged: trials with a bias beyond its 95 % "
            "limit, and with a mean relative residual beyond its own.",
            {
                "bias_mm": "{:.3f}",
                "predicted_mm": "{:.3f}",
                "flagged": "{:.2f}",
                "residual_ppm": "{:+.0f}",
                "flagged_by_residual": "{:.2f}",
            },
        ),
    ]


def _form(column: str) -> str:
    """How a column of the table of renders is written: its share, its mean biases, and their standard errors."""
    return "{:.3f}" if column == "share" else "{:+.1f}" if column.startswith("bias") else "{:.1f}"


def _plots(right: pd.DataFrame, wrong: pd.DataFrame) -> list[Plot]:
    blocks, claims = block_table(right), claims_table(right)
    return [
        Plot(
            "bias_chi2",
            "Biases over their claimed covariance",
            "Of true claims they follow the line; beyond the dashed limit lie 5 %.",
            right[["layout", "way", "bias_chi2"]].dropna(),
            draw_chi2,
            (7.2, 3.4),
            columns=2,
        ),
        Plot(
            "blocks_of_88",
            f"{THESIS} points, again and again",
            f"Biases beyond their 95 % limit among {THESIS} "
            "trials, one block after the other. The bands hold 99 % of the counts that a true 95 % limit gives, and "
            "darker those of a true 99 % limit; the thesis' count is 1.",
            blocks,
            draw_blocks,
            (7.2, 3.0),
        ),
        Plot(
            "scale",
            "What the layouts see of scale",
            f"A scale bar wrong by {1e6 * SCALE_ERROR:.0f} ppm: the bias of every trial (left) and the mean relative "
            "residual (right).",
            wrong[["layout", "way", "bias_x_mm", "bias_y_mm", "bias_z_mm", "mean_relative_ppm"]].dropna(),
            draw_scale,
            (7.2, 3.2),
            columns=2,
        ),
        Plot(
            "claims",
            "What ignoring the correlations does",
            "Actual over claimed variance. 1: the claim is true; more: too bold; less: too cautious.",
            claims,
            draw_claims,
            (7.2, 3.0),
        ),
    ]


STUDY = Study(
    name="fitting_point",
    title="Accuracy from distances with a common vertex",
    claim="A point fitted to known distances from measured end points tells the accuracy of a measuring system without "
    "a registration: its bias and dispersion hold their confidence level, for of 88 points one was beyond its limit.",
    rests_on=("limit_symmetric", "limit_one_sided"),
    cases=cases,
    read=read,
    conclusion=Path(__file__).with_name("conclusion.md"),
)
