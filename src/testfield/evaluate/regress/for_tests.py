"""Figures of somebody's own test held against the baseline of that test, as the fixture `field_regression` does it."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testfield.errors import TestfieldError, nearest
from testfield.evaluate.regress.baseline import Baseline, made_at
from testfield.evaluate.regress.check import GROWTH
from testfield.evaluate.regress.suite import ARITHMETIC, BUDGET, DRAWS, ERROR_RATE, Better, Figure
from testfield.evaluate.regress.summary import said_of
from testfield.evaluate.regress.verdict import FAILING, Finding, Verdict, judged

Metrics = Mapping[str, float | Sequence[float]]
PERCENT = 5.0
"""What matters, in percent, of a figure of which nobody says."""


def name_of(nodeid: str) -> str:
    """What a test is called among those of its folder: pytest's name of it without the folders before its file."""
    file, colons, rest = nodeid.partition("::")
    return f"{file.rpartition('/')[2]}{colons}{rest}"


class Regressed(AssertionError):
    """A figure is worse, missing, no number, or not decided."""


@dataclass(frozen=True)
class FieldRegression:
    """The baseline of a test, `folder`/TEST.json; with `record` it is written and nothing fails."""

    test: str
    folder: Path
    record: bool = False

    @property
    def path(self) -> Path:
        """The baseline's file."""
        return self.folder / f"{re.sub('[^A-Za-z0-9_.-]+', '-', self.test).strip('-')}.json"

    def check(
        self,
        metrics: Metrics | Callable[[int], Mapping[str, float]],
        matters: Mapping[str, float] | None = None,
        better: Mapping[str, str] | None = None,
        draws: int = DRAWS,
        budget: int = BUDGET,
        error_rate: float = ERROR_RATE,
    ) -> None:
        """Hold figures against the baseline.

        `metrics` by name: a number; a list of numbers, one a draw of noise, in the order of the draws; or a function
        that is given the number of a draw, from 1 on, and returns the numbers of it: then draws are added, up to
        `budget`, until every figure is decided. A single number is worse where it differs by what matters; of several
        it is asked whether that is sure. `matters` is the smallest difference that matters, by name (absent: 5 % of the
        baseline's mean), `better` "less", "more" or "same" (absent: less).

        Raises `Regressed`, an `AssertionError`, for what is worse, missing, no number, or not decided; without a
        baseline it stores a candidate beside it and raises too. Raises `TestfieldError` where the baseline is none, or
        `matters` or `better` name a figure that there is not.
        """
        self._check_words(better or {})
        if self.record:
            self._save(_drawn(metrics, budget), self.path)
            return
        if not self.path.exists():
            candidate = self.path.with_suffix(".candidate.json")
            self._save(_drawn(metrics, budget), candidate)
            raise Regressed(
                f"no baseline {self.path}; a candidate was stored in {candidate}: look at it, and rename it to "
                f"{self.path.name}"
            )
        baseline = Baseline.load(self.path)
        if baseline.suite != self.test:
            raise TestfieldError(
                f"this is the baseline of '{baseline.suite}', not of '{self.test}'", f"{self.path}, suite"
            )
        findings = _findings(baseline, metrics, matters or {}, better or {}, draws, budget, error_rate, self._made())
        self._check_names({*(matters or {}), *(better or {})}, [one.figure.key for one in findings])
        bad = [one for one in findings if one.verdict in (*FAILING, Verdict.UNKNOWN)]
        if bad:
            lines = [f"{one.verdict.value}: {one.figure.key}: {said_of(one)}" for one in bad]
            raise Regressed("\n".join([*lines, f"baseline: {self.path}; --field-record writes it anew"]))

    def _check_words(self, better: Mapping[str, str]) -> None:
        known = [one.value for one in Better]
        for name, word in better.items():
            if word not in known:
                raise TestfieldError(f"value '{word}'", f"{self.test}, better, {name}", nearest(word, known))

    def _check_names(self, named: set[str], known: Sequence[str]) -> None:
        """Raise where something is said of a figure that is not here: a misspelt limit would be none."""
        for name in sorted(named - set(known)):
            raise TestfieldError(
                f"no figure is called '{name}'", f"{self.test}, matters or better", nearest(name, known)
            )

    def _made(self) -> dict:
        return made_at(self.folder.parent)

    def _save(self, values: Mapping[str, np.ndarray], path: Path) -> None:
        lengths = {len(one) for one in values.values()}
        if len(lengths) != 1:
            raise TestfieldError(f"figures of {sorted(lengths)} draws", self.test, "give as many draws of each")
        figures = {("", "", key): one for key, one in values.items()}
        Baseline(self.test, lengths.pop(), {}, figures, self._made()).save(path)


def _drawn(metrics: Metrics | Callable[[int], Mapping[str, float]], draws: int) -> dict[str, np.ndarray]:
    if callable(metrics):
        rows = [metrics(draw) for draw in range(1, draws + 1)]
        return {key: np.array([row.get(key, np.nan) for row in rows], float) for key in rows[0]}
    return {key: np.atleast_1d(np.asarray(values, float)) for key, values in metrics.items()}


def _findings(
    baseline: Baseline,
    metrics: Metrics | Callable[[int], Mapping[str, float]],
    matters: Mapping[str, float],
    better: Mapping[str, str],
    draws: int,
    budget: int,
    error_rate: float,
    here: dict,
) -> list[Finding]:
    base = {key: values for (_, _, key), values in baseline.figures.items()}
    same = all(baseline.made.get(key) == here[key] for key in ("processor", "target"))
    rows: list[Mapping[str, float]] = []
    most = min(budget, baseline.draws)
    n = min(draws, most)
    while True:
        if callable(metrics):
            rows += [metrics(draw) for draw in range(len(rows) + 1, n + 1)]
            now = {key: np.array([row.get(key, np.nan) for row in rows], float) for row in rows[:1] for key in row}
        else:
            now, n = _drawn(metrics, 0), baseline.draws
        findings = []
        for key in dict.fromkeys([*base, *now]):
            percent, word = key not in matters, better.get(key, "less")
            figure = Figure(key, PERCENT if percent else matters[key], percent, Better(word))
            findings.append(_judged(figure, base.get(key), now.get(key), n, error_rate / len({*base, *now}), same))
        if not callable(metrics) or n == most or all(one.verdict is not Verdict.UNKNOWN for one in findings):
            return findings
        n = min(most, int(np.ceil(GROWTH * n)))


def _judged(
    figure: Figure, base: np.ndarray | None, now: np.ndarray | None, n: int, error_rate: float, same: bool
) -> Finding:
    """The verdict of a figure; of a single draw, whose spread nobody knows, the difference alone decides."""
    before = None if base is None else base[:n]
    if before is not None and now is not None and len(before) != len(now):
        why = f"{len(now)} draws, and the baseline has {len(before)}"
        return judged("", "", figure, before, None, error_rate, why=why)
    if before is not None and now is not None and n == 1 and np.isfinite([*before, *now]).all():
        twice = judged("", "", figure, np.repeat(before, 2), np.repeat(now, 2), error_rate, ARITHMETIC, same)
        return twice
    return judged("", "", figure, before, now, error_rate, ARITHMETIC, same)
