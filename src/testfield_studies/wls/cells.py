"""Study `wls`: its table by cells, with intervals from leaving out one exposure after the other."""

from typing import Any

import pandas as pd

from testfield.statistics.decide import Side, side_of
from testfield.statistics.jackknife import jackknife_ratio
from testfield_studies.wls.repeated import repeated

CELL = ["ranges", "noise", "calibration", "cameras"]
ROW = [*CELL, "exposure", "set"]
ORDER = {"equal": 0, "spread": 1, "low": 0, "high": 1, "exact": 0, "estimated": 1}
OLS, WLS = "midpoint", "parametric_wls"
MEASURABLE = 0.01
"""A part by which an error must differ to be called better or worse, however narrow its interval."""
SAME = 0.05
"""Within so much of 1 a ratio's whole interval must lie before two things are called no different."""
SEVERAL = 3.0
"""So many cameras the weights must come to (`law_cameras`) before the law of many cameras is held against anything."""
COLUMNS = (
    "square_mm2",
    "claimed_mm2",
    "frame_mm2",
    "hits",
    "nees",
    "nees_points",
    "nees_points_frame",
    "nees_narrow",
    "law_ranges",
    "law_noise",
    "law_cameras",
)
RATIOS = {
    "rmse_mm": ("square_mm2", "coordinates", 0.5),
    "gain": ("midpoint_mm2", "beside_midpoint_mm2", 0.5),
    "over_gls": ("beside_gls_mm2", "gls_mm2", 0.5),
    "over_ml": ("beside_ml_mm2", "ml_mm2", 0.5),
    "nees": ("together", "points", 1.0),
    "nees_points": ("single", "points", 1.0),
    "nees_frame": ("in_frame", "framed", 1.0),
    "nees_narrow": ("narrow", "narrowed", 1.0),
}
"""Figures with an interval: what is summed over a cell's rows, over what, and the power of the ratio."""
PLAIN = {
    "predicted_mm": ("claimed_mm2", "coordinates", 0.5),
    "gain_predicted": ("midpoint_claimed_mm2", "claimed_beside_midpoint_mm2", 0.5),
    "frame_mm": ("frame_mm2", "coordinates", 0.5),
    "coverage": ("hits", "points", 1.0),
    "law_ranges": ("laws_ranges", "points", 1.0),
    "law_noise": ("laws_noise", "points", 1.0),
    "law_cameras": ("laws_cameras", "counted", 1.0),
}
"""Figures without one."""

COLUMNS_OF_CELLS = [
    *CELL,
    "method",
    "points",
    "exposures",
    *(f"{name}{end}" for name in (*RATIOS, "repeated") for end in ("", "_low", "_high")),
    *PLAIN,
]


def cells(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each cell and method: RMSE, gain over the midpoint and over GLS, NEES, each with its 95 % interval,
    beside what the sandwich predicts; NaN where a table has not got it, no row where no case gave points."""
    good = table[table["points"] > 0] if "points" in table else table.iloc[:0]
    if good.empty:
        return pd.DataFrame(columns=COLUMNS_OF_CELLS, dtype=float)
    good = _summands(good)
    names = sorted({name for a, b, _ in [*RATIOS.values(), *PLAIN.values()] for name in (a, b)})
    sums = good.groupby([*CELL, "method", "exposure"], observed=True, sort=False)[names].sum()
    rows = []
    for key, part in sums.groupby(level=[*CELL, "method"], observed=True, sort=False):
        row = dict(zip([*CELL, "method"], key, strict=True))
        each = dict(zip(names, part.to_numpy(float).T, strict=True))
        row |= {"points": int(each["points"].sum()), "exposures": len(part)}
        for name, (a, b, power) in RATIOS.items():
            row[name], row[f"{name}_low"], row[f"{name}_high"] = jackknife_ratio(each[a], each[b], power)
        rows.append(row | {name: jackknife_ratio(each[a], each[b], power)[0] for name, (a, b, power) in PLAIN.items()})
    found = pd.DataFrame(rows).merge(repeated(good, [*CELL, "method"]), on=[*CELL, "method"], how="left")
    return found.sort_values(
        CELL,
        kind="stable",
        ignore_index=True,
        key=lambda column: column.map(ORDER) if column.name != CELL[-1] else column,
    )


def told(value: float, low: float, high: float) -> Side:
    """What a ratio and its interval say against 1."""
    return side_of(low, high, 1.0, value=value, least=MEASURABLE, same=SAME)


def tell(rows: pd.DataFrame, name: str) -> pd.Series:
    """What each row's figure of that name says against 1."""
    ends = zip(rows[name], rows[f"{name}_low"], rows[f"{name}_high"], strict=True)
    return pd.Series([told(*values) for values in ends], rows.index, dtype=object)


def of(found: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """Rows with these values."""
    for column, value in values.items():
        found = found[found[column] == value]
    return found


def law_holds(found: pd.DataFrame) -> pd.Series:
    """Where the law of many cameras is meant: calibration exact, and weights that come to several cameras."""
    return (found["calibration"] == "exact") & (found["law_cameras"] >= SEVERAL)


def _summands(good: pd.DataFrame) -> pd.DataFrame:
    """What is summed over a cell; two methods are compared over those sets of cameras where both gave points."""
    good = good.reindex(columns=[*good.columns, *(name for name in COLUMNS if name not in good)])
    n = good["points"]
    good = good.assign(
        coordinates=3 * n,
        together=good["nees"] * n,
        single=good["nees_points"] * n,
        in_frame=good["nees_points_frame"] * n,
        framed=n.where(good["nees_points_frame"].notna()),
        narrow=good["nees_narrow"] * n,
        narrowed=n.where(good["nees_narrow"].notna()),
        laws_ranges=good["law_ranges"] * n,
        laws_noise=good["law_noise"] * n,
        laws_cameras=good["law_cameras"] * n,
        counted=n.where(good["law_cameras"].notna()),
    )
    for method in (OLS, "gls", "ml"):
        theirs = good[good["method"] == method][[*ROW, "square_mm2", "claimed_mm2"]].rename(
            columns={"square_mm2": f"{method}_mm2", "claimed_mm2": f"{method}_claimed_mm2"}
        )
        good = good.merge(theirs, on=ROW, how="left")
        both = good[f"{method}_mm2"].notna()
        good[f"beside_{method}_mm2"] = good["square_mm2"].where(both)
        good[f"claimed_beside_{method}_mm2"] = good["claimed_mm2"].where(both)
    return good
