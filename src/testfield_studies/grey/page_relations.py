"""What the study of grey methods found of grey relational analysis."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from testfield_studies.grey.factors import DUMMY, NAMES
from testfield_studies.grey.figures import draw_agreement, draw_ranks, draw_shares
from testfield_studies.grey.page_sweeps import read_sweeps
from testfield_studies.grey.rankings import (
    ACTS_P,
    ANOVA,
    FIRST,
    GREY,
    METHODS,
    RANGE,
    SPEARMAN,
    TOTAL,
    Runs,
    acting_factors,
    agreement,
    anova_table,
    bootstrap,
    degrees,
    dummy_above,
    dummy_with_offset,
    explained,
    in_other_orders,
    places,
    reversals,
    sequences,
    turned_round,
)
from testfield_studies.grey.words import chosen, listed, without_units
from testfield.study.study import Findings, Plot, Table

BOOTSTRAPS, ORDERS = 400, 100
DISTURBED = ("absolute", "relative", "synthetic", "T-type", "slope", "B-type")
"""Degrees that depend on the order of the runs."""
FEWEST, FEW = 3, 10
"""Whole base rows that a design must have, and those below which bootstraps of them are no intervals."""
OFTEN = 0.05
"""The dummy stands above an acting factor too often where it does so in more than this part of bootstraps."""


def read_relations(table: pd.DataFrame) -> Findings:
    """Findings from the rows of the design's runs and of the sweeps; of what is not there, nothing is said."""
    rows = table[table["part"] == "runs"]
    if rows.empty:
        return Findings("Of grey relational analysis nothing can be said yet.", [])
    first, second = read_design(rows[rows["set"] == "design"]), read_sweeps(rows[rows["set"] == "sweep"])
    return Findings(
        first.verdict, first.sentences + second.sentences, first.tables + second.tables, first.plots + second.plots,
        first.figures | second.figures,
    )  # fmt: skip


@dataclass(frozen=True)
class Design:
    """The runs of a design's whole base rows, and all that its page needs of them; `made` and `lost` of them at all."""

    runs: Runs
    made: int
    lost: int

    @property
    def base_rows(self) -> int:
        """How many whole base rows there are."""
        return len(self.runs.rmse_mm) // (len(NAMES) + 2)

    @cached_property
    def score(self) -> dict[str, np.ndarray]:
        """(d,) scores by method."""
        return {name: method(self.runs) for name, method in METHODS.items()}

    @cached_property
    def again(self) -> dict[str, np.ndarray]:
        """(k, d) scores by method in bootstraps."""
        return bootstrap(self.runs, BOOTSTRAPS)

    @cached_property
    def tested(self) -> pd.DataFrame:
        """The analysis of variance."""
        return anova_table(self.runs)

    @cached_property
    def acting(self) -> np.ndarray:
        """(d,) which factors act."""
        return acting_factors(self.tested, self.again[ANOVA])

    @cached_property
    def taus(self) -> dict[str, np.ndarray]:
        """(k,) by method, Kendall's tau with the analysis of variance in bootstraps, of which both are drawn anew."""
        return {name: agreement(scores, self.again[ANOVA]) for name, scores in self.again.items()}

    @cached_property
    def spread(self) -> np.ndarray:
        """(d,) coefficients of variation of the factors' levels; the larger, the lower Deng's degree tends to be."""
        levels = sequences(self.runs.unit)
        return levels.std(axis=1) / levels.mean(axis=1)

    @cached_property
    def by_spread(self) -> float:
        """Kendall's tau of Deng's degrees with the levels' smallness of spread."""
        return float(agreement(self.score["Deng"][None], -self.spread)[0])

    @cached_property
    def summary(self) -> pd.DataFrame:
        """A row for each method."""
        return _summary(self)

    @cached_property
    def by(self) -> pd.DataFrame:
        """The summary by method."""
        return self.summary.set_index("method")

    @cached_property
    def offsets(self) -> pd.DataFrame:
        """The dummy with its levels counted from other zeros."""
        return dummy_with_offset(self.runs, self.acting, (0.0, 1.0, 10.0), BOOTSTRAPS // 2)

    @property
    def drawn(self) -> str:
        """What the bounds on the page are."""
        words = f"the middle 95 % of {BOOTSTRAPS} bootstraps of {self.base_rows} base rows"
        return words + (", which of so few is no 95 % interval" if self.base_rows < FEW else "")


def read_design(design: pd.DataFrame) -> Findings:
    """Findings from the rows of the design's runs."""
    if design.empty:
        return Findings("Of grey relational analysis little can be said yet: its design has not begun.", [])
    lost = design["lost"].fillna("") != ""
    found = Design(Runs.of(design[~lost]).whole(), len(design), int(lost.sum()))
    if found.base_rows < FEWEST:
        reason = str(design["lost"][lost].iloc[0]) if lost.any() else "the others' runs are not all there yet"
        none = f"Only {found.base_rows} base rows" if found.base_rows else "No base row"
        return Findings(f"{none} of the design {'are' if found.base_rows else 'is'} whole ({reason}).", [])
    turned = {name: reversals(found.runs, name) for name in ("Deng", RANGE)}
    orders, turned_levels = _orders(found), turned_round(found.runs)
    factors = _factors(found)
    ranks = pd.DataFrame({"factor": NAMES} | {name: places(s).astype(int) for name, s in found.score.items()})
    ranks = ranks.iloc[np.argsort(-found.score[ANOVA])].reset_index(drop=True)
    acts = bool(found.acting.any())
    figures: dict[str, Any] = {
        "runs": found.made, "lost runs": found.lost, "whole base rows": found.base_rows,
        "acting factors": [NAMES[k] for k in np.flatnonzero(found.acting)],
        "explained by single factors": explained(found.runs),
        "tau with analysis of variance": found.by["tau"].to_dict(),
        "Deng's lowest degree": float(found.score["Deng"].min()),
        "tau of Deng with the spread of levels": found.by_spread,
    }  # fmt: skip
    if acts:
        figures["dummy above an acting factor, share of bootstraps"] = found.by[
            "dummy above an acting factor"
        ].to_dict()
    summary = found.summary if acts else found.summary.drop(columns=list(ABOVE))
    offsets = found.offsets if acts else found.offsets.drop(columns="above an acting factor")
    tables = [
        Table("Factors", factors, "Shares of the variance of ln RMSE and total Sobol indices; low and high: "
              f"{found.drawn}. p: part of shuffles of the factor between base rows in which it explains as much. The "
              "dummy's total index is what the runs' own noise gives to every factor.", {"p": "{:.1e}"}),
        Table("Ranks by every method", ranks, "1 is the most important; ordered by the analysis of variance."),
        Table("Methods", summary, "tau: Kendall's, with the ranking of the analysis of variance; low and high: "
              f"{found.drawn}; both rankings are drawn anew, so they agree less than those of all runs."
              + (" The dummy must not stand above any factor that acts." if acts else ""),
              _there(summary, {"tau": "{:+.2f}", "low": "{:+.2f}", "high": "{:+.2f}", "tau with total Sobol": "{:+.2f}",
                               ABOVE[0]: "{:.0%}", ABOVE[1]: "{:.1f}"})),
        Table("The dummy counted from another zero", offsets, "The same runs, the same dummy; Deng's degree.",
              _there(offsets, {"degree": "{:.3f}", "above an acting factor": "{:.0%}"})),
        Table("Blind to sign", turned_levels, "Degrees of the levels as they are, and turned round, the highest where "
              "the lowest was.", {name: "{:+.3f}" for name in turned_levels.columns if name != "factor"}),
        Table("The same runs in other orders", orders, "Of degrees that compare steps from run to run.",
              _there(orders, {"tau, median": "{:+.2f}", ABOVE[0]: "{:.0%}"})),
    ]  # fmt: skip
    sentences = [*_of_the_runs(found), *_of_deng(found, turned, turned_levels), _of_orders(orders)]
    return Findings(_verdict(found), sentences, tables, _plots(found, factors, summary), figures)


ABOVE = ("dummy above an acting factor", "acting factors below the dummy")
"""Columns that ask for factors that act."""


def _there(frame: pd.DataFrame, formats: dict[str, str]) -> dict[str, str]:
    """Formats of those columns that a table has."""
    return {name: form for name, form in formats.items() if name in frame}


def _summary(found: Design) -> pd.DataFrame:
    score, rows = found.score, []
    first = _first(score[ANOVA], max(int(found.acting.sum()), 1))
    for name in METHODS:
        above = dummy_above(found.again[name], found.acting)
        low, high = np.nanquantile(found.taus[name], [0.025, 0.975])
        own = name == ANOVA  # of a method against itself there is nothing to say
        rows.append({
            "method": name, "tau": 1.0 if own else float(agreement(score[name][None], score[ANOVA])[0]),
            "low": 1.0 if own else float(low), "high": 1.0 if own else float(high),
            "tau with total Sobol": float(agreement(score[name][None], score[TOTAL])[0]),
            "of the first factors, found": f"{len(first & _first(score[name], len(first)))} of {len(first)}",
            "dummy's rank": int(places(score[name])[NAMES.index(DUMMY)]),
            "dummy above an acting factor": float((above > 0).mean()),
            "acting factors below the dummy": float(above.mean()),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _first(scores: np.ndarray, count: int) -> set[int]:
    return set(np.argsort(-scores)[:count].tolist())


def _factors(found: Design) -> pd.DataFrame:
    table = found.tested.copy()
    for name, key in ((ANOVA, "share"), (FIRST, "first Sobol"), (TOTAL, "total Sobol")):
        table[key] = found.score[name]
        table[f"{key}, low"], table[f"{key}, high"] = np.quantile(found.again[name], [0.025, 0.975], axis=0)
    table["Deng's degree"] = found.score["Deng"]
    return table.sort_values("share", ascending=False).reset_index(drop=True)


def _orders(found: Design) -> pd.DataFrame:
    rows = []
    for name in DISTURBED:
        here, there = degrees(name, found.runs), in_other_orders(found.runs, name, ORDERS)
        dummy = places(there)[:, NAMES.index(DUMMY)]
        row = {
            "degree": name, "tau, median": float(np.median(agreement(there, here))),
            "dummy's rank, least": int(dummy.min()), "dummy's rank, most": int(dummy.max()),
        }  # fmt: skip
        if found.acting.any():
            row["dummy above an acting factor"] = float((dummy_above(there, found.acting) > 0).mean())
        rows.append(row)
    return pd.DataFrame(rows)


# ------------------------------------------------------------------------------------------------ words


def _verdict(found: Design) -> str:
    by, grey = found.by, found.by.loc[list(GREY)]
    taus = (
        f"with the analysis of variance of the same {len(found.runs.rmse_mm)} runs their rankings agree by Kendall's "
        f"tau of {grey['tau'].min():+.2f} to {grey['tau'].max():+.2f} (plain rank correlation: "
        f"{by.loc[SPEARMAN, 'tau']:+.2f})"
    )
    if found.base_rows < FEW or not found.acting.any():
        why = f"{found.base_rows} base rows are too few" if found.base_rows < FEW else "no factor acts"
        return f"This design cannot judge grey relational analysis, for {why}; as far as it goes, {taus}."
    share = grey["dummy above an acting factor"]
    fooled = [f"{name} ({100 * share[name]:.0f} %)" for name in GREY if share[name] > OFTEN]
    sound = [f"{name} ({100 * share[name]:.0f} %)" for name in GREY if share[name] <= OFTEN]
    what = "put a factor that does nothing above one that acts"
    words = (
        f"Grey relational analysis misleads here: {len(fooled)} of its {len(GREY)} degrees {what} in more than "
        f"{100 * OFTEN:.0f} % of bootstraps, {listed(fooled)}{f'; not so {listed(sound)}' if sound else ''}"
        if fooled
        else f"None of the grey degrees {what} in more than {100 * OFTEN:.0f} % of bootstraps: {listed(sound)}"
    )  # fmt: skip
    rank = found.offsets["rank"]
    zero = (
        f" Deng's degree puts the factor that does nothing in place {rank.min()} or {rank.max()} of {len(NAMES)}, by "
        "the zero its levels are counted from."
        if rank.min() < rank.max() else ""
    )  # fmt: skip
    return (
        f"{words} (analysis of variance {_percent(by, ANOVA)}, rank correlation {_percent(by, SPEARMAN)}, total Sobol "
        f"{_percent(by, TOTAL)}). As for the ranking, {taus}: {_beside_ranks(found)}.{zero}"
    )


def _percent(by: pd.DataFrame, method: str) -> str:
    return f"{100 * by.loc[method, 'dummy above an acting factor']:.0f} %"


def _beside_ranks(found: Design) -> str:
    """Which degrees agree better, worse, or cannot be told apart, beside plain rank correlation on the same draws."""
    groups: dict[str, list[str]] = {"worse": [], "unknown": [], "better": []}
    for name in GREY:
        low, high = np.nanquantile(found.taus[name] - found.taus[SPEARMAN], [0.025, 0.975])
        groups[chosen(low, high, "worse", "unknown", "better")].append(name)
    words = {"worse": "worse than rank correlation", "better": "better than rank correlation",
             "unknown": "not to be told apart from rank correlation"}  # fmt: skip
    return "; ".join(f"{words[key]}: {listed(groups[key])}" for key in ("worse", "better", "unknown") if groups[key])


def _of_the_runs(found: Design) -> list[str]:
    by, runs, acting = found.by, found.runs, found.acting
    top = [NAMES[k] for k in np.argsort(-found.score[ANOVA]) if acting[k]]
    rule = f"p < {ACTS_P} by shuffles, and before the dummy in 97.5 % of bootstraps"
    acts = (
        f"{len(top)} of {len(NAMES) - 1} act ({rule}): {without_units(top)}, in the order of their shares"
        if top else f"by no factor can it be said that it acts ({rule})"
    )  # fmt: skip
    sentences = [
        f"The design has {found.made} runs of {len(NAMES)} factors, one of them a dummy that does nothing; "
        f"{found.lost} could not be measured, {found.made - len(runs.rmse_mm)} were left out with their base "
        f"rows. RMSE of the check points goes from {1e3 * runs.rmse_mm.min():.1f} to {1e3 * runs.rmse_mm.max():.1f} "
        f"um. Single factors explain {100 * max(explained(runs), 0):.0f} % of the variance of its logarithm; {acts}.",
        "With the ranking by analysis of variance, that by total Sobol indices agrees by Kendall's tau of "
        f"{_tau(by, TOTAL)}, rank correlation by {_tau(by, SPEARMAN)}, and the grey degrees by "
        + ", ".join(f"{_tau(by, name)} ({name})" for name in GREY)
        + f" (in brackets: {found.drawn}).",
    ]
    if top:
        share = by["dummy above an acting factor"]
        sentences.append(
            "The dummy stood above at least one acting factor in "
            + ", ".join(f"{100 * share[name]:.0f} % ({name})" for name in GREY)
            + f" of the bootstraps; in {100 * share[ANOVA]:.0f} % by analysis of variance, {100 * share[SPEARMAN]:.0f} "
            f"% by rank correlation and {100 * share[TOTAL]:.0f} % by total Sobol indices."
        )
    return sentences


def _tau(by: pd.DataFrame, method: str) -> str:
    tau, low, high = by.loc[method, ["tau", "low", "high"]]
    return f"{tau:+.2f} [{low:+.2f} to {high:+.2f}]"


def _of_deng(found: Design, turned: dict[str, list], turned_levels: pd.DataFrame) -> list[str]:
    deng, dummy = found.score["Deng"], found.score["Deng"][NAMES.index(DUMMY)]
    lower = [NAMES[k] for k in np.flatnonzero(found.acting & (deng <= dummy))]
    below = f", above what {without_units(lower)} gets, which acts" if len(lower) == 1 else (
        f", above what {without_units(lower)} get, which act" if lower else "")  # fmt: skip
    off = agreement(found.again["Deng"], -found.spread) - found.taus["Deng"]
    low, high = np.nanquantile(off, [0.025, 0.975])
    words = chosen(
        low, high, "it follows the effects more than the spread",
        "which of the two it follows more cannot be told", "it follows the spread more than the effects",
    )  # fmt: skip
    top = NAMES[int(np.argmax(found.score[ANOVA]))]
    own = turned_levels.set_index("factor").loc[top]
    offsets = []
    for _, row in found.offsets.iterrows():
        above = f" (above an acting factor in {100 * row['above an acting factor']:.0f} % of bootstraps)"
        place = f"{row['levels of the dummy']} give the degree {row['degree']:.3f} and place {row['rank']}"
        offsets.append(place + (above if found.acting.any() else ""))
    return [
        f"Deng's degree cannot fall below 1/3: here all {len(NAMES)} factors lie between {deng.min():.3f} and "
        f"{deng.max():.3f}. The dummy has {dummy:.3f}{below}: a degree of that size is no sign of any relation.",
        "With a ranking by the coefficient of variation of the factors' levels, the least first, which knows nothing "
        f"of any measurement, Deng's ranking agrees by Kendall's tau of {found.by_spread:+.2f}; with the analysis of "
        f"variance by {found.by.loc['Deng', 'tau']:+.2f}: {words}.",
        f"Counted from another zero, the dummy's levels {', '.join(offsets)}.",
        _reversed(turned),
        "Deng's degree has no sign: with its levels turned round, as if more of it were better, "
        f"{without_units([top])}, the first by analysis of variance, gets {own['Deng, turned round']:.3f} instead of "
        f"{own['Deng']:.3f}; the T-type, which has one, {own['T-type, turned round']:+.3f} instead of "
        f"{own['T-type']:+.3f}.",
    ]


def _of_orders(orders: pd.DataFrame) -> str:
    return (
        "The other six degrees compare steps from run to run, so they depend on the order of runs, which means nothing "
        "in a design: between two orders of the same runs their rankings agree by a median tau of "
        + ", ".join(f"{row['tau, median']:+.2f} ({row['degree']})" for _, row in orders.iterrows())
        + "."
    )


def _reversed(turned: dict[str, list[tuple[str, str, str]]]) -> str:
    """What leaving a factor out does to the order of the others."""
    count = {name: len(pairs) for name, pairs in turned.items()}
    if not any(count.values()):
        return (
            "Deng's degrees of all factors change when one is left out, for the largest difference is taken over "
            "all; here that turned the order of no two."
        )
    out, before, behind = next(pairs[0] for pairs in turned.values() if pairs)
    return (
        f"Pairs of factors whose order turns when a third is left out: {count['Deng']} for Deng's degree, "
        f"{count[RANGE]} with levels scaled to their ranges (without {out}, {behind} passes {before}). The "
        "ranking depends on who else is asked."
    )


def _plots(found: Design, factors: pd.DataFrame, summary: pd.DataFrame) -> list[Plot]:
    ranks = pd.DataFrame(
        [{"factor": name, "method": method, "rank": int(rank)} for method, s in found.score.items()
         for name, rank in zip(NAMES, places(s), strict=True)]
    )  # fmt: skip
    acts = bool(found.acting.any())
    above = "; right: share of bootstraps in which the dummy stands above an acting factor"
    return [
        Plot("shares", "What drives accuracy",
             f"Shares of the variance of ln RMSE and total Sobol indices on the same runs; lines: {found.drawn}; "
             "dotted: the dummy's total index, the runs' own noise.", factors, draw_shares, (8.2, 3.8), columns=2),
        Plot("ranks", "Ranks by every method", "1, dark: the most important. Factors in the order of the analysis of "
             "variance.", ranks, draw_ranks, (8.2, 4.2)),
        Plot("agreement", "How the methods agree, and what they make of nothing",
             f"Left: Kendall's tau with the analysis of variance; lines: {found.drawn}"
             f"{above if acts else ''}.", summary, draw_agreement, (8.2, 3.8), columns=2),
    ]  # fmt: skip
