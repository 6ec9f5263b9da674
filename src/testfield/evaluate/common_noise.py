"""What common noise is worth: how much of the noise in two recipes' centres is the same, and how much narrower that
makes the interval of their difference than noise of its own for each.

With correlation rho of equal scatters the difference of two centres scatters sqrt(1 - rho) times as much as with noise
of its own for each. An efficient estimator has a correlation of no more than the ratio of scatters with any other
unbiased one (their difference is uncorrelated with the efficient one's error: Rao 1973, 5a.2), so that common noise
helps most between estimators that are nearly as good as each other. A figure of squares, as the rms, keeps rho^2 of it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from testfield.evaluate.bias import centre_errors


def noise_table(rows: pd.DataFrame, recipes: Sequence[str]) -> pd.DataFrame:
    """A row for each recipe but the first: `correlation` of the noise in its centres with that in the first one's, the
    `spread` of its centres' errors over the draws and of the first one's (`spread_first`), px, how many times wider the
    interval of a centre's difference were without common noise (`narrower`), of `items` that both measured in every
    draw of a setup. Not a number where there is one draw."""
    return pd.DataFrame([{"recipe": name} | _pair(rows, recipes[0], name) for name in recipes[1:]])


def _pair(rows: pd.DataFrame, first: str, other: str) -> dict[str, Any]:
    across, squares, freedom, items = 0.0, np.zeros(2), 0, 0
    for _, setup in rows.groupby([name for name in ("scene", "factor", "level") if name in rows]):
        pair = noise_of(setup, first, other)
        if pair is None:
            continue
        a, b = pair
        squares += (a**2).sum(), (b**2).sum()
        across += float((a * b).sum())
        freedom += (len(a) - 1) * a[0].size
        items += a.shape[1]
    if not freedom or not squares.all():
        none = dict.fromkeys(("correlation", "spread", "spread_first", "narrower"), float("nan"))
        return none | {"items": items}
    together = squares.sum() - 2 * across
    return {
        "correlation": across / float(np.sqrt(squares.prod())),
        "spread": float(np.sqrt(squares[1] / freedom)),
        "spread_first": float(np.sqrt(squares[0] / freedom)),
        "narrower": float(np.sqrt(squares.sum() / together)) if together > 0 else float("inf"),
        "items": items,
    }


def noise_of(setup: pd.DataFrame, first: str, other: str) -> tuple[np.ndarray, np.ndarray] | None:
    """What the draws of one setup change of the centres that both recipes measured in all of them: two arrays (draws,
    centres, 2) in px about the mean over the draws; None where there are fewer than two draws or no such centre."""
    both: list[dict[int, pd.DataFrame]] = []
    for name in (first, other):
        by_draw = {row.draw: centre_errors(row) for row in setup[setup.recipe == name].itertuples()}
        both.append({draw: table for draw, table in by_draw.items() if len(table)})
    draws = sorted(both[0].keys() & both[1].keys())
    if len(draws) < 2:
        return None
    tables = [one[draw] for one in both for draw in draws]
    values = pd.concat(tables, axis=1, join="inner").to_numpy(float)
    if not len(values):
        return None
    values = values.reshape(len(values), 2, len(draws), 2).transpose(1, 2, 0, 3)
    values = values - values.mean(axis=1, keepdims=True)
    return values[0], values[1]
