"""Two ways of measuring on the same images: what their difference is, how sure, and what may be said of it.

Both met the same frames under the same noise, so what counts are differences, draw by draw. Draws of one scene share
its geometry: over several scenes a scene is one value, and only of a single scene are draws the units.
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


@dataclass(frozen=True)
class Difference:
    """Of a figure of which less is better, the mean `first` and `other`, their difference (other minus first) as an
    `estimate`; `unpaired_u` what its uncertainty would be had each met noise of its own; `matters` the difference from
    which on it matters; `chance` and `chance_equivalent` the p-values of no difference and of one that matters, the
    former as it is or adjusted for many; `draws` in which both gave a figure, of `scenes`."""

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
        if not self.estimate.freedom > 0:
            return Word.ONE
        if self.chance_equivalent < LEVEL:
            return Word.EQUIVALENT
        if self.chance < LEVEL:
            return Word.BETTER if self.estimate.value < 0 else Word.WORSE
        return Word.OPEN


def difference(first: Sequence[np.ndarray], other: Sequence[np.ndarray], matters: float) -> Difference:
    """The difference of two figures, given scene by scene as arrays of draws, not a number where one gave none.

    With one scene the draws are the units and the conclusion is of this scene; with more, the scenes.
    """
    both = [
        (a[good], b[good]) for a, b in zip(first, other, strict=True) if (good := np.isfinite(a) & np.isfinite(b)).any()
    ]
    if not both:
        none = Estimate(np.nan, np.nan, 0)
        return Difference(np.nan, np.nan, none, np.nan, matters, 1.0, 1.0, 0, 0)
    one, two = both[0] if len(both) == 1 else (np.array([pair[k].mean() for pair in both]) for k in (0, 1))
    estimate = mean_of_clusters(two - one)
    apart = np.hypot(mean_of_clusters(one).u, mean_of_clusters(two).u)
    return Difference(
        first=float(one.mean()),
        other=float(two.mean()),
        estimate=estimate,
        unpaired_u=float(apart),
        matters=matters,
        chance=estimate.chance(0.0),
        chance_equivalent=equivalence(estimate, 0.0, Margin(matters, matters, "named by the user")),
        draws=sum(len(a) for a, _ in both),
        scenes=len(both),
    )


def together(differences: Sequence[Difference]) -> list[Difference]:
    """The same with chances of no difference adjusted for their number (Holm): any false word among all of them comes
    with no more than `LEVEL`."""
    adjusted = holm(np.array([one.chance for one in differences]))
    return [replace(one, chance=float(p)) for one, p in zip(differences, adjusted, strict=True)]
