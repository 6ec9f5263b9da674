"""`study fitting_point`, the findings: does the fitted point tell the accuracy, and what can it not see?"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.stats import t

from testfield.statistics.consistency import hit_band
from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule, above, below
from testfield_studies.fitting_point.experiment import LAYOUTS
from testfield_studies.fitting_point.renders import alike_table, mean_bias
from testfield_studies.fitting_point.tables import (
    AXES,
    THESIS,
    WAYS,
    block_table,
    claims_table,
    hit_table,
    scale_table,
    spread_table,
    unseen_um2,
)

UNLIKELY = 0.01
"""Renders whose differences chance makes less often than this differ."""
SPREAD = {
    "dispersion": ("dispersion", "µm"),
    "point_error": ("fitted point, actual", "µm"),
    "bias": ("bias, actual", "µm"),
    "bias_claimed": ("bias, claimed", "µm"),
    "s_sys": ("s_sys", "µm"),
    "s_sys_predicted": ("s_sys, predicted", "µm"),
    "length_claimed": ("length, claimed", "µm"),
    "mean_residual": ("mean residual, ppm", "ppm"),
    "mean_residual_rms": ("its rms", "ppm"),
    "mean_residual_claimed": ("its rms, claimed", "ppm"),
}
"""Figures of the fit with equal weights that are published together, by the column of the table in which they stand."""


def findings_of(right: pd.DataFrame, wrong: pd.DataFrame) -> list[Finding]:
    """All findings, from the trials with a right scale bar and those with a wrong one."""
    hits, claims, spread, alike = hit_table(right), claims_table(right), spread_table(right), alike_table(right)
    each: list[Callable[[str], Finding]] = [
        lambda layout: _limit(hits, layout),
        lambda layout: _alike(alike, layout),
        lambda layout: _common_bias(right, layout),
        lambda layout: _ignored(claims, layout),
        lambda layout: _cancels(claims, layout),
        lambda layout: _unseen(spread, right, layout),
    ]
    scale = scale_table(wrong)
    return [*(make(layout) for make in each for layout in LAYOUTS), _count(block_table(right)), *_scale(scale)]


def _limit(hits: pd.DataFrame, layout: str) -> Finding:
    row = _row(hits, layout, WAYS["covariance"])
    quantities = {
        "within_limit": _of(row, "within"),
        "trials": _of(row, "trials"),
        "accepted_from": _of(row, "low"),
        "accepted_to": _of(row, "high"),
        "nees_of_bias": _of(row, "NEES of the bias"),
        "nees_of_point": _of(row, "NEES of the fitted point"),
    }

    def decide(q: Quantities) -> Outcome:
        accepted = q["accepted_from"].value <= q["within_limit"].value <= q["accepted_to"].value
        return Outcome.HOLDS if accepted else Outcome.FAILS

    words = "as many biases lie within as true claims give in 99 cases of 100; fails with fewer or more"
    rule = Rule(words, ("within_limit", "accepted_from", "accepted_to"), decide)
    question = f"Do the biases of the {layout} layout hold their 95 % limit, with the full covariance?"
    return Finding(f"limit_{_key(layout)}", question, quantities, rule)


def _alike(alike: pd.DataFrame, layout: str) -> Finding:
    rows = alike[alike["layout"] == layout].set_index("what")["p"]
    quantities = {
        "p_of_hits": Quantity(float(rows.get("share of hits", np.nan))),
        "p_of_bias": Quantity(float(rows.get("mean bias", np.nan))),
    }

    def decide(q: Quantities) -> Outcome:
        least = min(quantity.value for quantity in q.values())
        return Outcome.HOLDS if least >= UNLIKELY else Outcome.FAILS

    words = f"chance makes neither difference in less than {UNLIKELY:g} of cases"
    question = f"Are all renders alike, by their share within the limit and by their mean bias ({layout})?"
    return Finding(f"alike_{_key(layout)}", question, quantities, Rule(words, tuple(quantities), decide))


def _common_bias(right: pd.DataFrame, layout: str) -> Finding:
    mean = mean_bias(right, layout)
    quantities = {"renders": Quantity(np.nan if mean is None else mean.renders)}
    for k, axis in enumerate(AXES):
        quantities[axis] = Quantity(np.nan, unit="µm")
        if mean is not None:
            far = float(t.ppf(1 - 0.025 / len(AXES), mean.renders - 1)) * mean.error_um[k]
            value = float(mean.mean_um[k])
            quantities[axis] = Quantity(value, value - far, value + far, "µm")

    def decide(q: Quantities) -> Outcome:
        differs = any(q[axis].low > 0 or q[axis].high < 0 for axis in AXES)
        return Outcome.HOLDS if differs else Outcome.OPEN

    words = "the interval of one axis, at 95 % for all three together, does not hold zero; else it is open"
    question = f"Have all exposures a bias in common that noise and certificates do not explain ({layout})?"
    return Finding(f"common_bias_{_key(layout)}", question, quantities, Rule(words, tuple(AXES), decide))


def _ignored(claims: pd.DataFrame, layout: str) -> Finding:
    quantities = {
        "point_without": _claim(claims, layout, "fitted point", "alone"),
        "point_with": _claim(claims, layout, "fitted point", "covariance"),
        "residual_without": _claim(claims, layout, "mean residual", "alone"),
    }
    question = f"Without correlations, is the claim of the fitted point too small (actual over claimed, {layout})?"
    return Finding(f"ignored_{_key(layout)}", question, quantities, above("point_without", 1))


def _cancels(claims: pd.DataFrame, layout: str) -> Finding:
    quantities = {"bias_without": _claim(claims, layout, "bias", "alone")}
    question = f"Do errors that all points share cancel in the bias (actual over claimed variance, {layout})?"
    return Finding(f"cancels_{_key(layout)}", question, quantities, below("bias_without", 1))


def _unseen(spread: pd.DataFrame, right: pd.DataFrame, layout: str) -> Finding:
    low, high = unseen_um2(right, layout)
    row = _row(spread, layout, WAYS["equal"])
    quantities = {"unseen_square": Quantity((low + high) / 2, low, high, "µm²")}
    quantities |= {name: _of(row, column, unit) for name, (column, unit) in SPREAD.items()}
    quantities["nees_of_all_points"] = Quantity(float(right["points_anees"].mean()))
    question = f"Is the fitted point off by more than its dispersion tells (equal weights, {layout})?"
    return Finding(f"unseen_{_key(layout)}", question, quantities, above("unseen_square", 0))


def _count(blocks: pd.DataFrame) -> Finding:
    first, full = blocks[blocks["block"] == 1], blocks[blocks["trials"] == THESIS]
    least = full["band_99_high"].max()
    quantities = {
        "block": Quantity(first["trials"].max()),
        "least_beyond": Quantity(first["beyond"].min()),
        "most_beyond": Quantity(first["beyond"].max()),
        "most_of_95": Quantity(first["band_high"].max()),
        "most_of_99": Quantity(first["band_99_high"].max()),
        "blocks": Quantity(len(full) or np.nan),
        "one_or_none": Quantity((full["beyond"] <= 1).sum() if len(full) else np.nan),
        "above_99": Quantity((full["beyond"] > least).sum() if len(full) else np.nan),
    }
    as_95 = first["beyond"].between(first["band_low"], first["band_high"]).all()
    as_99 = first["beyond"].between(first["band_99_low"], first["band_99_high"]).all()

    def decide(_: Quantities) -> Outcome:
        return Outcome.FAILS if not as_95 else Outcome.OPEN if as_99 else Outcome.HOLDS

    words = f"the first {THESIS} trials have as many beyond as a 95 % limit gives, and a 99 % limit does not; open "
    words += "where both give so many, fails where a 95 % limit does not"
    question = f"Does a count of {THESIS} points tell a 95 % limit from a 99 % one?"
    return Finding("count", question, quantities, Rule(words, ("least_beyond",), decide))


def _scale(scale: pd.DataFrame) -> list[Finding]:
    symmetric, one_sided = (_row(scale, layout, WAYS["equal"]) for layout in LAYOUTS)
    weighted = _row(scale, "symmetric", WAYS["covariance"])
    quantities = {
        f"{what}_{name}": _of(row, column, unit)
        for name, row in (("symmetric", symmetric), ("one_sided", one_sided))
        for what, column, unit in (
            ("flagged", "flagged", ""),
            ("bias", "bias_mm", "mm"),
            ("predicted", "predicted_mm", "mm"),
            ("residual", "residual_ppm", "ppm"),
        )
    }

    def blind(_: Quantities) -> Outcome:
        if _by_more_than_chance(symmetric):
            return Outcome.FAILS
        seen = one_sided["flags"] >= hit_band(int(one_sided["trials"]), 0.95)[0]
        return Outcome.HOLDS if seen else Outcome.OPEN

    def lost(_: Quantities) -> Outcome:
        return Outcome.HOLDS if _by_more_than_chance(weighted) else Outcome.OPEN

    words = "mirror images flag it no more often than chance flags a true scale, one side alone nearly always; fails "
    words += "where mirror images flag it more often"
    own = {"bias": _of(weighted, "bias_mm", "mm"), "predicted": _of(weighted, "predicted_mm", "mm")}
    own["flagged"] = _of(weighted, "flagged")
    return [
        Finding(
            "blind",
            "Are mirror-image end points with equal weights blind to a wrong scale?",
            quantities,
            Rule(words, ("flagged_symmetric", "flagged_one_sided"), blind),
        ),
        Finding(
            "symmetry_lost",
            "Is that blindness lost where weights differ?",
            own,
            Rule("a wrong scale is flagged more often than chance flags a true one; else open", ("flagged",), lost),
        ),
    ]


def _by_more_than_chance(row: pd.Series) -> bool:
    """Whether a true scale would be flagged less often."""
    return bool(row["flags"] > hit_band(int(row["trials"]), 0.05)[1])


def _row(table: pd.DataFrame, layout: str, way: str) -> pd.Series:
    """The row of a layout and a way to fit; NaN in every column where there is none."""
    found = table[(table["layout"] == layout) & (table["way"] == way)]
    return found.iloc[0] if len(found) else pd.Series(np.nan, index=table.columns)


def _claim(claims: pd.DataFrame, layout: str, quantity: str, way: str) -> Quantity:
    row = _row(claims[claims["quantity"] == quantity], layout, way)
    return Quantity(float(row["actual_over_claimed"]), float(row["low"]), float(row["high"]))


def _of(row: pd.Series, column: str, unit: str = "") -> Quantity:
    return Quantity(float(row[column]), unit=unit)


def _key(layout: str) -> str:
    return layout.replace("-", "_")
