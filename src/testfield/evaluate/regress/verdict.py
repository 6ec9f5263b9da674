"""What a check says of one figure, from the differences under common noise.

Both errors are bounded while looking: a figure that did not change is called worse or improved, and one that changed by
what matters or more passes, each with the error rate at most, however many looks there are, where differences are near
normal. Between nothing and what matters either word is right. Draws that are the same to the last digit pass: a change
that shows in few draws is seen only if one of them was looked at (METHODS section 9.5).
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from testfield.evaluate.regress.suite import Better, Figure
from testfield.statistics.sequential import Sequence, running_mean


class Verdict(Enum):
    """The verdict of a figure."""

    PASS = "pass"
    IMPROVED = "improved"
    WORSE = "worse"
    UNKNOWN = "unknown"
    MISSING = "missing"
    NOT_A_NUMBER = "not a number"
    OTHER_MACHINE = "other machine"


FAILING = (Verdict.WORSE, Verdict.MISSING, Verdict.NOT_A_NUMBER)
"""Verdicts that fail a check."""


@dataclass(frozen=True)
class Finding:
    """What was found of a `figure` of a `scene` measured by a `recipe`.

    `base` and `now` (draws,) are its values in the baseline and in the check, under the same noise; `difference` is of
    now minus base; `matters` the difference that matters, in the figure's unit; `detail` says what else is to be said.
    """

    scene: str
    recipe: str
    figure: Figure
    verdict: Verdict
    base: np.ndarray
    now: np.ndarray
    difference: Sequence
    matters: float
    detail: str = ""

    @property
    def name(self) -> tuple[str, str, str]:
        """Scene, recipe, and the figure's key."""
        return self.scene, self.recipe, self.figure.key

    @property
    def identical(self) -> bool:
        """Whether no draw differs in its last digit."""
        return bool(len(self.now) and np.array_equal(self.base, self.now))

    @property
    def weight(self) -> float:
        """How many times what matters the figure has changed by."""
        if self.verdict in (Verdict.MISSING, Verdict.NOT_A_NUMBER):
            return np.inf
        return abs(self.difference.value) / self.matters if self.matters else np.inf


NOTHING = Sequence(np.nan, -np.inf, np.inf, 0)


def judged(
    scene: str,
    recipe: str,
    figure: Figure,
    base: np.ndarray | None,
    now: np.ndarray | None,
    error_rate: float,
    arithmetic: float = 0.0,
    same_machine: bool = True,
    why: str = "",
) -> Finding:
    """The finding of a figure from its values (n,) in the baseline and now, under the same n draws of noise; None where
    there are none. `arithmetic` is the part of a figure's size, the root of its mean square over the draws, by which
    machines differ, and counts where they do."""

    def found(verdict: Verdict, detail: str = "", difference: Sequence = NOTHING, matters: float = np.nan) -> Finding:
        before, after = (np.zeros(0) if one is None else np.asarray(one, float) for one in (base, now))
        return Finding(scene, recipe, figure, verdict, before, after, difference, matters, detail)

    if base is None:
        return found(Verdict.MISSING, "the baseline does not have it")
    if now is None:
        return found(Verdict.MISSING, why or "no row of the check has it")
    bad, bad_now = ~np.isfinite(base), ~np.isfinite(now)
    if bad.any() or bad_now.any():
        return found(Verdict.NOT_A_NUMBER, _where(bad, bad_now, why))
    level = float(np.mean(base))
    matters, difference = figure.matters_at(level), running_mean(now - base, error_rate)
    if figure.of_the_machine and not same_machine:
        return found(Verdict.OTHER_MACHINE, "recorded on another processor, so not compared", difference, matters)
    detail = ""
    if not same_machine and not np.array_equal(base, now):
        # The mean of a figure about zero, a bias, is no measure of its size; its draws are.
        difference = difference.widened(arithmetic * float(np.sqrt(np.mean(base**2))))
        detail = f"another machine: {arithmetic:g} of the figure may be arithmetic"
    if matters == 0 and not np.array_equal(base, now):
        detail = "the baseline is 0, of which a percentage is nothing; give `matters`"
    return found(_verdict(difference, matters, figure.better), detail, difference, matters)


def _verdict(difference: Sequence, matters: float, better: Better) -> Verdict:
    if difference.low >= -matters and difference.high <= matters:
        return Verdict.PASS
    sure = difference.low > 0 or difference.high < 0
    if not sure or abs(difference.value) < matters:
        return Verdict.UNKNOWN
    if better is Better.SAME or (difference.value > 0) == (better is Better.LESS):
        return Verdict.WORSE
    return Verdict.IMPROVED


def _where(base: np.ndarray, now: np.ndarray, why: str) -> str:
    n = len(base)
    sides = [
        f"{bad.sum()} of {n} draws of the {side}" for bad, side in ((base, "baseline"), (now, "check")) if bad.any()
    ]
    return f"in {' and in '.join(sides)}" + (f": {why}" if why and now.any() else "")


def status_of(findings: list[Finding]) -> int:
    """The exit status: 1 where a figure is worse, missing or no number, 3 where one is unknown, 0 otherwise."""
    verdicts = {one.verdict for one in findings}
    return 1 if verdicts & set(FAILING) else 3 if Verdict.UNKNOWN in verdicts else 0
