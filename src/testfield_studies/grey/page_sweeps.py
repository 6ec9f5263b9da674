"""What the study of grey methods found in sweeps of one factor at a time, as published analyses are made."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.seeds import generator
from testfield_studies.grey.factors import DUMMY, NAMES
from testfield_studies.grey.figures import draw_sweeps
from testfield_studies.grey.rankings import agreement, places, sweep_table
from testfield_studies.grey.words import chosen, without_units
from testfield.study.study import Findings, Plot, Table

HIT = ("radial distortion, 1e-3", "tangential distortion, 1e-4", "half convergence, deg", "image noise, e")
"""What a published grey analysis of binocular vision found to matter most, every degree at least 0.859."""
DRAWS = 4000


def read_sweeps(sweep: pd.DataFrame) -> Findings:
    """Findings from the rows of the sweeps' runs; none where a run is not there, for a sweep with a hole is none."""
    if sweep.empty:
        return Findings("", [])
    lost = sweep["lost"].fillna("") != ""
    runs = sweep[~lost].groupby(["block", "base"]).size().unstack()
    runs = runs.reindex(NAMES)
    if lost.any() or runs.isna().any(axis=None) or len(np.unique(runs)) > 1 or runs.shape[1] < 3:
        why = f"{int(lost.sum())} of its runs could not be measured" if lost.any() else "not all of its runs are there"
        return Findings("", [f"One factor at a time: nothing can be said, for {why}."])
    table = sweep_table(sweep).sort_values("change of ln RMSE", key=np.abs, ascending=False).reset_index(drop=True)
    by = table.set_index("factor")
    sentences = [_about_degrees(by)]
    figures: dict[str, Any] = {"Deng's degrees in sweeps": by["Deng"].to_dict()}
    if by["u"].notna().all():
        sentences.insert(0, _about_slopes(by, int(runs.iloc[0, 0])))
        figures |= {"change of ln RMSE in sweeps": by["change of ln RMSE"].to_dict(), "u of it": by["u"].to_dict()}
    formats = {name: "{:.3f}" for name in table.columns if name != "factor"}
    formats |= {"change of ln RMSE": "{:+.2f}", "u": "{:.2f}", "u95": "{:.2f}"}
    return Findings("", sentences, [
        Table("One factor at a time", table, "As published analyses do it: a sweep of each factor, all others at their "
              "middles. Change of ln RMSE from one end to the other by a straight line, its standard uncertainty u and "
              "half its 95 % interval, from repeats at the same level; the dummy's is noise.", formats),
    ], [
        Plot("sweeps", "One factor at a time", "Left: what each factor changes in its sweep, with 95 % intervals, the "
             "dummy's in red; right: Deng's degree of the same sweep, dotted its floor of 1/3.", table, draw_sweeps,
             (8.2, 3.6), columns=2),
    ], figures)  # fmt: skip


def _about_slopes(by: pd.DataFrame, repeats: int) -> str:
    own = by.drop(index=DUMMY)
    seen = own.index[own["change of ln RMSE"].abs() > own["u95"]].tolist()
    change, wide = by.loc[DUMMY, "change of ln RMSE"], by.loc[DUMMY, "u95"]
    dummy = "within" if abs(change) <= wide else "beyond"
    found = (
        f"{len(seen)} of {len(own)} factors change it by more than half their 95 % interval ({without_units(seen)})"
        if seen else f"none of {len(own)} factors changes it by more than half its 95 % interval"
    )  # fmt: skip
    return (
        f"One factor at a time, {repeats} runs at each level: on a straight line through ln RMSE from one end to the "
        f"other {found}. The dummy, which does nothing, changes it by {change:+.2f}, {dummy} its interval of ± "
        f"{wide:.2f}: so much is noise."
    )


def _about_degrees(by: pd.DataFrame) -> str:
    deng, change = by["Deng"].to_numpy(), by["change of ln RMSE"].to_numpy()
    place = dict(zip(by.index, places(deng).astype(int), strict=True))
    tau = float(agreement(deng[None], np.abs(change))[0])
    words = f"Kendall's tau of {tau:+.2f}"
    if by["u"].notna().all():
        drawn = change + by["u"].to_numpy() * generator(0, "grey slopes").normal(size=(DRAWS, len(change)))
        low, high = np.quantile(agreement(np.abs(drawn), deng), [0.025, 0.975])
        verdict = chosen(
            low, high, "contrary to it", "which cannot be told from no agreement", "so they agree in part"
            if tau < 0.7 else "so they agree",
        )  # fmt: skip
        words += f" ({low:+.2f} to {high:+.2f} within the uncertainty of the changes), {verdict}"
    published = [f"{by.loc[name, 'Deng']:.3f} ({without_units([name])}, place {place[name]})" for name in HIT]
    return (
        f"Deng's degrees rank these sweeps, against the size of the change of ln RMSE, with {words}; the dummy gets "
        f"{by.loc[DUMMY, 'Deng']:.3f} and place {place[DUMMY]}. The four that a published analysis of a binocular "
        f"system puts first (all at least 0.859 there) get {', '.join(published)} here."
    )
