"""The findings of the study of grey methods on grey relational analysis: of a design, and of sweeps."""

import numpy as np
import pandas as pd

from testfield.seeds import generator
from testfield.statistics.decide import Side, side_of
from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule, above, by_side
from testfield_studies.grey.design import FEW, Design
from testfield_studies.grey.factors import DUMMY, NAMES
from testfield_studies.grey.rankings import (
    ACTS_P,
    ANOVA,
    GREY,
    METHODS,
    RANGE,
    SPEARMAN,
    TOTAL,
    agreement,
    explained,
    places,
    reversals,
    turned_round,
)
from testfield_studies.grey.sweeps import sweep_table
from testfield_studies.quantities import of

OFTEN = 0.05
"""The dummy stands above an acting factor too often where it does so in more than this part of bootstraps."""
HIT = ("radial distortion, 1e-3", "tangential distortion, 1e-4", "half convergence, deg", "image noise, e")
"""What a published grey analysis of binocular vision found to matter most, every degree at least 0.859."""
DRAWS = 4000
ENOUGH_ROWS = f"of {FEW} base rows or more"


def relation_findings(design: Design | None, sweep: pd.DataFrame | None) -> list[Finding]:
    """All findings; without quantities where nothing of them is there."""
    makers = (_acting, _nothing_above, _ranking, _floor, _spread, _zero, _reversed, _sign, _orders)
    return [*(make(design) for make in makers), _slopes(sweep), _sweep_ranks(sweep)]


def sweeps_of(rows: pd.DataFrame) -> pd.DataFrame | None:
    """The table of sweeps by what each changes; None where a run is not there, for a sweep with a hole is none."""
    if rows.empty:
        return None
    lost = rows["lost"].fillna("") != ""
    runs = rows[~lost].groupby(["block", "base"]).size().unstack().reindex(NAMES)
    if lost.any() or runs.isna().any(axis=None) or len(np.unique(runs)) > 1 or runs.shape[1] < 3:
        return None
    table = sweep_table(rows).assign(repeats=int(runs.iloc[0, 0]))
    return table.sort_values("change of ln RMSE", key=np.abs, ascending=False).reset_index(drop=True)


def _acting(d: Design | None) -> Finding:
    quantities = {}
    if d:
        runs = d.runs
        quantities = {
            "acting": Quantity(int(d.acting.sum())),
            "factors": Quantity(len(NAMES) - 1),
            "explained": Quantity(100 * max(explained(runs), 0), unit="%"),
            "runs": Quantity(d.made),
            "lost": Quantity(d.lost),
            "left_out": Quantity(d.made - len(runs.rmse_mm)),
            "base_rows": Quantity(d.base_rows),
            "rmse_least": Quantity(1e3 * runs.rmse_mm.min(), unit="µm"),
            "rmse_most": Quantity(1e3 * runs.rmse_mm.max(), unit="µm"),
        }

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["acting"].value else Outcome.OPEN

    words = f"one has p < {ACTS_P} by shuffles and stands before the dummy in 97.5 % of bootstraps; else it is open"
    return Finding(
        "acting", "Does any factor act, by analysis of variance?", quantities, Rule(words, ("acting",), decide)
    )


def _nothing_above(d: Design | None) -> Finding:
    quantities = {}
    if d:
        share = d.by["dummy above an acting factor"]
        fooled = int((share[list(GREY)] > OFTEN).sum())
        quantities = {
            "fooled": Quantity(fooled),
            "degrees": Quantity(len(GREY)),
            "base_rows": Quantity(d.base_rows),
            "acting": Quantity(int(d.acting.sum()) or np.nan),
            "least": Quantity(100 * share[list(GREY)].min(), unit="%"),
            "most": Quantity(100 * share[list(GREY)].max(), unit="%"),
            "analysis_of_variance": Quantity(100 * share[ANOVA], unit="%"),
            "rank_correlation": Quantity(100 * share[SPEARMAN], unit="%"),
            "total_sobol": Quantity(100 * share[TOTAL], unit="%"),
        }

    def decide(q: Quantities) -> Outcome:
        if q["base_rows"].value < FEW:
            return Outcome.OPEN
        return Outcome.FAILS if q["fooled"].value else Outcome.HOLDS

    question = "Do all grey degrees keep a factor that does nothing below those that act?"
    words = f"none puts it above one in more than {OFTEN:.0%} of bootstraps, {ENOUGH_ROWS}; fails where one does"
    return Finding("nothing_above", question, quantities, Rule(words, ("fooled", "acting"), decide))


def _ranking(d: Design | None) -> Finding:
    quantities = {}
    if d:
        ends = [np.nanquantile(d.taus[name] - d.taus[SPEARMAN], [0.025, 0.975]) for name in GREY]
        sides = [side_of(*pair) for pair in ends]
        grey = d.by.loc[list(GREY), "tau"]
        quantities = {
            "better": Quantity(sides.count(Side.ABOVE)),
            "worse": Quantity(sides.count(Side.BELOW)),
            "degrees": Quantity(len(GREY)),
            "base_rows": Quantity(d.base_rows),
            "least": Quantity(grey.min()),
            "most": Quantity(grey.max()),
        }
        for name in METHODS:
            key = name.replace(" ", "_").replace(",", "")
            quantities[f"tau_{key}"] = of(d.by.loc[name], "tau", ends=("low", "high"))

    def decide(q: Quantities) -> Outcome:
        if q["base_rows"].value < FEW:
            return Outcome.OPEN
        return Outcome.HOLDS if q["better"].value else Outcome.FAILS if q["worse"].value else Outcome.OPEN

    question = (
        "Does a grey degree rank the factors more like the analysis of variance than plain rank correlation does?"
    )
    words = (
        f"the tau of one is surely larger in bootstraps, {ENOUGH_ROWS}; fails where of none, and of one surely smaller"
    )
    return Finding("ranking", question, quantities, Rule(words, ("better",), decide))


def _floor(d: Design | None) -> Finding:
    quantities = {}
    if d:
        deng = d.score["Deng"]
        dummy = deng[NAMES.index(DUMMY)]
        quantities = {
            "least": Quantity(deng.min()),
            "most": Quantity(deng.max()),
            "dummy": Quantity(dummy),
            "acting_below": Quantity(int((d.acting & (deng <= dummy)).sum())),
            "acting": Quantity(int(d.acting.sum()) or np.nan),
        }

    def decide(q: Quantities) -> Outcome:
        return Outcome.FAILS if q["acting_below"].value else Outcome.HOLDS

    question = "Does Deng's degree give every factor that acts more than it gives the dummy?"
    return Finding(
        "floor", question, quantities, Rule("no acting factor has as little", ("acting_below", "acting"), decide)
    )


def _spread(d: Design | None) -> Finding:
    quantities = {}
    if d:
        off = agreement(d.again["Deng"], -d.spread) - d.taus["Deng"]
        low, high = np.nanquantile(off, [0.025, 0.975])
        value = d.by_spread - d.by.loc["Deng", "tau"]
        quantities = {
            "difference": Quantity(value, low, high),
            "tau_with_spread": Quantity(d.by_spread),
            "tau_with_variance": Quantity(d.by.loc["Deng", "tau"]),
        }

    def decide(q: Quantities) -> Outcome:
        return by_side(side_of(q["difference"].low, q["difference"].high), Side.ABOVE)

    question = "Does Deng's ranking follow the spread of the factors' levels more than their effects?"
    words = (
        "its tau with the spread, less that with the analysis of variance, lies above zero in bootstraps; fails below"
    )
    return Finding("spread", question, quantities, Rule(words, ("difference",), decide))


def _zero(d: Design | None) -> Finding:
    quantities: dict[str, Quantity] = {}
    if d:
        for k, row in enumerate(d.offsets.to_dict("records")):
            quantities |= {f"rank_{k}": Quantity(row["rank"]), f"degree_{k}": Quantity(row["degree"])}
        quantities["rank_least"] = Quantity(d.offsets["rank"].min())
        quantities["rank_most"] = Quantity(d.offsets["rank"].max())

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["rank_least"].value < q["rank_most"].value else Outcome.FAILS

    question = "Does the rank that Deng's degree gives the dummy depend on the zero that its levels are counted from?"
    words = "the same runs give it other ranks with levels from 0, from 1 and from 10"
    return Finding("zero", question, quantities, Rule(words, ("rank_least",), decide))


def _reversed(d: Design | None) -> Finding:
    quantities = {}
    if d:
        quantities = {
            key: Quantity(len(reversals(d.runs, name))) for key, name in (("deng", "Deng"), ("by_range", RANGE))
        }

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["deng"].value + q["by_range"].value else Outcome.FAILS

    question = "Do factors change their order when a third is left out of the analysis?"
    return Finding("reversed", question, quantities, Rule("one pair does", ("deng", "by_range"), decide))


def _sign(d: Design | None) -> Finding:
    quantities = {}
    if d:
        own = turned_round(d.runs).set_index("factor").loc[NAMES[int(np.argmax(d.score[ANOVA]))]]
        names = {"deng": "Deng", "deng_turned": "Deng, turned round"}
        names |= {"t_type": "T-type", "t_type_turned": "T-type, turned round"}
        quantities = {key: Quantity(own[name]) for key, name in names.items()}

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["deng"].value * q["deng_turned"].value < 0 else Outcome.FAILS

    question = "Does Deng's degree tell more of the first factor from less of it?"
    rule = Rule("it changes its sign where the factor's levels are turned round", ("deng", "deng_turned"), decide)
    return Finding("sign", question, quantities, rule)


def _orders(d: Design | None) -> Finding:
    quantities = {}
    if d:
        taus = d.orders["tau, median"]
        quantities = {"least": Quantity(taus.min()), "most": Quantity(taus.max())}

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["least"].value > 0.9 else Outcome.FAILS

    question = "Do degrees that compare steps from run to run rank alike whatever the order of the runs?"
    return Finding(
        "orders", question, quantities, Rule("each median tau of two orders is above 0.9", ("least",), decide)
    )


def _slopes(sweep: pd.DataFrame | None) -> Finding:
    quantities = {}
    if sweep is not None and sweep["u"].notna().all():
        by = sweep.set_index("factor")
        own = by.drop(index=DUMMY)
        change, wide = by.loc[DUMMY, ["change of ln RMSE", "u95"]]
        quantities = {
            "dummy": Quantity(change, change - wide, change + wide),
            "changing": Quantity(int((own["change of ln RMSE"].abs() > own["u95"]).sum())),
            "factors": Quantity(len(own)),
            "repeats": Quantity(int(by["repeats"].iloc[0])),
        }

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["dummy"].low <= 0 <= q["dummy"].high else Outcome.FAILS

    question = "In a sweep of one factor at a time, does the dummy change ln RMSE by no more than noise?"
    return Finding("slopes", question, quantities, Rule("its interval holds zero", ("dummy",), decide))


def _sweep_ranks(sweep: pd.DataFrame | None) -> Finding:
    quantities = {}
    if sweep is not None:
        by = sweep.set_index("factor")
        deng, change = by["Deng"].to_numpy(), by["change of ln RMSE"].to_numpy()
        rank = dict(zip(by.index, places(deng), strict=True))
        tau, ends = float(agreement(deng[None], np.abs(change))[0]), (np.nan, np.nan)
        if by["u"].notna().all():
            drawn = change + by["u"].to_numpy() * generator(0, "grey slopes").normal(size=(DRAWS, len(change)))
            low, high = np.quantile(agreement(np.abs(drawn), deng), [0.025, 0.975])
            ends = float(low), float(high)
        quantities = {
            "tau": Quantity(tau, *ends),
            "dummy": Quantity(by.loc[DUMMY, "Deng"]),
            "dummy_rank": Quantity(rank[DUMMY]),
            "published_least": Quantity(by.loc[list(HIT), "Deng"].min()),
            "published_most": Quantity(by.loc[list(HIT), "Deng"].max()),
            "published_last_rank": Quantity(max(rank[name] for name in HIT)),
        }
    question = "Do Deng's degrees rank such sweeps by the size of the change of ln RMSE (Kendall's tau)?"
    return Finding("sweep_ranks", question, quantities, above("tau", 0))
