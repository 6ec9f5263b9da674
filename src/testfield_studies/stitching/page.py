"""The study on stitched boards: its plots and what makes it a study."""

from pathlib import Path

import pandas as pd

from testfield.study.study import Plot, Results, Study
from testfield_studies.stitching.chain_findings import chain_findings, fault_findings
from testfield_studies.stitching.figures import draw_chain, draw_counts, draw_coverage, draw_faults
from testfield_studies.stitching.findings import field_findings
from testfield_studies.stitching.plan import CHAIN, LONG_CHAIN, cases
from testfield_studies.stitching.scenes import PITCH_MM
from testfield_studies.stitching.summary import counts_of, cuts_of, faults_of, links_of, named, rows_of
from testfield_studies.stitching.tables import tables_of

CLAIM = (
    "Small two-dimensional boards, placed freely and joined through their coded targets, make one large virtual board: "
    "they are stitched without errors, and calibrate a camera as a full-size board would."
)


def read(table: pd.DataFrame) -> Results:
    """Findings, tables and plots from the rows of the cases that are done."""
    rows = rows_of(table)
    fields = named(rows[rows["experiment"] != "chain"])
    counts, cuts, faults = counts_of(fields), cuts_of(fields), faults_of(fields)
    links = links_of(rows[rows["experiment"] == "chain"])
    findings = [
        *field_findings(counts, cuts, rows),
        *chain_findings(links, rows),
        *fault_findings(faults, counts),
    ]
    return Results(findings, tables_of(counts, links, faults, cuts), plots_of(counts, links, faults, cuts))


def plots_of(counts: pd.DataFrame, links: pd.DataFrame, faults: pd.DataFrame, cuts: pd.DataFrame) -> list[Plot]:
    """All plots that have a row."""
    short, long = links[links["boards"] == CHAIN], links[links["boards"] == LONG_CHAIN]
    everywhere = counts[counts["quantity"] == "corner_px"].rename(columns={"target": "name"})
    plots = [
        Plot(
            "stitching_counts",
            "How many boards, and against whom",
            "Medians over worlds; bars are the medians' 95 % intervals (of fewer than six worlds, their range). Lines "
            "and full marks: pixels drawn at the physical bound. Open marks, and ChArUco: rendered images. "
            "Horizontal: one board shown all over the image from close by.",
            counts,
            draw_counts,
            (9.6, 4.2),
            2,
        ),
        Plot(
            "stitching_chain",
            "How errors grow along a chain",
            f"Boards of a row {PITCH_MM:.0f} mm apart; bars are 95 % intervals of the rms. The law takes the scatter "
            "of links from the same worlds and knows nothing of the boards' print errors.",
            short,
            draw_chain,
            (9.6, 7.2),
            2,
            2,
        ),
        Plot(
            "stitching_faults",
            "Bent boards, and boards with a scale of their own",
            "Six planned boards, whose sheets know nothing of it. The full-size board is bent with the same "
            "curvature, so its bow is 25 times as large. Open marks: rendered "
            "images.",
            faults,
            draw_faults,
            (9.6, 3.8),
            2,
        ),
        Plot(
            "stitching_coverage",
            "How much of the image must be covered",
            "Left: twelve planned boards, observations outside the middle of the image left out, against as many "
            "drawn from all over it. Right: every field of the study, drawn pixels.",
            pd.concat([cuts.assign(what="cut"), everywhere[everywhere["evidence"] == "drawn"].assign(what="field")]),
            draw_coverage,
            (9.6, 3.8),
            2,
        ),
    ]
    if len(long):
        title, caption = f"The same with {LONG_CHAIN} boards", "As above; drawn pixels only."
        plots.insert(2, Plot("stitching_long_chain", title, caption, long, draw_chain, (9.6, 7.2), 2, 2))
    there = {"counts": counts, "chain": short, "long_chain": long, "faults": faults, "coverage": cuts}
    return [plot for plot in plots if len(there[plot.name.removeprefix("stitching_")])]


STUDY = Study(
    name="stitching",
    title="The flexible stitched board",
    claim=CLAIM,
    rests_on=("method", "letter", "as_full"),
    cases=cases,
    read=read,
    conclusion=Path(__file__).with_name("conclusion.md"),
)
