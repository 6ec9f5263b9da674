"""`study fitting_point`, the findings: does the fitted point tell the accuracy, and what can it not see?"""

from typing import Any

import pandas as pd

from testfield_studies.fitting_point.experiment import LAYOUTS, SCALE_ERROR, cases
from testfield_studies.fitting_point.figures import draw_blocks, draw_chi2, draw_claims, draw_scale
from testfield_studies.fitting_point.renders import alike_table, mean_bias, render_table
from testfield_studies.fitting_point.tables import (
    THESIS,
    WAYS,
    block_table,
    claims_table,
    hit_table,
    scale_table,
    spread_table,
    unseen_um2,
    with_all_columns,
)
from testfield_studies.fitting_point.words import blind, row_of, sentences, verdict
from testfield.study.study import Findings, Plot, Study, Table


def read(table: pd.DataFrame) -> Findings:
    """What the table of all trials says; of what has no rows yet, nothing."""
    table = with_all_columns(table)
    right, wrong = table[table["bar"] == "right"], table[table["bar"] == "wrong"]
    hits, blocks, spread, claims = hit_table(right), block_table(right), spread_table(right), claims_table(right)
    scale, alike = scale_table(wrong), alike_table(right)
    means = {layout: mean_bias(right, layout) for layout in LAYOUTS}
    unseen = {layout: unseen_um2(right, layout) for layout in LAYOUTS}
    return Findings(
        verdict(hits, blocks, scale, right["seed"][right["layout"].notna()].nunique()),
        sentences(hits, blocks, claims, spread, scale, alike, means, unseen),
        [table for table in _tables(hits, spread, scale, render_table(right), alike) if len(table.frame)],
        [plot for plot in _plots(right, wrong, blocks, claims) if len(plot.data)],
        _figures(right, hits, blocks, spread, scale, alike),
    )


def _tables(
    hits: pd.DataFrame, spread: pd.DataFrame, scale: pd.DataFrame, renders: pd.DataFrame, alike: pd.DataFrame
) -> list[Table]:
    return [
        Table("Biases within their 95 % limit", hits, "Bias: measured vertex minus fitted point, with its claimed "
              "covariance. Accepted are counts that true claims give in 99 cases of 100, were all trials independent. "
              "NEES: mean chi-squared of three components over three; 1 where claims are true, more where they are "
              "too bold.",
              {"share": "{:.3f}", "NEES of the bias": "{:.2f}", "NEES of the fitted point": "{:.2f}"}),
        Table("Render by render", renders, "The same with weights and claim of the full covariance. Trials of one "
              "render share what light, lens and detector do alike in every exposure, and are independent given that. "
              "Bias: mean over a render's trials with its standard error.",
              {name: _form(name) for name in renders.columns[4:]}),
        Table("Do the renders differ?", alike, "Tests of whether all renders have the same share of biases within "
              "their limit, and the same mean bias.",
              {"chi-squared": "{:.1f}", "p": "{:.2g}"}),
        Table("What is claimed and what is", spread, "Root mean squares over all trials and the three axes, µm. "
              "s_sys is not divided by the number of end points; the dispersion is. Mean residual: known minus "
              "measured lengths over the known ones, mean of a trial's; its mean and root mean square over the "
              "trials, ppm.",
              {name: "{:+.1f}" if name == "mean residual, ppm" else "{:.1f}" for name in spread.columns[2:]}),
        Table(f"A scale bar that is wrong by {1e6 * SCALE_ERROR:.0f} ppm", scale.drop(columns="flags"), "Bias: mean "
              "over the trials and what the closed form foretells, mm. Flagged: trials with a bias beyond its 95 % "
              "limit, and with a mean relative residual beyond its own.",
              {"bias_mm": "{:.3f}", "foretold_mm": "{:.3f}", "flagged": "{:.2f}", "residual_ppm": "{:+.0f}",
               "flagged_by_residual": "{:.2f}"}),
    ]  # fmt: skip


def _form(column: str) -> str:
    """How a column of the table of renders is written: its share, its mean biases, and their standard errors."""
    return "{:.3f}" if column == "share" else "{:+.1f}" if column.startswith("bias") else "{:.1f}"


def _plots(right: pd.DataFrame, wrong: pd.DataFrame, blocks: pd.DataFrame, claims: pd.DataFrame) -> list[Plot]:
    return [
        Plot("bias_chi2", "Biases over their claimed covariance", "Of true claims they follow the line; beyond the "
             "dashed limit lie 5 %.", right[["layout", "way", "bias_chi2"]].dropna(), draw_chi2, (7.2, 3.4), columns=2),
        Plot("blocks_of_88", f"{THESIS} points, again and again", f"Biases beyond their 95 % limit among {THESIS} "
             "trials, one block after the other. The bands hold 99 % of the counts that a true 95 % limit gives, and "
             "darker those of a true 99 % limit; the thesis' count is 1.", blocks, draw_blocks, (7.2, 3.0)),
        Plot("scale", "The blind layout" if blind(scale_table(wrong)) else "What the layouts see of scale",
             f"A scale bar wrong by {1e6 * SCALE_ERROR:.0f} ppm: the bias of every trial (left) and the mean relative "
             "residual (right).",
             wrong[["layout", "way", "bias_x_mm", "bias_y_mm", "bias_z_mm", "mean_relative_ppm"]].dropna(), draw_scale,
             (7.2, 3.2), columns=2),
        Plot("claims", "What ignoring the correlations does", "Actual over claimed variance. 1: the claim is true; "
             "more: too bold; less: too cautious.", claims, draw_claims, (7.2, 3.0)),
    ]  # fmt: skip


def _figures(
    right: pd.DataFrame, hits: pd.DataFrame, blocks: pd.DataFrame, spread: pd.DataFrame, scale: pd.DataFrame,
    alike: pd.DataFrame,
) -> dict[str, Any]:  # fmt: skip
    own = hits[hits["way"] == WAYS["covariance"]]
    found: dict[str, Any] = {
        "trials": int(own["trials"].min()) if len(own) else 0,
        "renders": right["seed"][right["layout"].notna()].nunique(),
        "accepted": len(own) == len(LAYOUTS) and bool(own["accepted"].all()),
        **{f"within_{row.layout}_{key}": int(row.within) for key, way in WAYS.items()
           for row in hits[hits["way"] == way].itertuples()},
        **{f"beyond_of_{row.trials}_{row.layout}": int(row.beyond)
           for row in blocks[blocks["block"] == 1].itertuples()},
    }  # fmt: skip
    for layout in LAYOUTS:
        if (row := row_of(scale, layout, "equal")) is not None:
            found[f"scale_flagged_{layout.replace('-', '_')}"] = float(row["flagged"])
    for row in alike.itertuples():
        found[f"renders_alike_p_{row.what.replace(' ', '_')}_{row.layout}"] = float(row.p)
    for layout in LAYOUTS:
        if (row := row_of(spread, layout, "equal")) is not None:
            found |= {f"{key}_{layout}": float(row[column]) for key, column in BESIDE.items()}
    if len(right):
        found["points_anees"] = float(right["points_anees"].mean())
    return found


BESIDE = {
    "dispersion_um": "dispersion", "bias_um": "bias, actual", "bias_claimed_um": "bias, claimed", "s_sys_um": "s_sys",
    "s_sys_foretold_um": "s_sys, foretold", "mean_residual_ppm": "mean residual, ppm",
    "mean_residual_rms_ppm": "its rms", "mean_residual_claimed_ppm": "its rms, claimed",
}  # fmt: skip
"""Figures of the fit with equal weights that are published together, by the column they stand in."""

STUDY = Study(
    "fitting_point",
    "Accuracy from distances with a common vertex",
    "A point fitted to known distances from measured end points tells the accuracy of a measuring system without a "
    "registration: its bias and dispersion hold their confidence level, for of 88 points one was beyond its limit.",
    cases,
    read,
)
