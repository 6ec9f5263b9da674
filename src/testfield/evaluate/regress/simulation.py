"""How often a check of unchanged code raises an alarm: many checks, simulated with the judge that judges real ones.

The hardest case is simulated, in which the check meets other noise than the baseline: under common noise unchanged code
differs by nothing, and no test can be wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testfield.evaluate.regress.check import GROWTH
from testfield.evaluate.regress.suite import BUDGET, DRAWS, ERROR_RATE, Figure
from testfield.evaluate.regress.verdict import Verdict, judged
from testfield.seeds import generator
from testfield.statistics.clusters import clopper_pearson

SPREAD = 0.1
"""Standard deviation of a simulated figure from draw to draw; its mean is 1."""
SHAPES: dict[str, Callable[[np.random.Generator, tuple[int, int]], np.ndarray]] = {
    "normal": lambda rng, shape: rng.standard_normal(shape),
    "heavy tails (Student, 5 degrees)": lambda rng, shape: rng.standard_t(5, shape) / np.sqrt(5 / 3),
    "skewed (chi-squared, 4 degrees)": lambda rng, shape: (rng.chisquare(4, shape) - 4) / np.sqrt(8),
}
"""How a figure scatters, at unit variance."""


@dataclass(frozen=True)
class Alarms:
    """Of so many simulated `checks` of unchanged code so many raised an `alarms`: called a figure worse or improved; in
    `unknown` a figure was undecided after the budget."""

    shape: str
    checks: int
    alarms: int
    unknown: int
    error_rate: float

    @property
    def kept(self) -> bool:
        """Whether the stated error rate was kept, as far as so many checks can tell (95 %, binomial)."""
        return clopper_pearson(self.alarms, self.checks)[0] <= self.error_rate


def simulated(
    shape: str,
    checks: int = 2000,
    figures: int = 10,
    matters: float = SPREAD / 2,
    error_rate: float = ERROR_RATE,
    draws: int = DRAWS,
    budget: int = BUDGET,
) -> Alarms:
    """Checks of `figures` figures of unchanged code whose noise is not the baseline's, each looked at as a check does.

    With `matters` as small as half a figure's spread, so that many looks are needed and many tell nothing: that is
    where looking goes wrong, if it does.
    """
    alarms = unknown = 0
    for k in range(checks):
        rng = generator(k, f"regress/simulation/{shape}")
        base, now = (1 + SPREAD * SHAPES[shape](rng, (figures, budget)) for _ in range(2))
        verdicts = {_decided(*pair, matters, error_rate / figures, draws) for pair in zip(base, now, strict=True)}
        alarms += bool(verdicts & {Verdict.WORSE, Verdict.IMPROVED})
        unknown += Verdict.UNKNOWN in verdicts
    return Alarms(shape, checks, alarms, unknown, error_rate)


def _decided(base: np.ndarray, now: np.ndarray, matters: float, error_rate: float, draws: int) -> Verdict:
    n, figure = draws, Figure("simulated", matters)
    while True:
        verdict = judged("", "", figure, base[:n], now[:n], error_rate).verdict
        if verdict is not Verdict.UNKNOWN or n == len(base):
            return verdict
        n = min(len(base), int(np.ceil(GROWTH * n)))
