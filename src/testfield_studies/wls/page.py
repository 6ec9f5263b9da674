"""Study `wls`: its tables, its plots and what makes it a study."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.statistics.decide import Side
from testfield.study.study import Plot, Results, Study, Table
from testfield_studies.wls.cells import CELL, OLS, ROW, SEVERAL, WLS, cells, law_holds, of, tell
from testfield_studies.wls.experiment import cases
from testfield_studies.wls.figures import SHOWN_AS_GAIN, draw_claims, draw_gain, draw_rmse
from testfield_studies.wls.findings import findings_of

SAYS = {Side.ABOVE: "better", Side.SAME: "no different", Side.BELOW: "worse", Side.OPEN: "not told apart"}


def read(table: pd.DataFrame) -> Results:
    """Findings, tables and plots: what can be said of the rows that there are."""
    found = cells(table)
    tables = [_gain_table(found), _claim_table(found), _repeated_table(found), _all_methods(found), _lost_table(table)]
    return Results(findings_of(found, table), [table for table in tables if len(table.frame)], _plots(found))


def _gain_table(found: pd.DataFrame) -> Table:
    names = [OLS, WLS, "ml", "gls"]
    wls = of(found, method=WLS).dropna(subset="gain").set_index(CELL)
    rmse = {f"{name} µm": 1e3 * of(found, method=name).set_index(CELL)["rmse_mm"].reindex(wls.index) for name in names}
    frame = pd.DataFrame(
        {
            "points": wls["points"],
            **rmse,
            "gain": wls["gain"],
            "95 %": [_interval(a, b) for a, b in zip(wls["gain_low"], wls["gain_high"], strict=True)],
            "predicted": wls["gain_predicted"],
            "law": wls["law_noise"].where(law_holds(wls.reset_index()).to_numpy()),
            "parametric_wls is": [SAYS[side] for side in tell(wls, "gain")],
        },
        index=wls.index,
    ).reset_index()
    formats = {f"{name} µm": "{:.1f}" for name in names} | {"gain": "{:.3f}", "predicted": "{:.3f}", "law": "{:.2f}"}
    return Table(
        "When weighting pays",
        frame,
        "RMSE a coordinate, and the gain of parametric_wls over the midpoint. The law of many cameras stands where it "
        f"is meant: calibration exact, and weights that come to {SEVERAL:.0f} equal cameras or more.",
        formats,
    )


def _claim_table(found: pd.DataFrame) -> Table:
    claims = claims_of(found).dropna(subset="nees")
    frame = claims.pivot_table(
        index=["ranges", "noise", "claim"], columns="cameras", values="nees", observed=True, sort=False
    ).reset_index()
    frame.columns = [str(name) for name in frame.columns]
    return Table(
        "What each claim is worth",
        frame,
        "NEES of single points a degree of freedom, in the frame of the first board, by number of cameras, calibration "
        "estimated: 1 is a true claim.",
        {str(n): "{:.2f}" for n in claims["cameras"].unique()},
    )


def _repeated_table(found: pd.DataFrame) -> Table:
    rows = of(found, method="gls").dropna(subset="repeated")
    share = rows["repeated"].astype(float).clip(lower=0, upper=1)
    frame = pd.DataFrame(
        {
            **{name: rows[name] for name in CELL},
            "exposures": rows["exposures"],
            "RMSE µm": 1e3 * rows["rmse_mm"],
            "predicted µm": 1e3 * rows["predicted_mm"],
            "again µm": 1e3 * rows["rmse_mm"] * np.sqrt(share),
            "scatter µm": 1e3 * rows["rmse_mm"] * np.sqrt(1 - share),
            "again, part of squares": rows["repeated"],
            "95 %": [_interval(a, b) for a, b in zip(rows["repeated_low"], rows["repeated_high"], strict=True)],
        }
    )
    return Table(
        "What comes again in every exposure",
        frame,
        "GLS: the part of the errors that is the same in all exposures of a scene, by products of errors of two "
        "exposures, and the rest. Chance alone gives nought on average.",
        {name: "{:.1f}" for name in frame if name.endswith("µm")} | {"again, part of squares": "{:.2f}"},
    )


def _interval(low: float, high: float) -> str:
    return f"{low:.2f} – {high:.2f}" if np.isfinite([low, high]).all() else "–"


def _all_methods(found: pd.DataFrame) -> Table:
    frame = found.pivot_table(index=CELL, columns="method", values="rmse_mm", observed=True, sort=False)
    frame = (1e3 * frame.reindex(columns=list(found["method"].unique()))).reset_index()
    return Table(
        "Every method", frame, "RMSE a coordinate in µm.", {name: "{:.1f}" for name in found["method"].unique()}
    )


def _lost_table(table: pd.DataFrame) -> Table:
    """Sets of cameras without a calibration, and methods that gave nothing."""
    title, rows = "What gave nothing", []
    lost = table[table["points"] == 0] if "points" in table else table.iloc[:0]
    for method, own in lost.groupby("method", sort=False) if len(lost) else ():
        asked = table[table["method"] == method] if method else table.drop_duplicates(ROW)
        own = own if method else own.drop_duplicates(ROW)
        rows.append((method or "calibration", len(own), len(asked), own["why"].iloc[0]))
    frame = pd.DataFrame(rows, columns=["method", "sets of cameras", "of", "why the first"])
    return Table(title, frame, "Methods that gave no points for a set of cameras; the others are compared without.")


def claims_of(found: pd.DataFrame) -> pd.DataFrame:
    """NEES of single points by claim in the frame of the first board, calibration estimated."""
    kinds = {
        "pixels alone (ml)": ("ml", "nees_narrow"),
        "block-diagonal (parametric_wls)": (WLS, "nees_narrow"),
        "sandwich (parametric_wls)": (WLS, "nees_frame"),
        "sandwich (gls)": ("gls", "nees_frame"),
        "sandwich (bundle)": ("bundle", "nees_frame"),
    }
    parts = []
    for claim, (method, column) in kinds.items():
        rows = of(found, calibration="estimated", method=method)
        values = {"nees": rows[column], "nees_low": rows[f"{column}_low"], "nees_high": rows[f"{column}_high"]}
        parts.append(rows[["ranges", "noise", "cameras"]].assign(claim=claim, **values))
    return pd.concat(parts, ignore_index=True)


def _plots(found: pd.DataFrame) -> list[Plot]:
    columns = [*CELL, "method"]
    rmse = found[columns].assign(
        rmse_um=1e3 * found["rmse_mm"],
        rmse_low_um=1e3 * found["rmse_mm_low"],
        rmse_high_um=1e3 * found["rmse_mm_high"],
        predicted_um=1e3 * found["predicted_mm"],
    )
    gain = found[(found["ranges"] == "spread") & found["method"].isin(SHOWN_AS_GAIN) & found["gain"].notna()]
    gain = gain.assign(law=gain["law_noise"].where(law_holds(gain)))
    gain = gain[[*columns, "gain", "gain_low", "gain_high", "gain_predicted", "law"]]
    size: dict[str, Any] = {"size_in": (7.6, 6.4), "columns": 2, "rows": 2}
    plots = [
        Plot(
            f"rmse_{noise}",
            f"Error by number of cameras, {noise} noise",
            "RMSE a coordinate with 95 % intervals; dashed, what each method's own covariance predicts.",
            rmse[rmse["noise"] == noise],
            draw_rmse,
            **size,
        )
        for noise in rmse["noise"].unique()
    ]
    law = " The law of many cameras is drawn where it is meant." if gain["law"].notna().any() else ""
    plots.append(
        Plot(
            "gain",
            "What weighting gains, ranges spread five times",
            "RMSE of the midpoint over that of each method, with 95 % intervals; dashed, predicted by the covariances."
            + law,
            gain,
            draw_gain,
            **size,
        )
    )
    plots.append(
        Plot(
            "claims",
            "What claims are worth",
            "NEES of single points under five claims, in the frame of the first board, calibration estimated; 1 is "
            "true.",
            claims_of(found).dropna(subset="nees"),
            draw_claims,
            **size,
        )
    )
    return [plot for plot in plots if len(plot.data)]


STUDY = Study(
    name="wls",
    title="Weighted least squares by parametric equations",
    claim="Weighted least squares by parametric equations is better than ordinary least squares with few cameras, and "
    "not worse with many.",
    rests_on=("few_exact", "few_estimated", "many_exact", "many_estimated"),
    cases=cases,
    read=read,
    conclusion=Path(__file__).with_name("conclusion.md"),
)
