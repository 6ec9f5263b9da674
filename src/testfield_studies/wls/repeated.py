"""Study `wls`: which part of the errors comes again in every exposure of a scene, and which scatters."""

import numpy as np
import pandas as pd

from testfield.statistics.jackknife import jackknife


def repeated(good: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """By cell and method (`by`) the share of the squared errors that comes again (`repeated`), with its 95 % interval
    by the jackknife; no row of methods whose errors were not kept, nor of fewer than two exposures."""
    columns = [*by, "repeated", "repeated_low", "repeated_high"]
    if "error_mm" not in good:
        return pd.DataFrame(columns=columns)
    kept = good[good["error_mm"].notna()][[*by, "exposure", "set", "codes", "error_mm"]]
    rows = []
    for key, part in kept.groupby(by, observed=True, sort=False):
        found = share(part)
        if found is not None:
            rows.append(dict(zip(columns, [*(key if isinstance(key, tuple) else (key,)), *found], strict=True)))
    return pd.DataFrame(rows, columns=columns)


def share(part: pd.DataFrame) -> tuple[float, float, float] | None:
    """The repeated share of the squared errors of one cell and method, and its interval; None of one exposure alone.

    The mean product of errors of two different exposures of the same target by the same cameras, against the mean
    square: chance alone gives zero on average, an error that is always the same gives one.
    """
    exposures = sorted(part["exposure"].unique())
    targets = sorted({(row.set, int(code)) for row in part.itertuples() for code in row.codes})
    place = {target: k for k, target in enumerate(targets)}
    errors = np.full((len(exposures), len(targets), 3), np.nan)
    for row in part.itertuples():
        columns = [place[row.set, int(code)] for code in row.codes]
        errors[exposures.index(row.exposure), columns] = np.reshape(np.asarray(row.error_mm, float), (-1, 3))
    n = len(errors)
    if n < 2:
        return None
    value = _share(errors)
    if n == 2 or not np.isfinite(value):
        return (value, np.nan, np.nan) if np.isfinite(value) else None
    return jackknife(value, np.array([_share(np.delete(errors, k, axis=0)) for k in range(n)]))


def _share(errors_mm: np.ndarray) -> float:
    """Of errors (exposures, targets, 3), NaN where a target was not measured."""
    there = np.isfinite(errors_mm[..., 0]).sum(axis=0)
    errors = np.nan_to_num(errors_mm[:, there > 1])
    there = there[there > 1]
    square = (errors**2).sum(axis=(0, 2))
    products = (errors.sum(axis=0) ** 2).sum(axis=1) - square
    total = float((square / there).sum())
    return float((products / (there * (there - 1))).sum() / total) if total > 0 else float("nan")
