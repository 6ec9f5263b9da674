"""Study `wls`, the findings: when weighting pays, what it costs to ignore that cameras share errors, which claims are
true."""

import numpy as np
import pandas as pd

from testfield.statistics.decide import Side
from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule, within
from testfield_studies.quantities import interval_of
from testfield_studies.wls.cells import CELL, OLS, ROW, SAME, WLS, law_holds, of, tell
from testfield_studies.wls.claim_findings import again, claims, narrow, span

FEW, MANY = 4, 8
"""Up to so many cameras are few; from so many on they are many."""
POINTS = 1000
"""So many points a cell is to have."""
KINDS = ("exact", "estimated")
SAYS = {"larger": Side.ABOVE, "smaller": Side.BELOW, "no_different": Side.SAME, "not_told": Side.OPEN}


def findings_of(found: pd.DataFrame, table: pd.DataFrame) -> list[Finding]:
    """All findings, from the cells and from the cases' rows."""
    wls = of(found, method=WLS).dropna(subset="gain")
    estimated = of(found, calibration="estimated")
    return [
        *(_few(of(wls, calibration=kind), kind) for kind in KINDS),
        *(_many(of(wls, calibration=kind), kind) for kind in KINDS),
        *(_equal(of(wls, calibration=kind), kind) for kind in KINDS),
        *_law(of(wls, calibration="exact", ranges="spread").dropna(subset=["law_noise", "law_cameras"])),
        _two_cameras(table),
        _ignoring(of(estimated, method=WLS).dropna(subset="over_gls")),
        _mostly(
            "pixels",
            "Are weights of pixels alone (ml) better than those of parametric_wls?",
            of(estimated, method=WLS).dropna(subset="over_ml"),
            "over_ml",
            "larger",
        ),
        _mostly(
            "bundle",
            "Is one adjustment of all points and cameras better than GLS, a point at a time?",
            of(estimated, method="bundle").dropna(subset="over_gls"),
            "over_gls",
            "smaller",
        ),
        *(
            _mostly(
                method,
                f"Does {method} gain against the midpoint at spread ranges?",
                of(found, method=method, ranges="spread").dropna(subset="gain"),
                "gain",
                "larger",
            )
            for method in ("dlt", "dlt_p34", "opencv")
        ),
        _mostly(
            "gls",
            "Does GLS gain against the midpoint at spread ranges (calibration estimated)?",
            of(estimated, method="gls", ranges="spread").dropna(subset="gain"),
            "gain",
            "larger",
        ),
        narrow(estimated),
        *(
            claims(of(found, calibration=kind, method="gls").dropna(subset=["nees", "coverage"]), kind)
            for kind in KINDS
        ),
        *again(of(found, calibration="exact", method="gls").dropna(subset=["nees_low", "nees"])),
        _points(found),
    ]


def tallied(rows: pd.DataFrame, name: str) -> dict[str, Quantity]:
    """In how many cells a figure is larger or smaller than 1, no different, or not told; its least and its most."""
    says = tell(rows, name)
    counts = {key: Quantity(float((says == side).sum()) if len(rows) else np.nan) for key, side in SAYS.items()}
    return {"cells": Quantity(len(rows) or np.nan)} | counts | span(rows[name])


def _few(wls: pd.DataFrame, kind: str) -> Finding:
    rows = of(wls[wls["cameras"] <= FEW], ranges="spread")

    def decide(q: Quantities) -> Outcome:
        if q["larger"].value == q["cells"].value:
            return Outcome.HOLDS
        none = q["larger"].value + q["not_told"].value == 0
        return Outcome.FAILS if none else Outcome.OPEN

    words = "the midpoint's RMSE over its own is surely larger than 1 in every cell; fails where surely not in any"
    question = f"Is parametric_wls better than the midpoint with up to {FEW} cameras at spread ranges ({kind})?"
    quantities = tallied(rows, "gain") | span(rows["gain_predicted"], "predicted")
    return Finding(f"few_{kind}", question, quantities, Rule(words, ("cells",), decide))


def _many(wls: pd.DataFrame, kind: str) -> Finding:
    rows = wls[wls["cameras"] >= MANY]
    unharmed = int(((rows["gain_low"] > 1 - SAME) & (tell(rows, "gain") != Side.BELOW)).sum())
    spread = of(rows, ranges="spread")
    quantities = tallied(rows, "gain") | {"unharmed": Quantity(unharmed)} | span(spread["gain"], "spread")
    # The claim is judged where ranges differ too: without them it is not.
    quantities["spread_cells"] = Quantity(len(spread) or np.nan)
    quantities |= span(spread["gain_predicted"], "spread_predicted")

    def decide(q: Quantities) -> Outcome:
        if q["unharmed"].value == q["cells"].value:
            return Outcome.HOLDS
        return Outcome.FAILS if 2 * q["smaller"].value >= q["cells"].value else Outcome.OPEN

    words = f"in every cell the gain's interval lies above {1 - SAME:g}; fails where it is surely worse in half of them"
    question = f"Is parametric_wls not worse than the midpoint with {MANY} cameras or more ({kind})?"
    return Finding(f"many_{kind}", question, quantities, Rule(words, ("cells", "spread_cells"), decide))


def _equal(wls: pd.DataFrame, kind: str) -> Finding:
    def decide(q: Quantities) -> Outcome:
        if q["larger"].value + q["smaller"].value:
            return Outcome.FAILS
        return Outcome.OPEN if q["not_told"].value else Outcome.HOLDS

    words = f"every interval lies within {SAME:g} of 1; fails where one cell is surely better or worse"
    question = f"At equal ranges, does weighting change nothing ({kind})?"
    quantities = tallied(of(wls, ranges="equal"), "gain")
    return Finding(f"equal_{kind}", question, quantities, Rule(words, ("cells",), decide))


def _law(rows: pd.DataFrame) -> list[Finding]:
    """The law against what was found, where it is meant; and where it is not, with the most cameras."""
    meant, other = rows[law_holds(rows)], rows[~law_holds(rows) & (rows["cameras"] > 2)]
    other = other[other["cameras"] == other["cameras"].max()]

    def agrees(q: Quantities) -> Outcome:
        if q["within"].value == q["cells"].value:
            return Outcome.HOLDS
        all_off = q["cells"].value in (q["too_much"].value, q["too_little"].value)
        return Outcome.FAILS if all_off else Outcome.OPEN

    def upper(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["too_much"].value == q["cells"].value else Outcome.OPEN

    return [
        Finding(
            "law",
            "Does the law of many cameras hold where weights come to several (calibration exact)?",
            _against_law(meant),
            Rule(
                "it lies in every gain's interval; fails where in all cells too large or too small", ("cells",), agrees
            ),
        ),
        Finding(
            "law_of_few",
            "Where weights come to few cameras, is the law an upper figure only?",
            _against_law(other),
            Rule("it lies above every gain's interval; else it is open", ("cells",), upper),
        ),
    ]


def _against_law(rows: pd.DataFrame) -> dict[str, Quantity]:
    above, below = rows["law_noise"] > rows["gain_high"], rows["law_noise"] < rows["gain_low"]
    return {
        "cells": Quantity(len(rows) or np.nan),
        "within": Quantity(int((~above & ~below).sum())),
        "too_much": Quantity(int(above.sum())),
        "too_little": Quantity(int(below.sum())),
        "cameras": Quantity(float(rows["cameras"].max())),
        **span(rows["law_noise"], "law"),
        **span(rows["gain"], "gain"),
        **span(rows["gain_predicted"], "predicted"),
        **span(rows["law_cameras"], "equal_cameras"),
        **span(rows["law_ranges"], "law_of_ranges"),
    }


def _two_cameras(table: pd.DataFrame) -> Finding:
    """With two cameras there is one redundant observation, square to the plane of both rays."""
    names = ["square_mm2", "square_normal_mm2", "claimed_normal_mm2"]
    across = promised = inside = np.nan
    if {*names, "method"} <= {*table.columns}:
        two = of(table[table["points"] > 0], cameras=2, calibration="exact", ranges="spread")
        both = [of(two, method=method).set_index(ROW)[names] for method in (OLS, WLS)]
        shared = both[0].index.intersection(both[1].index)
        if len(shared):
            ols, wls = (part.loc[shared].sum() for part in both)
            across = np.sqrt(ols["square_normal_mm2"] / wls["square_normal_mm2"])
            promised = np.sqrt(ols["claimed_normal_mm2"] / wls["claimed_normal_mm2"])
            left = [part["square_mm2"] - part["square_normal_mm2"] for part in (ols, wls)]
            inside = np.sqrt(left[0] / left[1])
    quantities = {
        "gain_across": Quantity(float(across)),
        "gain_across_predicted": Quantity(float(promised)),
        "gain_in_plane": Quantity(float(inside)),
    }
    rule = within("gain_in_plane", 1 - SAME, 1 + SAME)
    question = "With two cameras, lies all gain square to the plane of both rays (calibration exact, spread ranges)?"
    return Finding("two_cameras", question, quantities, rule)


def _ignoring(wls: pd.DataFrame) -> Finding:
    quantities = tallied(wls, "over_gls") | {"worst": _worst(wls, "over_gls")}

    def decide(q: Quantities) -> Outcome:
        if q["larger"].value:
            return Outcome.HOLDS
        return Outcome.OPEN if q["not_told"].value else Outcome.FAILS

    words = "the RMSE over that of GLS is surely larger than 1 in some cell; fails where surely in none"
    question = "Does ignoring that cameras share errors cost accuracy (parametric_wls over GLS, calibration estimated)?"
    return Finding("ignoring", question, quantities, Rule(words, ("cells",), decide))


def _mostly(name: str, question: str, rows: pd.DataFrame, figure: str, better: str) -> Finding:
    worse = "smaller" if better == "larger" else "larger"

    def decide(q: Quantities) -> Outcome:
        off = q[better].value - q[worse].value
        return Outcome.HOLDS if off > 0 else Outcome.FAILS if off < 0 else Outcome.OPEN

    words = f"the ratio is surely {better} than 1 in more cells than it is surely {worse}; fails in the other case"
    return Finding(name, question, tallied(rows, figure), Rule(words, ("cells",), decide))


def _worst(rows: pd.DataFrame, name: str) -> Quantity:
    if rows.empty:
        return Quantity(np.nan)
    return interval_of(rows.loc[rows[name].idxmax()], name)


def _points(found: pd.DataFrame) -> Finding:
    quantities = span(found["points"], "points")
    quantities["exposures"] = Quantity(float(found["exposures"].max()))
    quantities["thin_cells"] = Quantity(len(found[found["points"] < POINTS].drop_duplicates(CELL)))
    quantities["cells"] = Quantity(len(found.drop_duplicates(CELL)))

    def decide(q: Quantities) -> Outcome:
        return Outcome.FAILS if q["thin_cells"].value else Outcome.HOLDS

    question = f"Has every cell {POINTS:,} points?"
    return Finding("points", question, quantities, Rule("no cell has fewer", ("points_least",), decide))
