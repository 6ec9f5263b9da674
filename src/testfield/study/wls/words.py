"""Study `wls`: what its cells say in sentences. Every claim is chosen by its figures; without them it is left out."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.study.wls.cells import CELL, OLS, ROW, WLS, tell

FEW, MANY = 4, 8
"""Up to so many cameras are few; from so many on they are many."""
SEVERAL = 3.0
"""So many cameras the weights must come to (`law_cameras`) before the law of many cameras is held against anything."""
SYSTEMATIC = 0.2
"""By how much NEES must surely exceed 1 before a claim is called too small."""
POINTS = 1000
"""So many points a cell is to have."""


def answers(found: pd.DataFrame, table: pd.DataFrame) -> list[str]:
    """When weighting pays, how much, and what it costs to ignore that cameras share errors."""
    sentences = []
    for kind in found["calibration"].unique():
        for ranges in ("spread", "equal"):
            part = of(found, calibration=kind, ranges=ranges, method=WLS).dropna(subset="gain")
            if len(part):
                each = "; ".join(f"{n} cameras {_gains(part[part['cameras'] == n])}" for n in _some(part["cameras"]))
                sentences.append(
                    f"Calibration {kind}, {ranges} ranges: the midpoint's RMSE is so many times that of parametric_wls "
                    f"(with its interval, and as predicted by the sandwich): {each}."
                )
    return [*sentences, *_law(found), *_two_cameras(table), *_ignoring(found), *_truth(found), *_bundle(found)]


def law_holds(found: pd.DataFrame) -> pd.Series:
    """Where the law of many cameras is meant: calibration exact, and weights that come to several cameras."""
    return (found["calibration"] == "exact") & (found["law_cameras"] >= SEVERAL)


def _law(found: pd.DataFrame) -> list[str]:
    """The law against what was found, where it is meant; where it is not, why, and on which side it errs."""
    part = of(found, calibration="exact", ranges="spread", method=WLS).dropna(
        subset=["gain", "law_noise", "law_cameras"]
    )
    if part.empty:
        return []
    name = "The law of many cameras, sqrt(<L²><1/L²>) with each ray's own noise,"
    sentences = []
    meant = part[law_holds(part)]
    for n in sorted(meant["cameras"].unique()):
        own = meant[meant["cameras"] == n]
        above, below = own["law_noise"] > own["gain_high"], own["law_noise"] < own["gain_low"]
        within = int((~above & ~below).sum())
        agrees = (
            "within the intervals" if within == len(own) else "too much" if above.all()
            else "too little" if below.all() else f"within the interval in {within} of {len(own)} cells"
        )  # fmt: skip
        sentences.append(
            f"{name} promises {span(own['law_noise'])} at spread ranges, calibration exact, {n} cameras, where weights "
            f"come to {span(own['law_cameras'], 1)} equal ones; observed {span(own['gain'])}: {agrees}."
        )
    other = part[~law_holds(part) & (part["cameras"] > 2)]
    if len(other):
        most = other[other["cameras"] == other["cameras"].max()]
        n = int(most["cameras"].iloc[0])
        above = (most["law_noise"] > most["gain_high"]).all()
        side = "and is an upper figure only: it promises" if above else "and is not held against what was found:"
        sentences.append(
            f"{name} does not hold for {n} cameras at spread ranges: near ones outweigh the others so that the weights "
            f"come to {span(most['law_cameras'], 1)} equal cameras, too few to fix a point from all sides as the law "
            f"supposes, {side} {span(most['law_noise'])}; observed {span(most['gain'])}, predicted by the covariances "
            f"{span(most['gain_predicted'])}. With ranges alone, as if all targets were measured equally well in "
            f"pixels, it would be {span(most['law_ranges'])}."
        )
    return sentences


def _two_cameras(table: pd.DataFrame) -> list[str]:
    names = ["square_mm2", "square_normal_mm2", "claimed_normal_mm2"]
    if not {*names, "method"} <= {*table.columns}:
        return []
    two = table[(table["cameras"] == 2) & (table["points"] > 0) & (table["calibration"] == "exact")]
    two = two[two["ranges"] == "spread"]
    both = [two[two["method"] == method].set_index(ROW)[names] for method in (OLS, WLS)]
    rows = both[0].index.intersection(both[1].index)
    if not len(rows):
        return []
    ols, wls = (part.loc[rows].sum() for part in both)
    across = np.sqrt(ols["square_normal_mm2"] / wls["square_normal_mm2"])
    promised = np.sqrt(ols["claimed_normal_mm2"] / wls["claimed_normal_mm2"])
    inside = np.sqrt(
        (ols["square_mm2"] - ols["square_normal_mm2"]) / (wls["square_mm2"] - wls["square_normal_mm2"])
    )  # fmt: skip
    if not np.isfinite([across, promised, inside]).all():
        return []
    return [
        "With two cameras there is one redundant observation, and all gain must lie square to the plane of both rays. "
        f"Observed there {across:.3f} (predicted {promised:.3f}), within the plane {inside:.4f} (predicted 1)."
    ]


def _ignoring(found: pd.DataFrame) -> list[str]:
    """What ignoring correlation costs against GLS, and whether weights of pixels alone do better than the thesis'."""
    wls = of(found, calibration="estimated", method=WLS).dropna(subset="over_gls")
    if wls.empty:
        return []
    words = tell(wls, "over_gls")
    worst = wls.loc[wls["over_gls"].idxmax()]
    head = _head(
        words,
        "costs accuracy", "costs accuracy in some cells", "costs no accuracy", "gains accuracy",
        "costs no accuracy that could be told apart from none",
    )  # fmt: skip
    sentences = [
        f"Ignoring that cameras share errors, as parametric_wls does, {head}: with an estimated calibration its RMSE "
        f"is {span(wls['over_gls'])} times that of GLS ({_counts(words, 'larger', 'smaller')}), most "
        f"{_value(worst, 'over_gls')} with {worst.cameras} cameras, {worst.ranges} ranges, {worst.noise} noise."
    ]
    beside = wls.dropna(subset="over_ml")
    if len(beside):
        words = tell(beside, "over_ml")
        sentence = (
            f"Against weights of pixels alone (ml) the RMSE of parametric_wls is {span(beside['over_ml'])} times as "
            f"large ({_counts(words, 'larger', 'smaller')})."
        )
        if (words == "above").sum() > (words == "below").sum():
            sentence += (
                " So pixels alone may be the better weights: what the calibration says of one camera by itself "
                "contains what all cameras share (the same misprinted marks, the same lens), and weights that take it "
                "for that camera's own noise level out the differences that the rays really have."
            )
        sentences.append(sentence)
    return sentences


def _truth(found: pd.DataFrame) -> list[str]:
    """Claims that know less than the sandwich beside the sandwich, all in the frame of the first board."""
    parts, bold = [], {}
    for name, method, column in (
        ("the block-diagonal claim of parametric_wls", WLS, "nees_narrow"),
        ("that of pixels alone (ml)", "ml", "nees_narrow"),
        ("the sandwich, which knows it (parametric_wls)", WLS, "nees_frame"),
    ):
        rows = of(found, calibration="estimated", method=method).dropna(subset=column)
        if rows.empty:
            continue
        words = tell(rows, column)
        bold[method, column] = float((words == "above").mean())
        digits = 2 if rows[column].max() < 10 else 0
        parts.append(f"{span(rows[column], digits)} under {name} ({_counts(words, 'too small', 'too large', 'true')})")
    narrow = [part for (_, column), part in bold.items() if column == "nees_narrow"]
    if not narrow:
        return []
    own = bold.get((WLS, "nees_frame"))
    if own is None:
        head = "What claims are worth that ignore what cameras share"
    elif min(narrow) > own:
        head = "Claims that ignore what cameras share are too small more often than the one that knows it"
    elif max(narrow) > own:
        head = "Of the claims that ignore what cameras share, one is too small more often than the one that knows it"
    else:
        head = (
            "Claims that ignore what cameras share are not seen to be too small more often than the one that knows it"
        )
    return [
        f"{head}: NEES of single points in the frame of the first board, calibration estimated, is "
        + "; ".join(parts) + ". 1 is a true claim."
    ]  # fmt: skip


def _bundle(found: pd.DataFrame) -> list[str]:
    bundle = of(found, calibration="estimated", method="bundle").dropna(subset="over_gls")
    if bundle.empty:
        return []
    counts = _counts(tell(bundle, "over_gls"), "larger", "smaller")
    return [
        f"One adjustment of all points and cameras together (bundle) has {span(bundle['over_gls'])} times the RMSE of "
        f"GLS, which takes one point at a time ({counts}; calibration estimated)."
    ]


def remarks(found: pd.DataFrame, table: pd.DataFrame) -> list[str]:
    """What else a reader should know: the other methods, the claims' truth, what was left out and how it was done."""
    return [
        *_others(found), *_claimed(found), *_repeated(found), *_fitted(found), *_lost(table), *_extent(found, table)
    ]  # fmt: skip


def _others(found: pd.DataFrame) -> list[str]:
    sentences = []
    for method, why in (
        ("dlt", "with rows of ||m3|| = 1"),
        ("dlt_p34", "with rows of p34 = 1, which divides by each camera's distance from the datum's origin, wherever "
         "that is,"),
        ("opencv", "takes two rays of each point, whatever else has been seen, and"),
    ):  # fmt: skip
        part = of(found, method=method, ranges="spread").dropna(subset="gain")
        if part.empty:
            continue
        words = tell(part, "gain")
        again = method == "dlt" and (words == "one").all()
        tail = "the midpoint again" if again else _counts(words, "better", "worse")
        sentences.append(
            f"{method} {why} gains {span(part['gain'])} against the midpoint at spread ranges: {tail}."
        )  # fmt: skip
    return sentences


def _claimed(found: pd.DataFrame) -> list[str]:
    sentences = []
    for kind in ("exact", "estimated"):
        part = of(found, calibration=kind, method="gls").dropna(subset=["nees", "coverage"])
        if len(part):
            sentences.append(
                f"Claimed against actual, calibration {kind}: NEES of all points together under GLS's covariance is "
                f"{span(part['nees'])}; {span(100 * part['coverage'], 0)} % of single points in their 95 % region."
            )
    return sentences


def _repeated(found: pd.DataFrame) -> list[str]:
    """Where claims are too small under an exact calibration, and whether what is too much comes again."""
    exact = of(found, calibration="exact", method="gls").dropna(subset=["nees_low", "nees"])
    if exact.empty:
        return []
    sentences = []
    more = exact[exact["nees_low"] > 1 + SYSTEMATIC]
    if len(more):
        worst = more.loc[more["nees"].idxmax()]
        sentences.append(
            f"With the calibration exact the claim is too small in {len(more)} of {len(exact)} cells, most at "
            f"{worst.noise} noise, {worst.ranges} ranges and {worst.cameras} cameras: NEES {_value(worst, 'nees')}, "
            f"RMSE {1e3 * worst.rmse_mm:.1f} µm where noise alone gives {1e3 * worst.predicted_mm:.1f}.{_again(worst)}"
        )
    judged = exact.dropna(subset=["repeated", "repeated_low", "repeated_high"])
    surely = judged[judged["repeated_low"] > 0]
    if len(judged):
        parts = f"{span(100 * judged['repeated'].clip(lower=0), 0)} % of the squared errors"
        known = f"surely some in {len(surely)} of {len(judged)} cells" if len(surely) else "in no cell surely any"
        sentences.append(
            f"What comes again in every exposure (GLS, calibration exact, the same target by the same cameras) makes "
            f"{parts}, {known}; the rest scatters."
        )
    return sentences


def _again(row: Any) -> str:
    """Whether the excess of a row's errors over its claim comes again in every exposure."""
    if not np.isfinite([row.repeated, row.repeated_low, row.repeated_high]).all():
        return ""
    # What scatters surely, against what is claimed to.
    scatters = (1 - row.repeated_high) * (row.rmse_mm_low / row.predicted_mm) ** 2 > 1 + SYSTEMATIC
    if row.repeated_low <= 0:
        if scatters:
            return " What scatters from exposure to exposure is larger than claimed; nothing surely comes again."
        return f" Whether that comes again in every exposure cannot be told from {row.exposures} of them."
    again = (
        f" {1e3 * row.rmse_mm * np.sqrt(row.repeated):.1f} µm of the RMSE come again in every exposure "
        f"({100 * row.repeated_low:.0f} to {100 * row.repeated_high:.0f} % of its square)"
    )
    if scatters:
        return f"{again}; what scatters is larger than claimed too."
    return f"{again}: an error of the centres that is no noise, which repeating does not lessen."


def _fitted(found: pd.DataFrame) -> list[str]:
    estimated = of(found, calibration="estimated", method="gls").dropna(subset=["frame_mm", "rmse_mm"])
    if estimated.empty:
        return []
    times = estimated["frame_mm"] / estimated["rmse_mm"]
    return [
        "Under an estimated calibration errors are those after a rigid fit of six parameters, since the first board's "
        f"frame errs for all methods alike; without the fit GLS's RMSE is {span(times, 1)} times as large. What single "
        "points claim is compared without it, for a claim that says nothing of what points share cannot be fitted."
    ]


def _lost(table: pd.DataFrame) -> list[str]:
    lost = table[table["points"] == 0] if "points" in table else table.iloc[:0]
    sentences = []
    whole = lost[lost["method"] == ""] if len(lost) else lost
    if len(whole):
        counts = whole.drop_duplicates(ROW).groupby(["calibration", "cameras"]).size()
        each = ", ".join(f"{k} with {n} cameras ({kind})" for (kind, n), k in counts.items() if k)
        sentences.append(f"Sets of cameras without a calibration: {each}; the first because {whole['why'].iloc[0]}.")
    single = lost[lost["method"] != ""] if len(lost) else lost
    for method, rows in single.groupby("method", sort=False):
        sentences.append(
            f"{method} gave nothing for {len(rows)} of {(table['method'] == method).sum()} sets of cameras, the first "
            f"because {rows['why'].iloc[0]}."
        )
    return sentences


def _extent(found: pd.DataFrame, table: pd.DataFrame) -> list[str]:
    exposures = table[table["points"] > 0]["exposure"].nunique()
    sentences = [
        f"{exposures} exposure{'s' if exposures > 1 else ''}, {int(found['points'].min()):,} to "
        f"{int(found['points'].max()):,} points in a cell; of each number of cameras below the largest, two sets. A "
        "calibration is estimated from the images of the same cameras that then measure the points, and the workshop "
        "is drawn anew for each exposure. Intervals (95 %) come from leaving out one exposure after the other, with "
        "Student's t: targets of one exposure share its calibration. Only targets that every method has from three "
        "quarters of the cameras are compared."
    ]
    thin = found[found["points"] < POINTS]
    if len(thin):
        least = thin.loc[thin["points"].idxmin()]
        n = len(thin.drop_duplicates(CELL))
        sentences.append(
            f"Fewer than {POINTS:,} points in {n} of {len(found.drop_duplicates(CELL))} cells; {int(least.points)} at "
            f"{least.ranges} ranges, {least.noise} noise, calibration {least.calibration}, {least.cameras} cameras."
        )
    return sentences


def of(found: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """Rows with these values."""
    for column, value in values.items():
        found = found[found[column] == value]
    return found


def span(values: pd.Series, digits: int = 2) -> str:
    """The least and the greatest, once where they read the same."""
    low, high = f"{values.min():.{digits}f}", f"{values.max():.{digits}f}"
    return low if low == high else f"{low} to {high}"


def _head(words: pd.Series, all_above: str, some_above: str, same: str, below: str, untold: str) -> str:
    """The sentence's verb, by what all cells say."""
    if (words == "above").all():
        return all_above
    if (words == "above").any():
        return some_above
    if (words == "below").any():
        return below if (words == "below").all() else f"{below} in some cells"
    return same if (words == "one").all() else untold


def _counts(words: pd.Series, above: str, below: str, one: str = "no different") -> str:
    """In how many cells what was told, against 1."""
    names = {"above": above, "one": one, "below": below, "untold": "not told"}
    counts = {name: int((words == word).sum()) for word, name in names.items()}
    if max(counts.values()) == len(words):
        return next(f"{name} in all {n} cells" if n > 1 else name for name, n in counts.items() if n)
    return ", ".join(f"{name} in {n}" for name, n in counts.items() if n) + f" of {len(words)} cells"


def _gains(rows: pd.DataFrame) -> str:
    return ", ".join(
        f"{_value(row, 'gain', f'predicted {row.gain_predicted:.2f}')} at {row.noise} noise"
        for row in rows.itertuples()
    )


def _value(row: Any, name: str, more: str = "") -> str:
    """A figure with its interval, where it has one."""
    value, low, high = (float(getattr(row, f"{name}{end}")) for end in ("", "_low", "_high"))
    ends = f"{low:.2f} to {high:.2f}" if np.isfinite([low, high]).all() else "without interval"
    return f"{value:.2f} ({ends}{', ' if more else ''}{more})"


def _some(numbers: pd.Series) -> list[int]:
    """The fewest cameras, the most that are few, and the most."""
    each = sorted(numbers.unique())
    return sorted({each[0], max([n for n in each if n <= FEW], default=each[0]), each[-1]})
