"""Stated against actual uncertainty, recipe by recipe: NEES with its band, and how often errors are where stated."""

from collections.abc import Iterable

import numpy as np
import pandas as pd
from scipy.stats import chi2

from testfield.statistics.clusters import share_of_clusters
from testfield.statistics.consistency import nees_band

LEVELS = (0.68, 0.95)
ERROR, STATED = ".interior_error.", ".interior_u."
ONE, EACH = "calibration", "calibration.cameras."
"""Where a row holds the figures of its camera, of several those of the worst; and each one's own."""


def stated_table(rows: pd.DataFrame, recipes: Iterable[str]) -> pd.DataFrame:
    """Of each recipe and of centres, interior orientation and check points: `anees`, squared error over stated
    covariance a degree of freedom, the band `low` to `high` in which 95 % of such figures lie where what is stated is
    true, and the share of errors within their regions at 68 and 95 % (`held_68`, `held_68_low`, ...). Not numbers where
    nothing is stated.

    Centres err by noise of their own. Parameters and points of one scene share its certificates in all draws, so for
    their band a scene counts once. Of several cameras each one's own parameters count: the worst alone would not be as
    good as is stated.
    """
    found = []
    for name in recipes:
        own = rows[rows.recipe == name]
        for what, (squares, freedom, cluster, independent) in _parts(own).items():
            found.append({"recipe": name, "of": what} | _row(squares, freedom, cluster, independent))
    return pd.DataFrame(found)


def _row(squares: np.ndarray, freedom: int, cluster: np.ndarray, independent: float) -> dict[str, float]:
    good = np.isfinite(squares)
    squares, cluster = squares[good], cluster[good]
    row: dict[str, float] = {"anees": np.nan, "low": np.nan, "high": np.nan, "errors": len(squares)}
    if len(squares):
        low, high = nees_band(max(round(independent * freedom), 1))
        row |= {"anees": float(squares.mean() / freedom), "low": low, "high": high}
    _, place = np.unique(cluster, return_inverse=True)
    trials = np.bincount(place)
    for level in LEVELS:
        hits = np.bincount(place, squares <= chi2.ppf(level, freedom), len(trials))
        share = share_of_clusters(hits, trials) if len(squares) else (np.nan,) * 3
        key = f"held_{100 * level:.0f}"
        row |= dict(zip((key, f"{key}_low", f"{key}_high"), share, strict=True))
    return row


Part = tuple[np.ndarray, int, np.ndarray, float]
"""Squared errors over stated covariances, degrees of freedom of each, the cluster of each, how many are independent."""


def _parts(own: pd.DataFrame) -> dict[str, Part]:
    several = own.scene.nunique() > 1
    return {
        "centres": _of_lists(own, "centre_nees", 2, several, by_image=True),
        "interior orientation": _of_parameters(own, several),
        "check points": _of_lists(own, "point_nees", 3, several, by_image=False),
    }


def _of_lists(own: pd.DataFrame, column: str, freedom: int, several: bool, by_image: bool) -> Part:
    squares, clusters, scenes = [], [], []
    for number, row in enumerate(own.to_dict("records")):
        values = row.get(column)
        if values is None or isinstance(values, float):
            continue
        squares.append(np.asarray(values, float))
        scenes.append(row["scene"])
        if several:
            names = [row["scene"]] * len(values)
        else:
            names = [f"{row.get('level', -1)} {k}" for k in row["station"]] if by_image else [f"{number}"] * len(values)
        clusters.append(np.asarray(names, str))
    if not squares:
        return np.zeros(0), freedom, np.zeros(0, str), 0.0
    stated = pd.Series([np.isfinite(values).sum() for values in squares])
    independent = stated.sum() if by_image else stated[stated > 0].groupby(np.array(scenes)[stated > 0]).mean().sum()
    return np.concatenate(squares), freedom, np.concatenate(clusters), float(independent)


def _of_parameters(own: pd.DataFrame, several: bool) -> Part:
    pairs = _pairs(own)
    if not pairs:
        return np.zeros(0), 1, np.zeros(0, str), 0.0
    error, u = (own[list(names)].apply(pd.to_numeric, errors="coerce") for names in zip(*pairs, strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = (error.to_numpy(float) / u.to_numpy(float)) ** 2
    of_one = np.array([not name.startswith(EACH) for name, _ in pairs])
    has_several = np.isfinite(squares[:, ~of_one]).any(axis=1)
    squares[np.ix_(has_several, of_one)] = np.nan
    # A scene's parameters are in error alike in all of its draws, so each counts once, and only where it is stated.
    independent = pd.DataFrame(np.isfinite(squares)).groupby(own.scene.to_numpy(str)).any().to_numpy().sum()
    cluster = np.repeat(own.scene.to_numpy(str) if several else np.arange(len(own)).astype(str), len(pairs))
    return squares.ravel(), 1, cluster, float(independent)


def _pairs(own: pd.DataFrame) -> list[tuple[str, str]]:
    """Columns of a parameter's error and of its stated uncertainty: of a single camera, and of each of several."""
    found = [
        (f"{camera}{ERROR}{name}", key)
        for key in map(str, own)
        for camera, name in [key.rsplit(STATED, 1) if STATED in key else (key, "")]
        if name and (camera == ONE or camera.startswith(EACH))
    ]
    return [pair for pair in found if pair[0] in own]
