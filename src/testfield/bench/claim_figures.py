"""What independent trials say of a claimed covariance: NEES, coverage, and checks whose bands come from the spread
between the trials (METHODS sections 9.1 and 9.2).

All errors of one trial share its calibration, so a trial is one value, however many regions it has.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from testfield.evaluate.check import Check, Limit
from testfield.statistics.clusters import mean_of_clusters, share_of_clusters
from testfield.statistics.consistency import nees_band, trials_to_tell

P = 0.95
LEVEL = 0.01
"""True claims are called false in so many suites, over all figures of a suite together."""
POWER = 0.95
"""As often a suite of `enough_trials` sees a covariance that is `WRONG`."""
WRONG = 1.2
"""A covariance so many times too large or too small (10 % in the uncertainty) would mislead who relies on it."""


@dataclass(frozen=True)
class Errors:
    """Errors of one trial and what was claimed of them: `error` (d,), `cov` (d, d), in parts of `size`, each
    with a coverage region of its own."""

    error: np.ndarray
    cov: np.ndarray
    size: int

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of all together, per degree of freedom."""
        return float(self.error @ np.linalg.solve(self.cov, self.error)) / max(len(self.error), 1)

    @property
    def covered(self) -> np.ndarray:
        """Whether each part lies in its own region at `P`."""
        parts = [slice(k, k + self.size) for k in range(0, len(self.error), self.size)]
        radius = [self.error[s] @ np.linalg.solve(self.cov[s, s], self.error[s]) for s in parts]
        return np.array(radius) <= chi2.ppf(P, self.size)


@dataclass(frozen=True)
class Tally:
    """One group's figures over n trials: `nees` (n,) per degree of freedom, `hits` (n,) parts in their own regions at
    `P`, `parts` (n,) all of them."""

    nees: np.ndarray
    hits: np.ndarray
    parts: np.ndarray

    @staticmethod
    def of(trials: list[Errors]) -> "Tally":
        """The figures of trials."""
        covered = [trial.covered for trial in trials]
        return Tally(
            nees=np.array([trial.nees for trial in trials]),
            hits=np.array([part.sum() for part in covered], int),
            parts=np.array([len(part) for part in covered], int),
        )


def summary(trials: list[Errors]) -> dict[str, Any]:
    """A group's figures over trials: `nees` with what true claims give by chi-squared (`nees_band_95`), `coverage_95`
    of all `regions`, and the 95 % intervals of both by the spread between trials (None of a single one)."""
    tally = Tally.of(trials)
    share, *ends = share_of_clusters(tally.hits, tally.parts, P)
    several = len(trials) > 1
    return {
        "degrees_of_freedom": len(trials[0].error),
        "nees": float(tally.nees.mean()),
        "nees_each": tally.nees.tolist(),
        "nees_interval_95": _ends(tally) if several else None,
        "coverage_95": share,
        "regions": int(tally.parts.sum()),
        "coverage_interval_95": ends if several and tally.parts.any() else None,
        "nees_band_95": list(nees_band(sum(len(t.error) for t in trials))),
    }


def _ends(tally: Tally) -> list[float]:
    return list(mean_of_clusters(tally.nees).interval(P))


def enough_trials(freedom: int, groups: int = 1) -> int:
    """How many trials tell a covariance that is `WRONG` by the NEES of a group with so many degrees of freedom, one of
    several `groups` in a suite."""
    return trials_to_tell(freedom, WRONG, LEVEL / (2 * groups), POWER)


def claim_checks(groups: Mapping[str, Tally]) -> list[Check]:
    """What the groups' NEES and coverage say of the claims, three checks a group; none of fewer than two trials.

    A group's NEES must lie within the band about 1, and its coverage within that about `P`, which true claims leave in
    no more than `LEVEL` of all suites; both bands come from the spread between trials. Beside them: whether NEES shows
    that the covariance is less than `WRONG` times wrong, which is open where trials are too few.
    """
    told = {name: tally for name, tally in groups.items() if len(tally.nees) > 1 and tally.parts.any()}
    checks = []
    for name, tally in told.items():
        surely = 1 - LEVEL / (2 * len(told))
        how = f"band of true claims by the spread between {len(tally.nees)} trials"
        nees = mean_of_clusters(tally.nees)
        low, high = nees.interval(surely)
        band = Limit(1 - (high - nees.value), 1 + (nees.value - low))
        checks.append(Check(name=f"{name}: NEES per degree of freedom", value=nees.value, limit=band, how=how))
        share, low, high = share_of_clusters(tally.hits, tally.parts, surely)
        band = Limit(P - (high - share), P + (share - low))
        checks.append(Check(name=f"{name}: coverage of 95 % regions", value=share, limit=band, how=how))
        checks.append(
            Check(
                name=f"{name}: covariance less than {WRONG:g} times wrong",
                value=nees.value,
                interval=nees.interval(surely),
                limit=Limit(1 / WRONG, WRONG),
                how=f"NEES and its interval by the spread between {len(tally.nees)} trials",
            )
        )
    return checks
