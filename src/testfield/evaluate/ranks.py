"""Ranks with intervals: which places a recipe may have, from all pairs of recipes together."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd

from testfield.evaluate.paired import LEVEL, difference, together


def rank_intervals(figures: Mapping[str, Sequence[np.ndarray]], matters: float) -> pd.DataFrame:
    """Of each recipe, whose figures are given as `difference` takes them, its `mean`, its `rank` by that, and the
    `best` and `worst` place that it may have: as many are shown to be better than it, and worse.

    All pairs are tested together (Holm), so with 95 % all intervals hold the true places at once (Mohamad, Goeman and
    van Zwet, "Adjusting simultaneous confidence intervals for ranks", 2019). A recipe without figures has no place.
    """
    own = {name: values for name, values in figures.items() if any(np.isfinite(v).any() for v in values)}
    pairs = list(combinations(own, 2))
    tested = together([difference(own[a], own[b], matters) for a, b in pairs])
    better = dict.fromkeys(own, 0)  # how many are shown to be better than this
    worse = dict.fromkeys(own, 0)
    for (a, b), one in zip(pairs, tested, strict=True):
        if one.chance < LEVEL:
            first, last = (a, b) if one.estimate.value > 0 else (b, a)
            better[last] += 1
            worse[first] += 1
    mean = {name: np.mean([np.nanmean(v) for v in values if np.isfinite(v).any()]) for name, values in own.items()}
    order = sorted(own, key=lambda name: mean[name])
    return pd.DataFrame(
        [
            {
                "recipe": name,
                "mean": float(mean[name]),
                "rank": 1 + order.index(name),
                "best": 1 + better[name],
                "worst": len(own) - worse[name],
            }
            for name in own
        ],
        columns=["recipe", "mean", "rank", "best", "worst"],
    )
