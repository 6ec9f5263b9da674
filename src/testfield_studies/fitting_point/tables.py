"""`study fitting_point`, what is counted: tables of all trials, with the same columns however few rows there are."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2, norm

from testfield.statistics.consistency import hit_band
from testfield_studies.fitting_point.experiment import LAYOUTS

LIMIT = float(chi2.ppf(0.95, 3))
THESIS = 88
"""Points of the thesis, of which one lay beyond its limit."""
WAYS = {
    "equal": "equal weights, full covariance",
    "covariance": "weights and claim of the full covariance",
    "alone": "the same without correlations",
}
AXES = "xyz"
MEASURED = (
    "bar",
    "seed",
    "trial",
    "layout",
    "way",
    "bias_chi2",
    "point_chi2",
    "points_anees",
    "s_sys_mm",
    "expected_s_sys_mm",
    "u_radial_mm",
    "mean_relative_ppm",
    "u_mean_relative_ppm",
    *(f"{name}_{axis}_mm" for name in ("bias", "u_bias", "off", "u_off", "dispersion", "scale_bias") for axis in AXES),
)
"""What is read of a trial's row."""
HITS = (
    "layout",
    "way",
    "trials",
    "within",
    "share",
    "low",
    "high",
    "accepted",
    "NEES of the bias",
    "NEES of the fitted point",
)
BLOCKS = ("layout", "block", "trials", "beyond", "band_low", "band_high", "band_99_low", "band_99_high")
SPREAD = (
    "layout",
    "way",
    "dispersion",
    "fitted point, claimed",
    "fitted point, actual",
    "bias, claimed",
    "bias, actual",
    "s_sys",
    "s_sys, predicted",
    "length, claimed",
    "mean residual, ppm",
    "its rms",
    "its rms, claimed",
)
CLAIMS = ("layout", "way", "quantity", "trials", "actual_over_claimed", "low", "high")
SCALE = (
    "layout",
    "way",
    "trials",
    "bias_mm",
    "predicted_mm",
    "flagged",
    "flags",
    "residual_ppm",
    "flagged_by_residual",
)
SURE = float(norm.ppf(0.995))
"""Half-width of a 99 % interval in standard errors."""


def with_all_columns(table: pd.DataFrame) -> pd.DataFrame:
    """The same rows, with empty columns for what none of them has: of a study of which nothing was measured yet."""
    return table.reindex(columns=[*table.columns, *(name for name in MEASURED if name not in table)])


def of(table: pd.DataFrame, layout: str, way: str) -> pd.DataFrame:
    """Rows of one layout and way to fit."""
    return table[(table["layout"] == layout) & (table["way"] == way)]


def hit_table(right: pd.DataFrame) -> pd.DataFrame:
    """Biases within their limit, by layout and way; of what has no trial there is no row."""
    rows = []
    for layout, way, found in _groups(right, tuple(WAYS)):
        n, within = len(found), int((found["bias_chi2"] <= LIMIT).sum())
        low, high = hit_band(n, 0.95)
        rows.append(
            (
                layout,
                WAYS[way],
                n,
                within,
                within / n,
                low,
                high,
                low <= within <= high,
                found["bias_chi2"].mean() / 3,
                found["point_chi2"].mean() / 3,
            )
        )
    return pd.DataFrame(rows, columns=list(HITS))


def block_table(right: pd.DataFrame) -> pd.DataFrame:
    """Biases beyond their limit in blocks of 88 trials, with the bands of a true 95 % and of a true 99 % limit; a lone
    shorter block is told."""
    rows = []
    for layout, _, found in _groups(right, ("covariance",)):
        beyond = (found.sort_values(["seed", "trial"])["bias_chi2"] > LIMIT).to_numpy()
        size = min(THESIS, len(beyond))
        for k in range(len(beyond) // size):
            count = int(beyond[k * size : (k + 1) * size].sum())
            rows.append((layout, k + 1, size, count, *hit_band(size, 0.05), *hit_band(size, 0.01)))
    return pd.DataFrame(rows, columns=list(BLOCKS))


def spread_table(right: pd.DataFrame) -> pd.DataFrame:
    """Root mean squares in µm of what is claimed and what is; the mean relative residual in ppm."""
    rows = []
    for layout, way, found in _groups(right, tuple(WAYS)):
        rows.append(
            (
                layout,
                WAYS[way],
                *(_rms_um(found, name) for name in ("dispersion", "u_off", "off", "u_bias", "bias")),
                *(1e3 * _rms(found[name]) for name in ("s_sys_mm", "expected_s_sys_mm", "u_radial_mm")),
                float(found["mean_relative_ppm"].mean()),
                _rms(found["mean_relative_ppm"]),
                _rms(found["u_mean_relative_ppm"]),
            )
        )
    return pd.DataFrame(rows, columns=list(SPREAD))


def claims_table(right: pd.DataFrame) -> pd.DataFrame:
    """Actual over claimed variance, the mean chi-squared over its degrees of freedom, with its 99 % interval."""
    rows = []
    for layout, way, found in _groups(right, ("covariance", "alone")):
        z = found["mean_relative_ppm"] / found["u_mean_relative_ppm"]
        for quantity, ratio in (
            ("fitted point", found["point_chi2"] / 3),
            ("bias", found["bias_chi2"] / 3),
            ("mean residual", z**2),
        ):
            rows.append((layout, way, quantity, len(found), float(ratio.mean()), *interval(ratio)))
    return pd.DataFrame(rows, columns=list(CLAIMS))


def scale_table(wrong: pd.DataFrame) -> pd.DataFrame:
    """What a wrong bar does to bias and residuals."""
    rows = []
    for layout, way, found in _groups(wrong, tuple(WAYS)):
        bias, predicted = (
            float(np.linalg.norm([found[f"{name}_{axis}_mm"].mean() for axis in AXES]))
            for name in ("bias", "scale_bias")
        )
        z, flags = found["mean_relative_ppm"] / found["u_mean_relative_ppm"], found["bias_chi2"] > LIMIT
        rows.append(
            (
                layout,
                WAYS[way],
                len(found),
                bias,
                predicted,
                float(flags.mean()),
                int(flags.sum()),
                float(found["mean_relative_ppm"].mean()),
                float((z.abs() > 1.96).mean()),
            )
        )
    return pd.DataFrame(rows, columns=list(SCALE))


def unseen_um2(right: pd.DataFrame, layout: str) -> tuple[float, float]:
    """99 % interval of the fitted point's actual mean square less the one its dispersion tells, equal weights, µm²;
    NaN of fewer than two trials."""
    found = of(right, layout, "equal")
    less = sum(found[f"off_{axis}_mm"] ** 2 - found[f"dispersion_{axis}_mm"] ** 2 for axis in AXES) / 3
    return interval(1e6 * less)


def interval(values: pd.Series) -> tuple[float, float]:
    """99 % interval of the mean of values that are independent given the renders they come from; NaN of fewer than two,
    so that no comparison with it holds."""
    if len(values) < 2:
        return np.nan, np.nan
    half = SURE * float(values.std()) / np.sqrt(len(values))
    return float(values.mean()) - half, float(values.mean()) + half


def _groups(table: pd.DataFrame, ways: tuple[str, ...]) -> list[tuple[str, str, Any]]:
    """Layout, way and rows, of those that have any."""
    found = [(layout, way, of(table, layout, way)) for layout in LAYOUTS for way in ways]
    return [group for group in found if len(group[2])]


def _rms(values: pd.Series) -> float:
    return float(np.sqrt((values**2).mean()))


def _rms_um(found: pd.DataFrame, name: str) -> float:
    return 1e3 * float(np.sqrt(np.mean([(found[f"{name}_{axis}_mm"] ** 2).mean() for axis in AXES])))
