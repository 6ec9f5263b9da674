"""What the study on stitched boards found."""

import numpy as np
import pandas as pd

from testfield.study.stitching_figures import draw_chain, draw_counts, draw_coverage, draw_faults
from testfield.study.stitching_plan import CHAIN, LONG_CHAIN, cases
from testfield.study.stitching_scenes import PITCH_MM
from testfield.study.stitching_summary import counts_of, cuts_of, faults_of, figures_of, links_of, named
from testfield.study.stitching_words import sentences, verdict
from testfield.study.study import Findings, Plot, Study, Table

CLAIM = (
    "Small two-dimensional boards, placed freely and joined through their coded targets, make one large virtual board: "
    "they are stitched without errors, and calibrate a camera as a full-size board would."
)


def read(table: pd.DataFrame) -> Findings:
    """Verdict, answers, tables and figures from the rows of the cases."""
    fields = named(table[table["experiment"] != "chain"])
    counts, cuts, faults = counts_of(fields), cuts_of(fields), faults_of(fields)
    links = links_of(table[table["experiment"] == "chain"])
    figures = figures_of(counts, cuts, faults, links, table)
    short, long = links[links["boards"] == CHAIN], links[links["boards"] == LONG_CHAIN]
    everywhere = counts[counts["quantity"] == "corner_px"].rename(columns={"target": "name"})
    plots = [
        Plot("stitching_counts", "How many boards, and against whom",
             "Medians over worlds; bars are the medians' 95 % intervals (of fewer than six worlds, their range). Lines "
             "and full marks: pixels drawn at the physical bound. Open marks, and ChArUco: rendered images. "
             "Horizontal: one board shown all over the image from close by.", counts, draw_counts, (9.6, 4.2), 2),
        Plot("stitching_chain", "How errors grow along a chain",
             f"Boards of a row {PITCH_MM:.0f} mm apart; bars are 95 % intervals of the rms. The law takes the scatter "
             "of links from the same worlds and knows nothing of the boards' print errors.",
             short, draw_chain, (9.6, 7.2), 2, 2),
        Plot("stitching_faults", "Bent boards, and boards with a scale of their own",
             "Six planned boards, whose sheets know nothing of it. The full-size board is bent with the same "
             "curvature, so its bow is 25 times as large. Open marks: rendered "
             "images.", faults, draw_faults, (9.6, 3.8), 2),
        Plot("stitching_coverage", "How much of the image must be covered",
             "Left: twelve planned boards, observations outside the middle of the image left out, against as many "
             "drawn from all over it. Right: every field of the study, drawn pixels.",
             pd.concat([cuts.assign(what="cut"), everywhere[everywhere["evidence"] == "drawn"].assign(what="field")]),
             draw_coverage, (9.6, 3.8), 2),
    ]  # fmt: skip
    if len(long):
        title, caption = f"The same with {LONG_CHAIN} boards", "As above; drawn pixels only."
        plots.insert(2, Plot("stitching_long_chain", title, caption, long, draw_chain, (9.6, 7.2), 2, 2))
    there = {"stitching_chain": links, "stitching_faults": faults, "stitching_coverage": cuts}
    plots = [plot for plot in plots if len(there.get(plot.name, counts))]
    return Findings(verdict(figures), sentences(figures), _tables(counts, links, faults, cuts), plots, figures)


def _tables(counts: pd.DataFrame, links: pd.DataFrame, faults: pd.DataFrame, cuts: pd.DataFrame) -> list[Table]:
    rows = []
    for (target, boards, evidence), part in counts.groupby(["target", "boards", "evidence"]):
        first = part.iloc[0]
        row = {"target": target, "boards": boards, "evidence": evidence, "worlds": first["worlds"],
               "coverage %": 100 * first["coverage"]}  # fmt: skip
        for quantity, title in (
            ("corner_px", "corner, px"),
            ("check_rmse_mm", "check points, mm"),
            ("mother_rms_mm", "mother board, mm"),
        ):
            here = part[part["quantity"] == quantity]
            row[title] = _interval(here.iloc[0]) if len(here) else "–"
        rows.append(row | {"s0": first["sigma0"], "NEES camera": first["interior_nees"],
                           "NEES boards": first["boards_nees"], "NEES check": first["check_nees"]})  # fmt: skip
    last = links[links["links"] == links["boards"] - 1]
    chain = last.drop(columns="links").assign(
        **{name: 1e3 * last[name] for name in ("rms_mm", "low_mm", "high_mm", "claimed_mm", "law_mm", "law_shared_mm",
                                                "shift_mm", "mother_rms_mm")}
    ).rename(columns=lambda name: name.replace("_mm", ", µm") if name != "print_mm" else "print, mm")  # fmt: skip
    return [
        Table("All fields", pd.DataFrame(rows), "Medians [95 % interval, of fewer than six worlds their range]; NEES: "
              "means per degree of freedom, 1 where the claims are true.", {"coverage %": "{:.0f}", "s0": "{:.3f}"}),
        Table("The last board of each chain", chain, "rms over worlds of its error out of the plane and upwards."),
        Table("Bent boards and own scales", faults, "median, low, high: error at the corners, px."),
        Table("Observations confined to a part of the image", cuts, "median, low, high: error at the corners, px."),
    ]  # fmt: skip


def _interval(row: pd.Series) -> str:
    if not np.isfinite(row["median"]):
        return "beyond all"
    return f"{row['median']:.3g} [{row['low']:.3g}, {row['high']:.3g}]"


STUDY = Study("stitching", "The flexible stitched board", CLAIM, cases, read)
