"""What small samples give of sigma, by law and for real centre errors of the rendered scene.

Real centre errors are brought to sigma 1 by their own few exposures, which makes exactly normal errors look a little
unlike a normal law. So beside them stand normal errors of the same shape: as many dots and images, the same scatter,
biases of dots that are normal too.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import kurtosis, skew

from testfield.seeds import generator
from testfield.uncertainty.grey_uncertainty import sup_norm_uncertainty
from testfield_studies.grey.samples import BATCHES, LAWS, SIZES, judge, population_draw

SUP, SUM, BESSEL, UNSORTED = "grey, largest gap", "grey, sum of gaps", "Bessel", "grey, not sorted"
SHOWN = (SUP, SUM, BESSEL)
NAMED = {"forward_model": "forward model", "grey_centroid": "grey centroid"}
DOT, IMAGE = "one dot, many images", "one image, many dots"
TYPICAL = {DOT: 5, IMAGE: 30}
"""How large a sample of either is looked at."""
ALIKE = 200
"""Sets of normal errors of the same shape; from so many, POOLED of them, samples are drawn too."""
POOLED = 20
FEWEST = 4
"""Exposures that a kurtosis needs."""
SURE = 3.0
"""A difference is one where it is more than so many standard uncertainties."""


@dataclass(frozen=True)
class Judged:
    """Rows of `judge`, of all laws and errors."""

    rows: pd.DataFrame

    def of(self, law: str, estimator: str, n: int, key: str = "mean_ratio") -> float:
        """One figure."""
        own = self.rows
        own = own[(own["law"] == law) & (own["estimator"] == estimator) & (own["n"] == n)]
        return float(own[key].iloc[0])

    def off(self, law: str, one: str, other: str, n: int, key: str = "mean_ratio") -> tuple[float, float]:
        """Interval of the difference of two estimators, one minus the other."""
        off = self.of(law, one, n, key) - self.of(law, other, n, key)
        wide = SURE * np.hypot(self.of(law, one, n, f"u_{key}"), self.of(law, other, n, f"u_{key}"))
        return off - wide, off + wide

    def spread(self, laws: list[str], estimator: str, n: int) -> tuple[str, str, float, float]:
        """The laws of the least and the largest estimate over sigma, that range, and its standard uncertainty."""
        at = {law: self.of(law, estimator, n) for law in laws}
        low, high = min(laws, key=at.__getitem__), max(laws, key=at.__getitem__)
        u = [self.of(law, estimator, n, "u_mean_ratio") for law in (low, high)]
        return low, high, at[high] - at[low], float(np.hypot(u[0], u[1]))


@dataclass(frozen=True)
class Samples:
    """All that is known of small samples: `judged` of all laws and errors, `described` a row for each kind of real
    error, the `laws` that are there and the names of the `images`' errors."""

    judged: Judged
    described: list[dict[str, Any]]
    laws: list[str]
    images: list[str]


def samples_of(table: pd.DataFrame) -> Samples | None:
    """From the rows of the laws and of the exposures; None where there is neither."""
    laws = table[table["part"] == "law"]
    errors = errors_of(table[table["part"] == "exposures"])
    if laws.empty and not errors:
        return None
    count = int(laws["samples"].max()) // 4 if len(laws) else 5000
    real = {f"{kind} ({name})": groups for name, own in errors.items() for kind, groups in populations(own).items()}
    rows = [
        row for name, groups in real.items() for n in SIZES for row in judge(name, population_draw(groups), n, count)
    ]
    columns = list(rows[0]) if rows else list(laws.columns)
    judged = Judged(pd.concat([laws[columns] for _ in laws.index[:1]] + [pd.DataFrame(rows)], ignore_index=True))
    return Samples(
        judged=judged,
        described=[row for name, own in errors.items() for row in _described(name, own, judged, count)],
        laws=[law for law in LAWS if law in set(judged.rows["law"])],
        images=[name for name in real if name.startswith(IMAGE)],
    )


def errors_of(shots: pd.DataFrame) -> dict[str, np.ndarray]:
    """Centre errors (exposures, coordinates) in px by centroid estimator, all x before all y.

    Dots that were not measured in every exposure are left out.
    """
    found: dict[str, np.ndarray] = {}
    for centroid, own in shots.groupby("centroid") if len(shots) else ():
        wide = own.pivot(index="exposure", columns=["station", "mark"], values=["error_x_px", "error_y_px"])
        errors = wide.dropna(axis=1).to_numpy(float)
        if len(errors) >= FEWEST and errors.shape[1] >= BATCHES:
            found[NAMED.get(str(centroid), str(centroid))] = errors
    return found


def populations(errors: np.ndarray) -> dict[str, list[np.ndarray]]:
    """Errors (exposures, coordinates) as populations to draw from: a dot's coordinate over all exposures; all dots'
    coordinates of an exposure, x and y by themselves, for a sample is of one coordinate."""
    half = errors.shape[1] // 2
    return {DOT: list(errors.T), IMAGE: [part for row in errors for part in (row[:half], row[half:])]}


def normal_like(errors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Normal errors of the same shape, scatter and bias."""
    scatter, bias = _scatter_and_bias(errors)
    return scatter * rng.normal(size=errors.shape) + bias * rng.normal(size=errors.shape[1])


def _scatter_and_bias(errors: np.ndarray) -> tuple[float, float]:
    """Scatter of a dot's coordinate over exposures, and the dots' biases without what chance adds to means of m."""
    square = errors.var(axis=0, ddof=1).mean()
    return float(np.sqrt(square)), float(np.sqrt(max((errors.mean(axis=0) ** 2).mean() - square / len(errors), 0)))


def shape(groups: list[np.ndarray]) -> tuple[float, float, float]:
    """Skewness and excess kurtosis, free of bias for normal values, and the largest gap over sigma of populations
    (k, m), as means over them."""
    values = np.array([group for group in groups if group.std() > 0])
    gap = sup_norm_uncertainty(values) / values.std(axis=1)
    return (
        float(skew(values, axis=1, bias=False).mean()),
        float(kurtosis(values, axis=1, bias=False).mean()),
        float(gap.mean()),
    )


def _described(name: str, errors: np.ndarray, judged: Judged, count: int) -> list[dict[str, Any]]:
    rng = generator(0, f"grey normal errors/{name}")
    alike = [populations(normal_like(errors, rng)) for _ in range(ALIKE)]
    scatter, bias = _scatter_and_bias(errors)
    m, k = errors.shape
    rows = []
    for kind, groups in populations(errors).items():
        shapes = np.array([shape(some[kind]) for some in alike])
        low, high = np.quantile(shapes, [0.025, 0.975], axis=0)
        skewness, excess, gap = shape(groups)
        law, n = f"{kind} ({name})", TYPICAL[kind]
        pooled = population_draw([group for some in alike[:POOLED] for group in some[kind]])
        normal = Judged(pd.DataFrame(judge(f"normal like {law}", pooled, n, count)))
        row: dict[str, Any] = {
            "errors": law,
            "kind": kind,
            "populations": len(groups),
            "values in each": len(groups[0]),
            "scatter": scatter,
            "bias": bias,
            "bias over scatter": bias / scatter,
            # Of dots without bias, m mean^2 / s^2 is 1 on the mean of k coordinates, with a scatter of sqrt(2 / k).
            "bias is seen": bool(m * (bias / scatter) ** 2 > SURE * np.sqrt(2 / k)),
            "skewness": skewness,
            "excess kurtosis": excess,
            "normal kurtosis, low": float(low[1]),
            "normal kurtosis, high": float(high[1]),
            "gap of all": gap,
            "normal gap, low": float(low[2]),
            "normal gap, high": float(high[2]),
            "n": n,
        }
        for key, estimator in (("largest gap", SUP), ("sum of gaps", SUM), ("Bessel", BESSEL)):
            row[key] = judged.of(law, estimator, n)
            row[f"normal {key}"] = normal.of(f"normal like {law}", estimator, n)
        rows.append(row)
    return rows
