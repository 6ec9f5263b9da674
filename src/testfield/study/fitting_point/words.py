"""What the study on the fitted point says. Each claim is one comparison of figures, which picks the words; what was
not measured is not said."""

import numpy as np
import pandas as pd

from testfield.study.fitting_point.experiment import LAYOUTS, SCALE_ERROR
from testfield.study.fitting_point.renders import MeanBias
from testfield.study.fitting_point.tables import THESIS, WAYS
from testfield.uncertainty.consistency import hit_band

PPM = f"{1e6 * SCALE_ERROR:.0f} ppm"
UNLIKELY = 0.01
"""Renders whose differences chance makes less often than this differ."""


def verdict(hits: pd.DataFrame, blocks: pd.DataFrame, scale: pd.DataFrame, renders: int) -> str:
    """The verdict on the claim."""
    return " ".join([*_limits(hits, renders), *_first_block(blocks), *_scale_seen(scale)])


def sentences(
    hits: pd.DataFrame, blocks: pd.DataFrame, claims: pd.DataFrame, spread: pd.DataFrame, scale: pd.DataFrame,
    alike: pd.DataFrame, means: dict[str, MeanBias | None], unseen: dict[str, tuple[float, float]],
) -> list[str]:  # fmt: skip
    """What was found, question by question."""
    return [
        *_each_limit(hits), *_all_blocks(blocks), *_renders_alike(alike), *_correlations(claims),
        *_dispersion(spread, unseen), *_mean_residual(spread), *_mean_biases(means), *_scale(scale),
    ]  # fmt: skip


def blind(scale: pd.DataFrame) -> bool | None:
    """Whether mirror images flag a scale error no more often than a true scale, and one-sided end points nearly always;
    None where either is missing."""
    symmetric, one_sided = (row_of(scale, layout, "equal") for layout in LAYOUTS)
    if symmetric is None or one_sided is None:
        return None
    return not _by_more_than_chance(symmetric) and bool(one_sided["flags"] >= hit_band(one_sided["trials"], 0.95)[0])


def row_of(table: pd.DataFrame, layout: str, way: str) -> pd.Series | None:
    """The row of a layout and a way to fit; None where there is none."""
    found = table[(table["layout"] == layout) & (table["way"] == WAYS[way])]
    return found.iloc[0] if len(found) else None


# ------------------------------------------------------------------ the limits
def _limits(hits: pd.DataFrame, renders: int) -> list[str]:
    own = hits[hits["way"] == WAYS["covariance"]]
    if own.empty:
        return ["No trial with a right scale bar is finished, so nothing is said of the limits."]
    accepted = own["accepted"].astype(bool)
    if accepted.all():
        said = "the limits hold" if len(own) == len(LAYOUTS) else "the limit holds"
    elif not accepted.any():
        said = "the limits do not hold" if len(own) == len(LAYOUTS) else "the limit does not hold"
    else:
        said = (
            f"the limit holds ({_list(own['layout'][accepted])}) and does not hold ({_list(own['layout'][~accepted])})"
        )
    counts = "; ".join(f"{row.within} of {row.trials} within the 95 % limit ({row.layout})" for row in own.itertuples())
    missing = [layout for layout in LAYOUTS if layout not in set(own["layout"])]
    lacking = f"; of the other layout ({_list(missing)}) there is no trial" if missing else ""
    given = f"their {renders} renders" if renders > 1 else "their one render"
    return [f"With the bundle's full covariance {said}: {counts}{lacking}; exposures are independent given {given}."]


def _each_limit(hits: pd.DataFrame) -> list[str]:
    own = hits[hits["way"] == WAYS["covariance"]]
    return [
        f"{row.layout}: {row.within} of {row.trials} biases lie within their 95 % limit; {row.low} to {row.high} are "
        f"accepted, so the limit is {'accepted' if row.accepted else 'refused'}."
        for row in own.itertuples()
    ]


def _first_block(blocks: pd.DataFrame) -> list[str]:
    first = blocks[blocks["block"] == 1]
    if first.empty:
        return []
    counts = ", ".join(f"{row.beyond} of {row.trials} ({row.layout})" for row in first.itertuples())
    most, most_99 = int(first["band_high"].max()), int(first["band_99_high"].max())
    as_95 = first["beyond"].between(first["band_low"], first["band_high"]).all()
    as_99 = first["beyond"].between(first["band_99_low"], first["band_99_high"]).all()
    if as_95 and as_99:
        return [
            f"A count of {first['trials'].max()} cannot tell a 95 % limit from a 99 % one: {counts} lay beyond, and "
            "both give that."
        ]
    if as_95:
        return [
            f"In the first block {counts} lay beyond: in 99 cases of 100 a 95 % limit gives up to {most}, a 99 % one "
            f"up to {most_99}."
        ]
    return [f"In the first block {counts} lay beyond, where a 95 % limit gives up to {most} in 99 cases of 100."]


def _all_blocks(blocks: pd.DataFrame) -> list[str]:
    whole = blocks[blocks["trials"] == THESIS]
    (low, high), (low_99, high_99) = hit_band(THESIS, 0.05), hit_band(THESIS, 0.01)
    found = [
        f"The thesis' count, one of {THESIS}, is what a true 95 % limit gives ({low} to {high}) and what a true 99 % "
        f"limit gives ({low_99} to {high_99}), so it cannot tell them apart."
    ]
    if len(whole):
        few, above = int((whole["beyond"] <= 1).sum()), int((whole["beyond"] > high_99).sum())
        found.append(
            f"Here blocks of {THESIS} trials had {whole['beyond'].min()} to {whole['beyond'].max()} biases beyond the "
            f"95 % limit: {few} of {len(whole)} had one or none, as the thesis had, and {above} more than a 99 % limit "
            "gives."
        )
    return found


# ------------------------------------------------------------------ render by render
def _renders_alike(alike: pd.DataFrame) -> list[str]:
    return [
        f"{row.layout}: by their {row.what} the {row.renders} renders "
        f"{'differ by more than chance' if row.p < UNLIKELY else 'cannot be told apart'} (chi-squared "
        f"{row.size:.1f} with {row.freedom} degrees of freedom, p = {row.p:.2g})."
        for row in alike.rename(columns={"chi-squared": "size", "degrees of freedom": "freedom"}).itertuples()
    ]


def _mean_biases(means: dict[str, MeanBias | None]) -> list[str]:
    found = []
    for layout, mean in means.items():
        if mean is None:
            continue
        told = ", ".join(f"{m:+.1f} ± {e:.1f}" for m, e in zip(mean.mean_um, mean.error_um, strict=True))
        along = [axis for axis, differs in zip("xyz", mean.differs, strict=True) if differs]
        if along:
            said = (
                f"Along {_list(along)} it differs from zero: that is the same in every exposure, so it comes from what "
                "renders share (light, lens, detector), not from noise or certificates."
            )
        else:
            said = "It differs from zero by no more than chance."
        found.append(
            f"{layout}: the mean bias of {mean.renders} renders is ({told}) µm, with standard errors from the scatter "
            f"of the renders' means. {said}"
        )
    return found


# ------------------------------------------------------------------ what is claimed
def _correlations(claims: pd.DataFrame) -> list[str]:
    found = []
    for layout in LAYOUTS:
        of = claims[claims["layout"] == layout].set_index(["quantity", "way"])
        if ("fitted point", "alone") not in of.index:
            continue
        point, mean, bias = (of.loc[(quantity, "alone")] for quantity in ("fitted point", "mean residual", "bias"))
        full = ("fitted point", "covariance")
        beside = f" (with the full covariance {of.loc[full].actual_over_claimed:.2f})" if full in of.index else ""
        found.append(
            f"{layout}, correlations ignored: actual over claimed variance is {point.actual_over_claimed:.1f} for the "
            f"fitted point{beside}, {mean.actual_over_claimed:.1f} for the mean relative residual and "
            f"{bias.actual_over_claimed:.2f} for the bias. {_shared(point, bias)}"
        )
    return found


def _shared(point: pd.Series, bias: pd.Series) -> str:
    """What errors that all points share do to the fitted point and to the bias."""
    of_point = (
        "make the fitted point worse than that claim" if point.low > 1
        else "leave the fitted point better than that claim" if point.high < 1
        else "do not show in the fitted point"
    )  # fmt: skip
    of_bias = (
        "cancel in the bias" if bias.high < 1 else "make the bias larger than that claim" if bias.low > 1
        else "do not show in the bias"
    )  # fmt: skip
    return f"Errors that all points share {of_point}, and {of_bias}."


def _dispersion(spread: pd.DataFrame, unseen: dict[str, tuple[float, float]]) -> list[str]:
    found = []
    for layout in LAYOUTS:
        row = row_of(spread, layout, "equal")
        if row is None:
            continue
        low, high = unseen[layout]
        said = (
            ": residuals do not see what all points share" if low > 0
            else ": residuals tell more than there is" if high < 0
            else ", and these trials do not tell the two apart"
        )  # fmt: skip
        found.append(
            f"{layout}, equal weights: dispersion {row['dispersion']:.1f} µm, where the fitted point is off by "
            f"{row['fitted point, actual']:.1f} µm{said}. s_sys {row['s_sys']:.1f} µm "
            f"({row['s_sys, foretold']:.1f} foretold), where a length is uncertain by {row['length, claimed']:.1f} µm. "
            f"Bias {row['bias, actual']:.1f} µm ({row['bias, claimed']:.1f} claimed)."
        )
    return found


def _mean_residual(spread: pd.DataFrame) -> list[str]:
    rows = [(layout, row) for layout in LAYOUTS if (row := row_of(spread, layout, "equal")) is not None]
    told = "; ".join(
        f"{layout} {row['mean residual, ppm']:+.1f} in the mean, {row['its rms']:.1f} rms where "
        f"{row['its rms, claimed']:.1f} are claimed"
        for layout, row in rows
    )
    return [f"Mean relative residual of known over measured lengths, equal weights, ppm: {told}."] if rows else []


# ------------------------------------------------------------------ scale
def _scale_seen(scale: pd.DataFrame) -> list[str]:
    symmetric, one_sided = (row_of(scale, layout, "equal") for layout in LAYOUTS)
    if symmetric is None or one_sided is None:
        return []
    shares = f"{100 * symmetric['flagged']:.0f} %", f"{100 * one_sided['flagged']:.0f} %"
    if blind(scale):
        return [
            f"Mirror-image end points with equal weights are blind to scale: {PPM} were flagged in {shares[0]} of the "
            f"trials, one-sided ones in {shares[1]}."
        ]
    if _by_more_than_chance(symmetric):
        return [
            f"Mirror-image end points with equal weights do see scale here: {PPM} were flagged in {shares[0]} of the "
            f"trials, one-sided ones in {shares[1]}."
        ]
    return [
        f"A scale wrong by {PPM} was flagged in {shares[0]} of the trials by mirror-image end points with equal "
        f"weights, and in {shares[1]} by one-sided ones: too seldom to say that one of them sees it."
    ]


def _scale(scale: pd.DataFrame) -> list[str]:
    found = []
    for layout in LAYOUTS:
        row = row_of(scale, layout, "equal")
        if row is not None:
            found.append(
                f"{layout}, equal weights, scale wrong by {PPM}: bias {row['bias_mm']:.3f} mm "
                f"({row['foretold_mm']:.3f} foretold), mean relative residual {row['residual_ppm']:+.0f} ppm."
            )
    weighted = row_of(scale, "symmetric", "covariance")
    if weighted is not None:
        lost = "is lost" if _by_more_than_chance(weighted) else "is not seen to be lost"
        found.append(
            f"Symmetry {lost} with weights that differ: weighted by the covariance, the symmetric layout's bias is "
            f"{weighted['bias_mm']:.3f} mm ({weighted['foretold_mm']:.3f} foretold)."
        )
    if blind(scale):
        found.append(
            "So publish both layouts' bias, and the mean relative residual beside it: what one of them does not see, "
            "another does."
        )
    return found


def _by_more_than_chance(row: pd.Series) -> bool:
    """Whether a true scale would be flagged less often."""
    return bool(row["flags"] > hit_band(int(row["trials"]), 0.05)[1])


def _list(words: "pd.Series | list[str] | np.ndarray") -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else str(last)
