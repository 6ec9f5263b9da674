"""`study fitting_point`, one render after the other: its trials share what light, lens and detector do alike in every
exposure, so they are independent of each other only given that render."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import chi2, t

from testfield_studies.fitting_point.experiment import LAYOUTS
from testfield_studies.fitting_point.tables import AXES, LIMIT, of

RENDERS = (
    "layout",
    "seed",
    "trials",
    "within",
    "share",
    *(f"{what} {axis}, µm" for axis in AXES for what in ("bias", "±")),
)
ALIKE = ("layout", "what", "renders", "chi-squared", "degrees of freedom", "p")
WAY = "covariance"


@dataclass(frozen=True)
class MeanBias:
    """The mean of the renders' mean biases: `mean_um` (3,), `error_um` (3,) its standard errors as these means scatter,
    and whether a component `differs` (3,) from zero, at 95 % for all three together; of `renders` renders."""

    mean_um: np.ndarray
    error_um: np.ndarray
    differs: np.ndarray
    renders: int


def render_table(right: pd.DataFrame) -> pd.DataFrame:
    """Hits and mean bias of each render's trials, with the standard errors of these means."""
    rows = []
    for layout in LAYOUTS:
        for seed, found in of(right, layout, WAY).groupby("seed"):
            within, bias = int((found["bias_chi2"] <= LIMIT).sum()), _bias_um(found)
            # Of a single trial there is no scatter, and so an empty cell.
            error = bias.std(axis=0, ddof=1) / np.sqrt(len(bias)) if len(bias) > 1 else np.full(3, np.nan)
            columns = np.column_stack([bias.mean(axis=0), error]).ravel().tolist()
            rows.append((layout, seed, len(found), within, within / len(found), *columns))
    return pd.DataFrame(rows, columns=list(RENDERS))


def alike_table(right: pd.DataFrame) -> pd.DataFrame:
    """Chi-squared tests of whether renders have the same share of hits, and the same mean bias."""
    rows = []
    for layout in LAYOUTS:
        found = of(right, layout, WAY)
        parts = [part for _, part in found.groupby("seed") if len(part) > 1]
        if len(parts) < 2:
            continue
        for what, (size, freedom) in (("share of hits", _hits_alike(parts)), ("mean bias", _bias_alike(parts))):
            if freedom:
                rows.append((layout, what, len(parts), size, freedom, float(chi2.sf(size, freedom))))
    return pd.DataFrame(rows, columns=list(ALIKE))


def mean_bias(right: pd.DataFrame, layout: str) -> MeanBias | None:
    """The mean bias over renders; None of fewer than two, which do not tell how it scatters."""
    means = np.array([_bias_um(part).mean(axis=0) for _, part in of(right, layout, WAY).groupby("seed")])
    if len(means) < 2:
        return None
    error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    far = float(t.ppf(1 - 0.025 / len(AXES), len(means) - 1))
    return MeanBias(means.mean(axis=0), error, np.abs(means.mean(axis=0)) > far * error, len(means))


def _bias_um(found: pd.DataFrame) -> np.ndarray:
    return 1e3 * found[[f"bias_{axis}_mm" for axis in AXES]].to_numpy(float)


def _hits_alike(parts: list[pd.DataFrame]) -> tuple[float, int]:
    """Chi-squared of hits and misses against the share of all, and its degrees of freedom; 0 where all or none hit."""
    n = np.array([len(part) for part in parts])
    hits = np.array([(part["bias_chi2"] <= LIMIT).sum() for part in parts])
    share = hits.sum() / n.sum()
    if share in (0, 1):
        return 0.0, 0
    return float(((hits - n * share) ** 2 / (n * share * (1 - share))).sum()), len(parts) - 1


def _bias_alike(parts: list[pd.DataFrame]) -> tuple[float, int]:
    """Chi-squared of the mean biases against the mean of all, with the covariance within renders, and its degrees of
    freedom; 0 where too few trials tell that covariance."""
    biases = [_bias_um(part) for part in parts]
    n, within = np.array([len(bias) for bias in biases]), np.concatenate([bias - bias.mean(axis=0) for bias in biases])
    freedom = len(within) - len(parts)
    if freedom < 10 * len(AXES):
        return 0.0, 0
    inverse = np.linalg.inv(within.T @ within / freedom)
    means = np.array([bias.mean(axis=0) for bias in biases])
    off = means - n @ means / n.sum()
    return float((n * np.einsum("si,ij,sj->s", off, inverse, off)).sum()), len(AXES) * (len(parts) - 1)
