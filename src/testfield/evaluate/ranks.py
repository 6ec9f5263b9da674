"""Ranks with intervals: which places a recipe may have, from all pairs of recipes together."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd

from testfield.evaluate.paired import LEVEL, difference, together


def rank_intervals(figures: Mapping[str, Sequence[np.ndarray]], matters: float) -> pd.DataFrame:
    """Of each recipe, whose figures are given as `difference` takes them, its `mean`, its `rank` by that, and the
    `best` and `worst` place that it may have: as many are shown to be better than it, and worse.

    Means and tests are over those `draws`, of all `of_draws`, in which every recipe that has figures gave one, so that
    nobody gains a place by failing where it is hard. A recipe without figures has no place, and where no draw is common
    to all nobody has.

    All pairs are tested together (Holm), so with 95 % all intervals hold the true places at once (Mohamad, Goeman and
    van Zwet, "Adjusting simultaneous confidence intervals for ranks", 2019).
    """
    own, draws, of_draws = _common(figures)
    pairs = list(combinations(own, 2))
    tested = together([difference(own[a], own[b], matters) for a, b in pairs])
    better = dict.fromkeys(own, 0)  # how many are shown to be better than this
    worse = dict.fromkeys(own, 0)
    for (a, b), one in zip(pairs, tested, strict=True):
        if one.chance < LEVEL:
            first, last = (a, b) if one.estimate.value > 0 else (b, a)
            better[last] += 1
            worse[first] += 1
    mean = {name: mean_of(values) for name, values in own.items()}
    order = sorted(own, key=lambda name: mean[name])
    return pd.DataFrame(
        [
            {
                "recipe": name,
                "mean": mean[name],
                "rank": 1 + order.index(name),
                "best": 1 + better[name],
                "worst": len(own) - worse[name],
                "draws": draws,
                "of_draws": of_draws,
            }
            for name in own
        ],
        columns=["recipe", "mean", "rank", "best", "worst", "draws", "of_draws"],
    )


def mean_of(scenes: Sequence[np.ndarray]) -> float:
    """The mean over scenes, each (levels, draws) or (draws,), of the mean over levels of the mean over draws, as
    `difference` weighs them."""
    levels = [[level[np.isfinite(level)] for level in np.atleast_2d(values)] for values in scenes]
    means = [[level.mean() for level in scene if len(level)] for scene in levels]
    return float(np.mean([np.mean(scene) for scene in means if scene]))


def _common(figures: Mapping[str, Sequence[np.ndarray]]) -> tuple[dict[str, list[np.ndarray]], int, int]:
    """Figures of those that have any, where all of them have one and not numbers elsewhere; how many draws that are,
    and how many there are in which any has one. Nobody's where no draw is common to all."""
    own = {name: values for name, values in figures.items() if any(np.isfinite(v).any() for v in values)}
    given = [np.isfinite(np.stack(scene)) for scene in zip(*own.values(), strict=True)]
    draws, of_draws = (sum(int(which(scene, axis=0).sum()) for scene in given) for which in (np.all, np.any))
    if not draws:
        return {}, 0, of_draws
    kept = {
        name: [np.where(scene.all(axis=0), v, np.nan) for v, scene in zip(values, given, strict=True)]
        for name, values in own.items()
    }
    return kept, draws, of_draws
