"""Two ways of measuring on the same images: what their difference is, how sure, and what may be said of it.

Both met the same frames under the same noise, so what counts are differences, draw by draw. Draws of one scene share
its geometry, and so do the levels of a factor that it was seen at, which share each draw's noise too: over several
scenes a scene is one value, and only of a single scene are draws the units, each with all its levels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from testfield.statistics.clusters import Estimate, mean_of_clusters
from testfield.statistics.decide import Margin, equivalence, holm

LEVEL = 0.05


class Word(Enum):
    """What is said of a difference. `EQUIVALENT` where it is shown to be smaller than what matters, whatever its
    sign."""

    BETTER = "better"
    WORSE = "worse"
    EQUIVALENT = "equivalent"
    OPEN = "not shown"
    ONE = "one draw"
    NOTHING = "no result"


@dataclass(frozen=True)
class Difference:
    """Of a figure of which less is better, the mean `first` and `other`, their difference (other minus first) as an
    `estimate`; `unpaired_u` what its uncertainty would be had each met noise of its own; `matters` the difference from
    which on it matters; `chance` and `chance_equivalent` the p-values of no difference and of one that matters, as they
    are or adjusted for many; `draws` in which both gave a figure, of `scenes`."""

    first: float
    other: float
    estimate: Estimate
    unpaired_u: float
    matters: float
    chance: float
    chance_equivalent: float
    draws: int
    scenes: int

    @property
    def word(self) -> Word:
        """What is said. A difference that is certain but certainly too small to matter is none."""
        if not self.draws:
            return Word.NOTHING
        if not self.estimate.freedom > 0:
            return Word.ONE
        if self.chance_equivalent < LEVEL:
            return Word.EQUIVALENT
        if self.chance < LEVEL:
            return Word.BETTER if self.estimate.value < 0 else Word.WORSE
        return Word.OPEN


def difference(first: Sequence[np.ndarray], other: Sequence[np.ndarray], matters: float) -> Difference:
    """The difference of two figures, given scene by scene as arrays (levels, draws) or (draws,), not a number where one
    gave none.

    With one scene the draws are the units, each with all levels, and the conclusion is of this scene; with more, the
    scenes.
    """
    both = [pair for a, b in zip(first, other, strict=True) if (pair := _levels(a, b)) is not None]
    if not both:
        none = Estimate(np.nan, np.nan, 0)
        return Difference(np.nan, np.nan, none, np.nan, matters, 1.0, 1.0, 0, 0)
    means = np.array([np.nanmean(scene, axis=2).mean(axis=1) for scene in both])
    if len(both) > 1:
        estimate, *apart = (mean_of_clusters(part) for part in (means[:, 1] - means[:, 0], *means.T))
    else:
        first_draws, other_draws = both[0]
        parts = (other_draws - first_draws, first_draws, other_draws)
        estimate, *apart = (mean_over_levels(part) for part in parts)
    return Difference(
        first=float(means[:, 0].mean()),
        other=float(means[:, 1].mean()),
        estimate=estimate,
        unpaired_u=float(np.hypot(apart[0].u, apart[1].u)),
        matters=matters,
        chance=estimate.chance(0.0),
        chance_equivalent=equivalence(estimate, 0.0, Margin(matters, matters, "named by the user")),
        draws=sum(int(np.isfinite(scene[0]).sum()) for scene in both),
        scenes=len(both),
    )


def mean_over_levels(values: np.ndarray) -> Estimate:
    """The mean of the means of levels, given as an array (levels, draws), not a number where a draw gave none: every
    level counts alike.

    A draw's noise is the same at all levels, so they are not independent of each other: the units are draws, each with
    all its levels (METHODS section 9.2). Of a level of one draw the uncertainty is not a number.
    """
    good = np.isfinite(values)
    count = good.sum(axis=1)
    mean = np.nanmean(values, axis=1)
    value, n = float(mean.mean()), int(good.any(axis=0).sum())
    if count.min() < 2:
        return Estimate(value, np.nan, 0)
    of_draws = np.where(good, (values - mean[:, None]) / count[:, None], 0).mean(axis=0)
    return Estimate(value, float(np.sqrt(n / (n - 1) * (of_draws**2).sum())), n - 1)


def _levels(first: np.ndarray, other: np.ndarray) -> np.ndarray | None:
    """(2, levels, draws) both figures where both gave one, not numbers elsewhere, of those levels that have any; None
    where there are none."""
    both = np.stack([np.atleast_2d(first), np.atleast_2d(other)]).astype(float)
    both[:, ~np.isfinite(both).all(axis=0)] = np.nan
    both = both[:, np.isfinite(both[0]).any(axis=1)]
    return both if both.size else None


def together(differences: Sequence[Difference]) -> list[Difference]:
    """The same with both kinds of chances adjusted for their number (Holm): any false "better" or "worse" among all of
    them comes with no more than `LEVEL`, and so does any false "equivalent"."""
    chances = holm(np.array([one.chance for one in differences]))
    equivalent = holm(np.array([one.chance_equivalent for one in differences]))
    return [
        replace(one, chance=float(p), chance_equivalent=float(q))
        for one, p, q in zip(differences, chances, equivalent, strict=True)
    ]
