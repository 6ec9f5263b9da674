"""Study `wls`: what its table says of the claim."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.study.study import Findings, Plot, Study, Table
from testfield.study.wls import cases
from testfield.study.wls_cells import CELL, OLS, WLS, cells, compare
from testfield.study.wls_figures import SHOWN_AS_GAIN, draw_claims, draw_gain, draw_rmse

CLAIM = (
    "Weighted least squares by parametric equations is better than ordinary least squares with few cameras, and not "
    "worse with many."
)
FEW, MANY = 4, 8
"""Up to so many cameras are few; from so many on they are many."""

SYSTEMATIC = 0.2
"""By how much NEES must surely exceed 1 before a claim is called too small."""


def read(table: pd.DataFrame) -> Findings:
    """Verdict, answers, tables and plots. Raises `TestfieldError` where no case gave points."""
    found = cells(table)
    verdict, status = judge(found)
    return Findings(
        verdict, [*answers(found, table), *remarks(found, table)],
        [_gain_table(found), _claim_table(found), _all_methods(found)],
        _plots(found), {"verdict": status} | _figures(found),
    )  # fmt: skip


def judge(found: pd.DataFrame) -> tuple[str, str]:
    """The verdict in a sentence, and in a word: holds, holds in part, fails."""
    wls = found[found["method"] == WLS]
    wls = wls.assign(word=[compare(row) for row in wls.itertuples()])
    few, many = wls[wls["cameras"] <= FEW], wls[wls["cameras"] >= MANY]
    gained = few[few["ranges"] == "spread"]["word"] == "better"
    harmed = many["word"] == "worse"
    told = "; ".join(_counted(wls, kind) for kind in wls["calibration"].unique())
    if gained.all() and not harmed.any():
        status, head = "holds", "The claim holds"
    elif gained.any() and harmed.mean() < 0.5:
        status, head = "holds in part", "The claim holds in part"
    else:
        status, head = "fails", "The claim fails"
    best = found[(found["calibration"] == "estimated") & (found["ranges"] == "spread") & (found["method"] == "gls")]
    tail = ""
    if len(best):
        kept = wls[(wls["calibration"] == "estimated") & (wls["ranges"] == "spread")]
        tail = (
            f" Under an estimated calibration and spread ranges the thesis' weights gain {_span(kept['gain'])}, those "
            f"of GLS, which know what the cameras share, {_span(best['gain'])}."
        )
    return f"{head}: {told}. Few are up to {FEW} cameras, many {MANY} and more.{tail}", status


def _counted(wls: pd.DataFrame, kind: str) -> str:
    parts = []
    for ranges in ("spread", "equal"):
        part = _of(wls, calibration=kind, ranges=ranges)
        if len(part):
            few, many = part[part["cameras"] <= FEW], part[part["cameras"] >= MANY]
            parts.append(f"at {ranges} ranges it is {_words(few)} with few cameras and {_words(many)} with many")
    return f"with the calibration {kind}, " + ", ".join(parts)


def _words(part: pd.DataFrame) -> str:
    words = {"better": "better", "equal": "no different", "worse": "worse"}
    counts = {told: int((part["word"] == word).sum()) for word, told in words.items()}
    if max(counts.values()) == len(part):
        return next(told for told, n in counts.items() if n == len(part))
    return " and ".join(f"{told} in {n} of {len(part)} cells" for told, n in counts.items() if n)


def answers(found: pd.DataFrame, table: pd.DataFrame) -> list[str]:
    """When weighting pays, how much, and what it costs to ignore that cameras share errors."""
    most = found["cameras"].max()
    sentences = []
    for kind in found["calibration"].unique():
        for ranges in ("spread", "equal"):
            part = _of(found, calibration=kind, ranges=ranges, method=WLS)
            told = "; ".join(f"{n} cameras {_gains(part[part['cameras'] == n])}" for n in _some(part["cameras"]))
            sentences.append(
                f"Calibration {kind}, {ranges} ranges: the midpoint's RMSE is so many times that of parametric_wls "
                f"(with its interval, and as predicted by the sandwich): {told}."
            )
    last = _of(found, calibration="exact", ranges="spread", method=WLS, cameras=most)
    if len(last):
        sentences.append(
            f"The law sqrt(<L²><1/L²>) with ranges alone promises {_span(last['law_ranges'])} at {most} cameras, with "
            f"each ray's own noise (distant targets are small, so their centres are worse in pixels too) "
            f"{_span(last['law_noise'])}; observed {_span(last['gain'])}, predicted by the covariances "
            f"{_span(last['gain_predicted'])}."
        )
    sentences += _two_cameras(table)
    sentences += _ignoring(found)
    return sentences


def _two_cameras(table: pd.DataFrame) -> list[str]:
    two = table[(table["cameras"] == 2) & (table["points"] > 0) & (table["calibration"] == "exact")]
    two = two[two["ranges"] == "spread"]
    if two.empty or "square_normal_mm2" not in two:
        return []
    sums = two.groupby("method")[["square_mm2", "square_normal_mm2", "claimed_normal_mm2"]].sum()
    inside = sums["square_mm2"] - sums["square_normal_mm2"]
    across = np.sqrt(sums["square_normal_mm2"][OLS] / sums["square_normal_mm2"][WLS])
    promised = np.sqrt(sums["claimed_normal_mm2"][OLS] / sums["claimed_normal_mm2"][WLS])
    return [
        "With two cameras there is one redundant observation, and all gain must lie square to the plane of both rays. "
        f"Observed there {across:.3f} (predicted {promised:.3f}), within the plane "
        f"{np.sqrt(inside[OLS] / inside[WLS]):.4f} (predicted 1)."
    ]


def _ignoring(found: pd.DataFrame) -> list[str]:
    part = _of(found, calibration="estimated")
    wls, ml, gls, bundle = (part[part["method"] == name] for name in (WLS, "ml", "gls", "bundle"))
    if gls.empty:
        return []
    worst = wls.loc[wls["over_gls"].idxmax()]
    return [
        "Ignoring that cameras share errors, as parametric_wls does, costs accuracy: with an estimated calibration its "
        f"RMSE is {_span(wls['over_gls'])} times that of GLS; at worst "
        f"{worst.over_gls:.2f} ({worst.over_gls_low:.2f} to {worst.over_gls_high:.2f}) with {worst.cameras} cameras, "
        f"{worst.ranges} ranges, {worst.noise} noise. Weights of pixels alone (ml) give {_span(ml['over_gls'])} "
        "times that of GLS: what the calibration says of one camera by itself contains what all cameras share (the "
        "same misprinted marks, the same lens), and weights that take it for that camera's own noise level out the "
        "differences that the rays really have.",
        f"And it costs truth: the points' NEES is {_span(wls['nees_narrow'], 1)} under the block-diagonal claim, "
        f"{_span(ml['nees_narrow'], 1)} under that of pixels alone, and {_span(wls['nees_points'])} under the sandwich "
        "that knows the correlation (1 is true; single points, after the fit).",
        f"One adjustment of all points and cameras together (bundle) has {_span(bundle['over_gls'])} times the RMSE of "
        "GLS, which takes one point at a time.",
    ]


def remarks(found: pd.DataFrame, table: pd.DataFrame) -> list[str]:
    """What else a reader should know: the other methods, the claims' truth, what was left out and how it was done."""
    sentences = []
    for method, why in (
        ("dlt", "with rows of ||m3|| = 1 weights every ray alike and is the midpoint again"),
        ("dlt_p34", "with rows of p34 = 1 divides by each camera's distance from the datum's origin and so weights, by "
         "luck of where that is, nearly as the ranges ask"),
        ("opencv", "takes two rays of each point, whatever else has been seen"),
    ):  # fmt: skip
        part = _of(found, method=method, ranges="spread")
        if len(part):
            sentences.append(f"{method} {why}: {_span(part['gain'])} against the midpoint at spread ranges.")
    for kind in ("exact", "estimated"):
        part = _of(found, calibration=kind, method="gls")
        if len(part):
            sentences.append(
                f"Claimed against actual, calibration {kind}: NEES of all points together under GLS's covariance is "
                f"{_span(part['nees'])}; {_span(100 * part['coverage'], 0)} % of single points in their 95 % region."
            )
    exact = _of(found, calibration="exact", method="gls")
    more = exact[exact["nees_low"] > 1 + SYSTEMATIC]
    if len(more):
        worst = more.loc[more["nees"].idxmax()]
        sentences.append(
            f"With the calibration exact the claim is too small in {len(more)} of {len(exact)} cells, most at "
            f"{worst.noise} noise, {worst.ranges} ranges and {worst.cameras} cameras: NEES {worst.nees:.2f} "
            f"({worst.nees_low:.2f} to {worst.nees_high:.2f}), RMSE {1e3 * worst.rmse_mm:.1f} µm where noise alone "
            f"gives {1e3 * worst.predicted_mm:.1f}. That part of the centres' errors comes again in every exposure: "
            "neither weights nor more cameras lessen it as they lessen noise."
        )
    estimated = _of(found, calibration="estimated", method="gls")
    if len(estimated):
        times = estimated["frame_mm"] / estimated["rmse_mm"]
        sentences.append(
            "Under an estimated calibration errors are those after a rigid fit of six parameters, since the first "
            f"board's frame errs for all methods alike; without the fit GLS's RMSE is {_span(times, 1)} times as large."
        )  # fmt: skip
    lost = table[table["points"] == 0]
    if len(lost):
        counts = lost.drop_duplicates([*CELL, "exposure", "set"]).groupby(["calibration", "cameras"]).size()
        told = ", ".join(f"{k} with {n} cameras ({kind})" for (kind, n), k in counts.items() if k)
        sentences.append(f"Without result: {told}; the first because {lost['why'].iloc[0]}.")
    exposures = table["exposure"].nunique()
    sentences.append(
        f"{exposures} exposures of each cell, {int(found['points'].min()):,} to {int(found['points'].max()):,} points; "
        "of each number of cameras below the largest, two sets. A calibration is estimated from the images of the same "
        "cameras that then measure the points, and the workshop is drawn anew for each exposure. Intervals "
        "(95 %) come from resampling whole exposures: targets of one exposure share its calibration. Only targets that "
        "every method has from three quarters of the cameras are compared."
    )
    return sentences


def _gain_table(found: pd.DataFrame) -> Table:
    part = found[found["method"].isin([OLS, WLS, "ml", "gls"])]
    wide = part.pivot_table(index=CELL, columns="method", values="rmse_mm", observed=True, sort=False) * 1e3
    wls = part[part["method"] == WLS].set_index(CELL)
    frame = pd.DataFrame({
        "points": wls["points"], "midpoint µm": wide[OLS], "parametric_wls µm": wide[WLS], "ml µm": wide["ml"],
        "gls µm": wide["gls"], "gain": wls["gain"],
        "95 %": [f"{a:.2f} – {b:.2f}" for a, b in zip(wls["gain_low"], wls["gain_high"], strict=True)],
        "predicted": wls["gain_predicted"], "law": wls["law_noise"],
        "parametric_wls is": [compare(row) for row in wls.itertuples()],
    }).reset_index()  # fmt: skip
    micrometres = {f"{name} µm": "{:.1f}" for name in (OLS, WLS, "ml", "gls")}
    return Table(
        "When weighting pays", frame, "RMSE a coordinate, and the gain of parametric_wls over the midpoint.",
        micrometres | {"gain": "{:.3f}", "predicted": "{:.3f}", "law": "{:.2f}"},
    )  # fmt: skip


def _claim_table(found: pd.DataFrame) -> Table:
    claims = claims_of(found)
    frame = claims.pivot_table(
        index=["ranges", "noise", "claim"], columns="cameras", values="nees", observed=True, sort=False
    ).reset_index()
    frame.columns = [str(name) for name in frame.columns]
    return Table(
        "What each claim is worth", frame,
        "NEES of single points a degree of freedom, by number of cameras, calibration estimated: 1 is a true claim.",
        {str(n): "{:.2f}" for n in claims["cameras"].unique()},
    )  # fmt: skip


def _all_methods(found: pd.DataFrame) -> Table:
    frame = found.pivot_table(
        index=CELL, columns="method", values="rmse_mm", observed=True, sort=False
    )[list(found["method"].unique())]  # fmt: skip
    frame = (1e3 * frame).reset_index()
    return Table(
        "Every method", frame, "RMSE a coordinate in µm.", {name: "{:.1f}" for name in found["method"].unique()}
    )


def claims_of(found: pd.DataFrame) -> pd.DataFrame:
    """NEES of single points by claim, calibration estimated."""
    kinds = {
        "pixels alone (ml)": ("ml", "nees_narrow"), "block-diagonal (parametric_wls)": (WLS, "nees_narrow"),
        "sandwich (parametric_wls)": (WLS, "nees_points"), "sandwich (gls)": ("gls", "nees_points"),
        "sandwich (bundle)": ("bundle", "nees_points"),
    }  # fmt: skip
    parts = []
    for claim, (method, column) in kinds.items():
        rows = _of(found, calibration="estimated", method=method)
        values = {"nees": rows[column], "nees_low": rows[f"{column}_low"], "nees_high": rows[f"{column}_high"]}
        parts.append(rows[["ranges", "noise", "cameras"]].assign(claim=claim, **values))
    return pd.concat(parts, ignore_index=True)


def _plots(found: pd.DataFrame) -> list[Plot]:
    columns = [*CELL, "method"]
    rmse = found[columns].assign(
        rmse_um=1e3 * found["rmse_mm"], rmse_low_um=1e3 * found["rmse_mm_low"],
        rmse_high_um=1e3 * found["rmse_mm_high"], predicted_um=1e3 * found["predicted_mm"],
    )  # fmt: skip
    gain = found[(found["ranges"] == "spread") & found["method"].isin(SHOWN_AS_GAIN)]
    gain = gain[[*columns, "gain", "gain_low", "gain_high", "gain_predicted", "law_noise"]]
    size: dict[str, Any] = {"size_in": (7.6, 6.4), "columns": 2, "rows": 2}
    plots = [
        Plot(
            f"rmse_{noise}", f"Error by number of cameras, {noise} noise",
            "RMSE a coordinate with 95 % intervals; dashed, what each method's own covariance predicts.",
            rmse[rmse["noise"] == noise], draw_rmse, **size,
        )
        for noise in rmse["noise"].unique()
    ]  # fmt: skip
    plots.append(
        Plot(
            "gain", "What weighting gains, ranges spread five times",
            "RMSE of the midpoint over that of each method, with 95 % intervals; dashed, predicted by the covariances.",
            gain, draw_gain, **size,
        )
    )  # fmt: skip
    plots.append(
        Plot(
            "claims", "What claims are worth",
            "NEES of single points under five claims, calibration estimated; 1 is true.",
            claims_of(found), draw_claims, **size,
        )
    )  # fmt: skip
    return plots


def _figures(found: pd.DataFrame) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for kind in ("exact", "estimated"):
        part = _of(found, calibration=kind, ranges="spread", method=WLS)
        for name, rows in (("few", part[part["cameras"] <= FEW]), ("many", part[part["cameras"] >= MANY])):
            if len(rows):
                figures[f"gain_{kind}_{name}"] = [float(rows["gain"].min()), float(rows["gain"].max())]
    gls = _of(found, calibration="estimated", method="gls", ranges="spread")
    narrow = _of(found, calibration="estimated")
    if len(gls):
        figures["gain_estimated_gls"] = [float(gls["gain"].min()), float(gls["gain"].max())]
        for name, method in (("pixels", "ml"), ("blocks", WLS)):
            values = narrow[narrow["method"] == method]["nees_narrow"]
            figures[f"nees_claiming_{name}"] = [float(values.min()), float(values.max())]
        figures["wls_over_gls"] = float(narrow[narrow["method"] == WLS]["over_gls"].max())
    return figures


def _of(found: pd.DataFrame, **values: Any) -> pd.DataFrame:
    for column, value in values.items():
        found = found[found[column] == value]
    return found


def _gains(rows: pd.DataFrame) -> str:
    return ", ".join(
        f"{row.gain:.2f} ({row.gain_low:.2f} to {row.gain_high:.2f}, predicted {row.gain_predicted:.2f}) "
        f"at {row.noise} noise"
        for row in rows.itertuples()
    )


def _some(numbers: pd.Series) -> list[int]:
    """The fewest cameras, the most that are few, and the most."""
    each = sorted(numbers.unique())
    return sorted({each[0], max([n for n in each if n <= FEW], default=each[0]), each[-1]})


def _span(values: pd.Series, digits: int = 2) -> str:
    low, high = f"{values.min():.{digits}f}", f"{values.max():.{digits}f}"
    return low if low == high else f"{low} to {high}"


STUDY = Study("wls", "Weighted least squares by parametric equations", CLAIM, cases, read)
