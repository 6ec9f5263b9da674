"""Study `wls`: its table by cells, with intervals from resampling exposures."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.errors import TestfieldError
from testfield.seeds import generator
from testfield.study.wls import P

CELL = ["ranges", "noise", "calibration", "cameras"]
ORDER = {"equal": 0, "spread": 1, "low": 0, "high": 1, "exact": 0, "estimated": 1}
OLS, WLS = "midpoint", "parametric_wls"
RESAMPLES = 2000
SUMS = (
    "points", "square_mm2", "claimed_mm2", "frame_mm2", "hits", "together", "single", "narrow", "laws", "laws_ranges",
)  # fmt: skip
MEASURABLE = 0.01
"""A part by which an error must differ to be called better or worse, however narrow its interval."""


def cells(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each cell and method: RMSE, gain over the midpoint and over GLS, NEES, each with its 95 % interval by
    resampling exposures, beside what the sandwich predicts."""
    good = table[table["points"] > 0]
    if good.empty:
        raise TestfieldError("no case gave any points", "study wls", "look at the failures in results.parquet")
    good = good.assign(
        together=good["nees"] * good["points"], single=good["nees_points"] * good["points"],
        narrow=good["nees_narrow"] * good["points"], laws=good["law_noise"] * good["points"],
        laws_ranges=good["law_ranges"] * good["points"],
    )  # fmt: skip
    exposures = np.sort(good["exposure"].unique())
    rng = generator(0, "study/wls/bootstrap")
    draws = rng.multinomial(len(exposures), np.full(len(exposures), 1 / len(exposures)), RESAMPLES)
    # The first row is the experiment as it was.
    draws = np.vstack([np.ones(len(exposures)), draws])
    rows = []
    totals = good.groupby([*CELL, "method", "exposure"], observed=True, sort=False)[list(SUMS)].sum(min_count=1)
    for key, part in totals.groupby(level=CELL, observed=True, sort=False):
        sums: dict[str, dict[str, np.ndarray]] = {}
        for method, own in part.droplevel(CELL).groupby(level="method", sort=False):
            each = own.droplevel("method").reindex(exposures, fill_value=0.0).to_numpy(float)
            sums[str(method)] = dict(zip(SUMS, (draws @ each).T, strict=True))
        for method, s in sums.items():
            ratio = {
                "rmse_mm": np.sqrt(s["square_mm2"] / (3 * s["points"])),
                "gain": np.sqrt(sums[OLS]["square_mm2"] / s["square_mm2"]),
                "over_gls": np.sqrt(s["square_mm2"] / sums["gls"]["square_mm2"]),
                "nees": s["together"] / s["points"], "nees_points": s["single"] / s["points"],
                "nees_narrow": s["narrow"] / s["points"],
            }  # fmt: skip
            row = dict(zip(CELL, key, strict=True)) | {"method": method, "points": int(s["points"][0])}
            for name, values in ratio.items():
                drawn = values[1:][np.isfinite(values[1:])]  # not where a draw has no exposure that gave points
                low, high = np.quantile(drawn, [0.5 - P / 2, 0.5 + P / 2]) if len(drawn) else (np.nan, np.nan)
                row |= {name: values[0], f"{name}_low": low, f"{name}_high": high}
            rows.append(row | {
                "predicted_mm": np.sqrt(s["claimed_mm2"][0] / (3 * s["points"][0])),
                "gain_predicted": np.sqrt(sums[OLS]["claimed_mm2"][0] / s["claimed_mm2"][0]),
                "frame_mm": np.sqrt(s["frame_mm2"][0] / (3 * s["points"][0])),
                "coverage": s["hits"][0] / s["points"][0], "law_noise": s["laws"][0] / s["points"][0],
                "law_ranges": s["laws_ranges"][0] / s["points"][0],
            })  # fmt: skip
    return pd.DataFrame(rows).sort_values(
        CELL,
        kind="stable",
        ignore_index=True,
        key=lambda column: column.map(ORDER) if column.name != CELL[-1] else column,
    )


def compare(row: Any) -> str:
    """Whether a method is better than the midpoint, worse, or neither, by its interval and by a measurable part."""
    if row.gain_low > 1 and row.gain > 1 + MEASURABLE:
        return "better"
    return "worse" if row.gain_high < 1 and row.gain < 1 - MEASURABLE else "equal"
