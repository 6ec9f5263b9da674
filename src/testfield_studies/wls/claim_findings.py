"""Study `wls`, the findings on what claims are worth, and on errors that come again in every exposure."""

import numpy as np
import pandas as pd

from testfield.statistics.decide import Side
from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule
from testfield_studies.quantities import interval_of
from testfield_studies.wls.cells import WLS, of, tell

SYSTEMATIC = 0.2
"""By how much NEES must surely exceed 1 before a claim is called too small."""
REPEATED = ("repeated", "repeated_low", "repeated_high")


def span(values: pd.Series, name: str = "") -> dict[str, Quantity]:
    """The least and the most of a figure in all cells."""
    start = f"{name}_" if name else ""
    return {f"{start}least": Quantity(float(values.min())), f"{start}most": Quantity(float(values.max()))}


def narrow(estimated: pd.DataFrame) -> Finding:
    """Claims that know less than the sandwich beside it, all in the frame of the first board."""
    quantities: dict[str, Quantity] = {}
    for name, method, column in (
        ("blocks", WLS, "nees_narrow"),
        ("pixels", "ml", "nees_narrow"),
        ("sandwich", WLS, "nees_frame"),
    ):
        rows = of(estimated, method=method).dropna(subset=column)
        share = float((tell(rows, column) == Side.ABOVE).mean()) if len(rows) else np.nan
        quantities |= span(rows[column], name) | {f"{name}_too_small": Quantity(share)}

    def decide(q: Quantities) -> Outcome:
        own = q["sandwich_too_small"].value
        more = [q[f"{name}_too_small"].value > own for name in ("blocks", "pixels")]
        return Outcome.HOLDS if all(more) else Outcome.OPEN if any(more) else Outcome.FAILS

    words = (
        "NEES of single points is surely above 1 in a larger share of cells than under the sandwich, for blocks and "
    )
    words += "for pixels alone; fails where for neither"
    needs = ("blocks_too_small", "pixels_too_small", "sandwich_too_small")
    question = "Are claims too small that ignore what cameras share (calibration estimated)?"
    return Finding("narrow", question, quantities, Rule(words, needs, decide))


def claims(gls: pd.DataFrame, kind: str) -> Finding:
    """Whether what GLS claims of all points together is large enough."""
    quantities = {"cells": Quantity(len(gls) or np.nan)}
    quantities |= {"too_small": Quantity(int((gls["nees_low"] > 1 + SYSTEMATIC).sum()))}
    quantities |= {"surely_true": Quantity(int((gls["nees_high"] <= 1 + SYSTEMATIC).sum()))}
    quantities |= span(gls["nees"], "nees") | span(100 * gls["coverage"], "covered")
    quantities |= span(gls["frame_mm"] / gls["rmse_mm"], "frame_over_fit")

    def decide(q: Quantities) -> Outcome:
        if q["too_small"].value:
            return Outcome.FAILS
        return Outcome.HOLDS if q["surely_true"].value == q["cells"].value else Outcome.OPEN

    words = f"every interval of NEES ends below {1 + SYSTEMATIC:g}; fails where one begins above it"
    question = f"Are the claims of GLS for all points together large enough (calibration {kind})?"
    return Finding(f"claims_{kind}", question, quantities, Rule(words, ("cells",), decide))


def again(exact: pd.DataFrame) -> list[Finding]:
    """What comes again in every exposure, and whether it explains the worst cell."""
    judged = exact.dropna(subset=["repeated", "repeated_low", "repeated_high"])
    share = 100 * judged["repeated"].astype(float).clip(lower=0)
    surely = int((judged["repeated_low"] > 0).sum())
    parts = {"cells": Quantity(len(judged) or np.nan), "surely": Quantity(surely)} | span(share, "percent")
    more = exact[exact["nees_low"] > 1 + SYSTEMATIC].dropna(subset=["repeated_low", "repeated_high"])
    none = pd.Series(np.nan, index=exact.columns)
    worst = more.loc[more["nees"].idxmax()] if len(more) else none
    part = float(worst["repeated"])
    excess = {
        "nees": interval_of(worst, "nees"),
        "rmse": Quantity(1e3 * float(worst["rmse_mm"]), unit="µm"),
        "predicted": Quantity(1e3 * float(worst["predicted_mm"]), unit="µm"),
        "again": Quantity(1e3 * float(worst["rmse_mm"]) * np.sqrt(max(part, 0)), unit="µm"),
        "again_percent": interval_of(100 * worst[list(REPEATED)], "repeated"),
        "cameras": Quantity(float(worst["cameras"])),
    }
    # What scatters surely, against what is claimed to.
    least = (1 - float(worst["repeated_high"])) * (float(worst["rmse_mm_low"]) / float(worst["predicted_mm"])) ** 2
    scatters = least > 1 + SYSTEMATIC

    def comes_again(q: Quantities) -> Outcome:
        if q["again_percent"].low > 0 and not scatters:
            return Outcome.HOLDS
        return Outcome.FAILS if scatters and q["again_percent"].low <= 0 else Outcome.OPEN

    return [
        Finding(
            "again",
            "Does a part of the errors come again in every exposure (GLS, calibration exact)?",
            parts,
            Rule(
                "the interval of its share lies above zero in some cell; else it is open",
                ("cells",),
                lambda q: Outcome.HOLDS if q["surely"].value else Outcome.OPEN,
            ),
        ),
        Finding(
            "excess",
            "Where the claim is most too small, is what it lacks the same in every exposure?",
            excess,
            Rule(
                "some surely comes again, and scatter is no larger than claimed; fails where scatter alone is larger",
                ("nees", "again_percent"),
                comes_again,
            ),
        ),
    ]
