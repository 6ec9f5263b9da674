"""What an interval decides: on which side of a reference a value lies, whether two things are the same within a
threshold, and how many of several tests may be believed (METHODS section 9.4)."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.stats import t

from testfield.statistics.clusters import Estimate


class Side(Enum):
    """Where a value lies: certainly below or above its reference, the same within a margin, or none of these."""

    BELOW = "below"
    ABOVE = "above"
    SAME = "same"
    OPEN = "open"

    @property
    def sign(self) -> int:
        """-1 below, 1 above, 0 otherwise."""
        return {Side.BELOW: -1, Side.ABOVE: 1}.get(self, 0)


def side_of(
    low: float,
    high: float,
    reference: float = 0.0,
    *,
    value: float | None = None,
    least: float = 0.0,
    same: float = 0.0,
) -> Side:
    """What an interval from `low` to `high` says against a reference.

    Above (below) where all of it is, and the `value` in it is so by more than `least`, so that a narrow interval makes
    nothing of next to nothing; the same where all of it is nearer to the reference than `same`; open otherwise, and
    where an end is not a number.
    """
    middle = (low if low > reference else high) if value is None else value
    if low > reference and middle > reference + least:
        return Side.ABOVE
    if high < reference and middle < reference - least:
        return Side.BELOW
    return Side.SAME if low > reference - same and high < reference + same else Side.OPEN


def side_of_interval(low: float, high: float, other_low: float, other_high: float) -> Side:
    """Whether an interval lies below or above another; open where they have a point in common."""
    return Side.BELOW if high < other_low else Side.ABOVE if low > other_high else Side.OPEN


@dataclass(frozen=True)
class Margin:
    """How far from a reference a value may be and still count as the same, for one stated `reason`."""

    below: float
    above: float
    reason: str


def equivalence(estimate: Estimate, reference: float, margin: Margin) -> float:
    """How likely an estimate is that lies as deep within the margin about the reference where the truth is at its edge
    or beyond: the larger of two one-sided tests (Schuirmann). Below 0.05 the two are the same at 95 %."""
    if not estimate.freedom > 0:
        return 1.0
    depth = np.array([estimate.value - (reference - margin.below), reference + margin.above - estimate.value])
    if estimate.u == 0:
        return float(depth.min() <= 0)
    return float(t.sf(depth / estimate.u, estimate.freedom).max())


def holm(p: np.ndarray) -> np.ndarray:
    """(n,) p-values of n tests, adjusted so that none below a level means a false alarm in all of them together with
    no more than that probability (Holm): each times the number of those not smaller, never falling, at most 1."""
    p = np.asarray(p, float)
    order = np.argsort(p, kind="stable")
    stepped = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    adjusted = np.empty(len(p))
    adjusted[order] = stepped
    return adjusted
