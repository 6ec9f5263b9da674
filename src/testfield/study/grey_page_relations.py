"""What the study of grey methods found of grey relational analysis."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield.study.grey_factors import DUMMY, NAMES
from testfield.study.grey_rankings import (
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
    sweep_table,
    turned_round,
)
from testfield.study.study import Findings, Plot, Table

BOOTSTRAPS, ORDERS = 400, 100
DISTURBED = ("absolute", "relative", "synthetic", "T-type", "slope", "B-type")
"""Degrees that depend on the order of the runs."""
HIT = ("radial distortion, 1e-3", "tangential distortion, 1e-4", "half convergence, deg", "image noise, e")
"""What a published grey analysis of binocular vision found to matter most, every degree at least 0.859."""


def read_relations(table: pd.DataFrame) -> Findings:
    """Findings from the rows of the design's runs and of the sweeps."""
    rows = table[table["part"] == "runs"]
    design = rows[rows["set"] == "design"]
    lost = design["lost"].fillna("") != ""
    runs = Runs.of(design[~lost]).whole()
    if not len(runs.rmse_mm):
        reason = str(design["lost"][lost].iloc[0]) if lost.any() else "no run was made"
        return Findings(f"No base row of the design is whole ({reason}).", [])
    score = {name: method(runs) for name, method in METHODS.items()}
    again = bootstrap(runs, BOOTSTRAPS)
    tested = anova_table(runs)
    acting = acting_factors(tested, again[ANOVA])
    summary = _summary(runs, score, again, acting)
    factors = _factors(tested, score, again)
    swept = _swept(rows[rows["set"] == "sweep"])
    ranks = pd.DataFrame({"factor": NAMES} | {name: places(s).astype(int) for name, s in score.items()})
    ranks = ranks.iloc[np.argsort(-score[ANOVA])].reset_index(drop=True)
    turned = {name: reversals(runs, name) for name in ("Deng", RANGE)}
    offsets = dummy_with_offset(runs, acting, (0.0, 1.0, 10.0), BOOTSTRAPS // 2)
    turned_levels = turned_round(runs)
    spread = sequences(runs.unit)
    spread = spread.std(axis=1) / spread.mean(axis=1)
    by_spread = float(agreement(places(score["Deng"])[None], places(-spread))[0])
    orders = _orders(runs, acting)
    sentences = _sentences(
        runs, design, lost, tested, acting, score, summary, turned, offsets, orders, by_spread, swept, turned_levels
    )
    by = summary.set_index("method")
    grey = by.loc[list(GREY)]
    figures: dict[str, Any] = {
        "runs": len(design), "lost runs": int(lost.sum()), "acting factors": [NAMES[k] for k in np.flatnonzero(acting)],
        "explained by single factors": explained(runs),
        "tau with analysis of variance": {name: float(by.loc[name, "tau"]) for name in by.index},
        "dummy above an acting factor, share of bootstraps": {
            name: float(by.loc[name, "dummy above an acting factor"]) for name in by.index},
        "Deng's lowest degree": float(score["Deng"].min()),
        "tau of Deng with the spread of levels": by_spread,
    }  # fmt: skip
    verdict = _verdict(runs, by, grey, by_spread, offsets, bool(acting.any()))
    tables = [
        Table("Factors", factors, "Shares of the variance of ln RMSE and total Sobol indices with 95 % intervals; p: "
              "that chance gives as much. The dummy's total index is what the runs' own noise gives to every factor.",
              {"p": "{:.1e}"}),
        Table("Ranks by every method", ranks, "1 is the most important; ordered by the analysis of variance."),
        Table("Methods", summary, "tau: Kendall's, with the ranking of the analysis of variance; 95 % interval over "
              "bootstraps of base rows. Of as many factors as act beyond doubt, so many stand first. The dummy must "
              "not stand above any factor that acts beyond doubt.",
              {"tau": "{:+.2f}", "low": "{:+.2f}", "high": "{:+.2f}", "tau with total Sobol": "{:+.2f}",
               "dummy above an acting factor": "{:.0%}", "acting factors below the dummy": "{:.1f}"}),
        Table("The dummy counted from another zero", offsets, "The same runs, the same dummy; Deng's degree.",
              {"degree": "{:.3f}", "above an acting factor": "{:.0%}"}),
        Table("Blind to sign", turned_levels, "Degrees of the levels as they are, and turned round, the highest where "
              "the lowest was.", {name: "{:+.3f}" for name in turned_levels.columns if name != "factor"}),
        Table("The same runs in other orders", orders, "Of degrees that compare steps from run to run.",
              {"tau, median": "{:+.2f}", "dummy above an acting factor": "{:.0%}"}),
    ]  # fmt: skip
    if len(swept):
        tables.append(Table(
            "One factor at a time", swept, "As published analyses do it: a sweep of each factor, all others at their "
            "middles.", {name: "{:.3f}" for name in swept.columns if name != "factor"}))  # fmt: skip
    return Findings(verdict, sentences, tables, _plots(factors, summary, score, swept), figures)


def _verdict(
    runs: Runs, by: pd.DataFrame, grey: pd.DataFrame, by_spread: float, offsets: pd.DataFrame, any_acts: bool
) -> str:
    best = str(grey["tau"].idxmax())
    safe = grey[(grey["dummy above an acting factor"] <= 0.05) & (grey["low"] > 0.5)].index.tolist()
    compared = (
        f"with the analysis of variance of the same {len(runs.rmse_mm)} runs their rankings agree by Kendall's tau of "
        f"{grey['tau'].min():+.2f} to {grey['tau'].max():+.2f} (best: {best}; plain rank correlation "
        f"{by.loc[SPEARMAN, 'tau']:+.2f})"
    )
    if not any_acts:
        return (
            f"The design is too small to judge grey relational analysis: in it no factor acts beyond doubt; {compared}."
        )
    if safe:
        return f"Of the grey relational degrees {', '.join(safe)} found what drives accuracy: {compared}."
    spread = f"Deng's ranking agrees by {by_spread:+.2f} with the mere spread of the factors' levels"
    if by_spread > by.loc["Deng", "tau"]:
        spread = f"{spread}, more than with their effect"
    return (
        f"Grey relational analysis is no safe way to find what drives accuracy: {compared}. {spread}, and it puts a "
        f"factor that does nothing in place {offsets['rank'].max()} or {offsets['rank'].min()} of {len(NAMES)}, by "
        "the zero its levels are counted from."
    )


def _summary(
    runs: Runs, score: dict[str, np.ndarray], again: dict[str, np.ndarray], acting: np.ndarray
) -> pd.DataFrame:
    rows = []
    first = _first(score[ANOVA], max(int(acting.sum()), 1))
    for name in METHODS:
        # Truth and method are both drawn anew; of a method against itself there is nothing to say.
        tau = agreement(again[name], again[ANOVA])
        above = dummy_above(again[name], acting)
        low, high = np.nanquantile(tau, [0.025, 0.975])
        own = name == ANOVA
        rows.append({
            "method": name, "tau": 1.0 if own else float(agreement(score[name][None], score[ANOVA])[0]),
            "low": np.nan if own else float(low), "high": np.nan if own else float(high),
            "tau with total Sobol": float(agreement(score[name][None], score[TOTAL])[0]),
            "of the first factors, found": f"{len(first & _first(score[name], len(first)))} of {len(first)}",
            "dummy's rank": int(places(score[name])[NAMES.index(DUMMY)]),
            "dummy above an acting factor": float((above > 0).mean()),
            "acting factors below the dummy": float(above.mean()),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _words(names: list[str]) -> str:
    """Factors in a sentence, without their units."""
    return ", ".join(name.split(",")[0] for name in names)


def _first(scores: np.ndarray, count: int) -> set[int]:
    return set(np.argsort(-scores)[:count].tolist())


def _factors(tested: pd.DataFrame, score: dict[str, np.ndarray], again: dict[str, np.ndarray]) -> pd.DataFrame:
    table = tested.rename(columns={"share": "share"})
    for name, key in ((ANOVA, "share"), (FIRST, "first Sobol"), (TOTAL, "total Sobol")):
        table[key] = score[name]
        table[f"{key}, low"], table[f"{key}, high"] = np.quantile(again[name], [0.025, 0.975], axis=0)
    table["Deng's degree"] = score["Deng"]
    return table.sort_values("share", ascending=False).reset_index(drop=True)


def _orders(runs: Runs, acting: np.ndarray) -> pd.DataFrame:
    rows = []
    for name in DISTURBED:
        here, there = degrees(name, runs), in_other_orders(runs, name, ORDERS)
        dummy = places(there)[:, NAMES.index(DUMMY)]
        rows.append({
            "degree": name, "tau, median": float(np.median(agreement(there, here))),
            "dummy's rank, least": int(dummy.min()), "dummy's rank, most": int(dummy.max()),
            "dummy above an acting factor": float((dummy_above(there, acting) > 0).mean()),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _swept(sweep: pd.DataFrame) -> pd.DataFrame:
    kept = sweep[sweep["lost"].fillna("") == ""]
    levels = kept.groupby("block").size().reindex(NAMES)
    if len(kept) < len(sweep) or levels.isna().any() or levels.nunique() > 1:
        return pd.DataFrame({"factor": []})  # a sweep with a hole is none
    return sweep_table(kept).sort_values("change of ln RMSE", key=np.abs, ascending=False).reset_index(drop=True)


def _sentences(
    runs: Runs, design: pd.DataFrame, lost: pd.Series, tested: pd.DataFrame, acting: np.ndarray,
    score: dict[str, np.ndarray], summary: pd.DataFrame, turned: dict[str, list], offsets: pd.DataFrame,
    orders: pd.DataFrame, by_spread: float, swept: pd.DataFrame, turned_levels: pd.DataFrame,
) -> list[str]:  # fmt: skip
    by = summary.set_index("method")
    top = tested.sort_values("share", ascending=False)["factor"].tolist()[:3]
    deng, dummy = score["Deng"], NAMES.index(DUMMY)
    round_again = turned_levels.set_index("factor").loc[top[0]]
    found = [
        f"The design has {len(design)} runs of {len(NAMES)} factors, one of them a dummy that does nothing; "
        f"{int(lost.sum())} could not be measured, {len(design) - len(runs.rmse_mm)} were left out with their base "
        f"rows. RMSE of the check points goes from {1e3 * runs.rmse_mm.min():.1f} to {1e3 * runs.rmse_mm.max():.1f} "
        f"um. Single factors explain {100 * explained(runs):.0f} % of the variance of its logarithm; "
        f"{int(acting.sum())} of {len(NAMES) - 1} act beyond doubt (p < {ACTS_P}, and before the dummy in 97.5 % of "
        f"bootstraps), first of all {_words(top)}.",
        f"Analysis of variance and total Sobol indices agree by Kendall's tau of {by.loc[TOTAL, 'tau']:+.2f}, rank "
        f"correlation and analysis of variance by {by.loc[SPEARMAN, 'tau']:+.2f}; the grey degrees by "
        + ", ".join(f"{by.loc[name, 'tau']:+.2f} ({name})" for name in GREY) + ".",
        _about_the_dummy(by, int(acting.sum())),
        f"Deng's degree cannot fall below 1/3: here all {len(NAMES)} factors lie between {deng.min():.3f} and "
        f"{deng.max():.3f}, the dummy at {deng[dummy]:.3f}. A degree of 0.6 or 0.8 by itself says nothing.",
        "With a ranking by the coefficient of variation of the factors' levels, which knows nothing of any "
        f"measurement, Deng's ranking agrees by Kendall's tau of {by_spread:+.2f}; with the analysis of variance by "
        f"{by.loc['Deng', 'tau']:+.2f}.",
        "Counted from another zero, the dummy's levels " + _other_zeros(offsets, bool(acting.any())) + ".",
        _reversed(turned),
        "The other six compare steps from run to run, so they depend on the order of runs, which means nothing in a "
        "design: between two orders of the same runs their rankings agree by a median tau of "
        + ", ".join(f"{row['tau, median']:+.2f} ({row['degree']})" for _, row in orders.iterrows())
        + ". In the order of this design neighbours differ in two factors only, which makes the T-type a kind of "
        "elementary effect.",
        "Every degree but the T-type is blind to sign: with its levels turned round, as if more of it were better, "
        f"{_words(top[:1])} gets Deng's degree {round_again['Deng, turned round']:.3f} instead of "
        f"{round_again['Deng']:.3f} (T-type: {round_again['T-type, turned round']:+.3f} instead of "
        f"{round_again['T-type']:+.3f}).",
    ]  # fmt: skip
    if "Deng" in swept:
        by_truth = swept.set_index("factor")
        truth = by_truth["change of ln RMSE"].abs()
        tau = agreement(by_truth["Deng"].to_numpy()[None], truth.to_numpy())[0]
        place = places(by_truth["Deng"].to_numpy())
        published = [
            f"{degree:.3f} ({_words([str(name)])}, place {place[k]:.0f})"
            for k, (name, degree) in enumerate(by_truth["Deng"].items())
            if name in HIT
        ]
        found.append(
            "One factor at a time, as published: Deng's degrees rank the sweeps against the true change of ln RMSE "
            f"by tau {tau:+.2f}; the dummy gets {by_truth.loc[DUMMY, 'Deng']:.3f}. The four that a published analysis "
            f"of a binocular system puts first (all at least 0.859 there) get {', '.join(published)} here."
        )
    return found


def _other_zeros(offsets: pd.DataFrame, any_acts: bool) -> str:
    """What the dummy gets with its levels counted from other zeros."""
    words = []
    for _, row in offsets.iterrows():
        above = f" (above an acting factor in {100 * row['above an acting factor']:.0f} % of bootstraps)"
        place = f"{row['levels of the dummy']} give the degree {row['degree']:.3f} and rank {row['rank']}"
        words.append(place + (above if any_acts else ""))
    return ", ".join(words)


def _about_the_dummy(by: pd.DataFrame, acting: int) -> str:
    """How often nothing is ranked above something."""
    if not acting:
        return "In so small a design no factor acts beyond doubt, so nothing can be said of where the dummy belongs."
    share = by["dummy above an acting factor"]
    grey = ", ".join(f"{100 * share[name]:.0f} % ({name})" for name in GREY)
    return (
        f"The dummy stood above at least one acting factor in {grey} of the bootstraps; in {100 * share[ANOVA]:.0f} % "
        f"by analysis of variance, {100 * share[SPEARMAN]:.0f} % by rank correlation and {100 * share[TOTAL]:.0f} % "
        "by total Sobol indices."
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
        f"Leaving out one factor turned the order of two others {count['Deng']} times for Deng's degree and "
        f"{count[RANGE]} times with levels scaled to their ranges (without {out}, {behind} passes {before}): the "
        "ranking depends on who else is asked."
    )


def _plots(
    factors: pd.DataFrame, summary: pd.DataFrame, score: dict[str, np.ndarray], swept: pd.DataFrame
) -> list[Plot]:
    ranks = pd.DataFrame(
        [{"factor": name, "method": method, "rank": int(rank)} for method, s in score.items()
         for name, rank in zip(NAMES, places(s), strict=True)]
    )  # fmt: skip
    found = [
        Plot("shares", "What drives accuracy",
             "Shares of the variance of ln RMSE and total Sobol indices on the same runs, 95 % intervals; dotted: the "
             "dummy's total index, the runs' own noise.", factors, _draw_shares, (8.2, 3.8), columns=2),
        Plot("ranks", "Ranks by every method", "1, dark: the most important. Factors in the order of the analysis of "
             "variance.", ranks, _draw_ranks, (8.2, 4.2)),
        Plot("agreement", "How the methods agree, and what they make of nothing",
             "Left: Kendall's tau with the analysis of variance, 95 % interval; right: share of bootstraps in which "
             "the "
             "dummy stands above an acting factor.", summary, _draw_agreement, (8.2, 3.8), columns=2),
    ]  # fmt: skip
    if "Deng" in swept:
        found.append(Plot(
            "sweeps", "One factor at a time", "Left: what each factor truly changes in its sweep; right: Deng's degree "
            "of the same sweep, dotted its floor of 1/3.", swept, _draw_sweeps, (8.2, 3.6), columns=2))  # fmt: skip
    return found


def _draw_shares(axes: Any, data: pd.DataFrame) -> None:
    place = np.arange(len(data))[::-1]
    for ax, key in zip(axes, ("share", "total Sobol"), strict=True):
        colour = [WARM if name == DUMMY else ACCENT for name in data["factor"]]
        ax.barh(place, data[key], color=colour, height=0.62)
        ax.hlines(place, data[f"{key}, low"], data[f"{key}, high"], color=INK, lw=1)
        ax.set(xlabel={"share": "share of variance", "total Sobol": "total Sobol index"}[key])
        ax.set_xlim(0, min(ax.get_xlim()[1], 1.5))  # intervals of small designs have no end
    axes[1].axvline(data.loc[data["factor"] == DUMMY, "total Sobol"].iloc[0], color=WARM, ls=":", lw=1)
    axes[0].set_yticks(place, data["factor"])
    axes[1].set_yticks(place, [""] * len(place))


def _draw_ranks(ax: Any, data: pd.DataFrame) -> None:
    wide = data.pivot(index="factor", columns="method", values="rank")[list(METHODS)].sort_values(ANOVA, kind="stable")
    ax.imshow(-wide.to_numpy(), cmap="Blues", aspect="auto", vmin=-len(NAMES) - 2, vmax=2)
    for i, row in enumerate(wide.to_numpy()):
        for j, rank in enumerate(row):
            ax.text(j, i, str(rank), ha="center", va="center", fontsize=7.5, color="white" if rank <= 4 else INK,
                    fontweight="bold" if wide.index[i] == DUMMY else "normal")  # fmt: skip
    ax.set_xticks(range(len(METHODS)), list(METHODS), rotation=35, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(wide)), wide.index)
    for label in ax.get_yticklabels():
        if label.get_text() == DUMMY:
            label.set_color(WARM)
    ax.tick_params(length=0)


def _draw_agreement(axes: Any, data: pd.DataFrame) -> None:
    place = np.arange(len(data))[::-1]
    colour = [WARM if name in GREY else ACCENT for name in data["method"]]
    axes[0].hlines(place, data["low"], data["high"], color=colour, lw=1.6)
    axes[0].scatter(data["tau"], place, color=colour, s=22, zorder=3)
    axes[0].axvline(0, color=FAINT, lw=0.8)
    axes[0].set_yticks(place, data["method"])
    axes[0].set(xlabel="Kendall's tau", xlim=(-1.05, 1.05), xticks=[-1, -0.5, 0, 0.5, 1])
    axes[1].barh(place, data["dummy above an acting factor"], color=colour, height=0.62)
    axes[1].axvline(0.05, color=INK, ls=":", lw=1)
    axes[1].set_yticks(place, [""] * len(place))
    axes[1].set(xlabel="dummy above an acting factor", xlim=(0, 1.02))
    for ax in axes:
        ax.set_ylim(-0.7, len(data) - 0.3)


def _draw_sweeps(axes: Any, data: pd.DataFrame) -> None:
    place = np.arange(len(data))[::-1]
    colour = [WARM if name == DUMMY else ACCENT for name in data["factor"]]
    axes[0].barh(place, data["change of ln RMSE"].abs(), color=colour, height=0.62)
    axes[1].barh(place, data["Deng"], color=colour, height=0.62)
    axes[1].axvline(1 / 3, color=INK, ls=":", lw=1)
    axes[0].set_yticks(place, data["factor"])
    axes[1].set_yticks(place, [""] * len(place))
    axes[0].set(xlabel="change of ln RMSE from one end to the other")
    axes[1].set(xlabel="Deng's degree", xlim=(0, 1))
