"""A suite is recorded, and checked: draws of noise until every figure is decided, within the budget."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from testfield.errors import TestfieldError, nearest
from testfield.evaluate.execute import execute
from testfield.evaluate.regress.baseline import Baseline, made_here
from testfield.evaluate.regress.cases import Setup, cases_of, numbers_of, setups_of, values_of, why_failed
from testfield.evaluate.regress.suite import Figure, Suite
from testfield.evaluate.regress.verdict import Finding, Verdict, judged
from testfield.store.work import Pool

GROWTH = 1.5
"""How many times as many draws the next look has. Looks cost nothing: the interval holds at all numbers at once."""


@dataclass(frozen=True)
class Checked:
    """All `findings` of a check in the order of the suite, the `rows` they are from, and draws that were measured."""

    findings: list[Finding]
    rows: pd.DataFrame
    looks: tuple[int, ...]

    @property
    def lacking(self) -> list[Finding]:
        """Those of which the baseline has nothing."""
        return [one for one in self.findings if one.verdict is Verdict.MISSING and not len(one.base)]


def recorded(suite: Suite, folder: Path, jobs: int = 1, pool: Pool | None = None) -> tuple[Baseline, list[str]]:
    """The baseline of a suite, with as many draws as its budget, and what is to be said of it. Cases are kept in
    `folder`. Raises `TestfieldError` where no row has one of the figures."""
    setups = setups_of(suite)
    draws = range(1, suite.budget + 1)
    rows = execute(cases_of(setups, draws, suite, "baseline"), folder, jobs, "record", pool=pool)
    figures: dict[tuple[str, str, str], np.ndarray] = {}
    said = []
    for setup in setups:
        for figure in suite.figures_of(setup.title):
            values = values_of(rows, setup.name, figure.key, draws)
            if values is None:
                raise TestfieldError(
                    f"no row of scene '{setup.title}' has a number '{figure.key}'",
                    f"{suite.source}, figure",
                    why_failed(rows, setup.name) or nearest(figure.key, numbers_of(rows, setup.name)),
                )
            if figure.matters_at(float(np.mean(values))) == 0:
                raise TestfieldError(
                    f"'{figure.key}' of scene '{setup.title}' is 0, of which a percentage is nothing",
                    f"{suite.source}, figure '{figure.key}', matters_percent",
                    "give `matters`, in the figure's unit",
                )
            figures[(*setup.name, figure.key)] = values
            if bad := int((~np.isfinite(values)).sum()):
                why = why_failed(rows, setup.name)
                said.append(
                    f"{setup.title}, {setup.recipe_name}, {figure.key}: not a number in {bad} of {len(values)} draws"
                    + (f" ({why})" if why else "")
                )
    scenes = {setup.title: setup.scene_digest for setup in setups}
    return Baseline(suite.name, suite.budget, scenes, figures, made_here(suite)), said


def checked(
    suite: Suite,
    baseline: Baseline,
    folder: Path,
    jobs: int = 1,
    pool: Pool | None = None,
    title: str = "check",
) -> Checked:
    """Every figure of a suite held against its baseline, under the same noise."""
    setups, here = setups_of(suite), made_here(suite)
    same = all(baseline.made.get(key) == here[key] for key in ("processor", "target"))
    error_rate = suite.error_rate / max(1, sum(len(suite.figures_of(setup.title)) for setup in setups))
    most = min(suite.budget, baseline.draws)
    n, left = min(suite.draws, most), list(setups)
    decided: dict[tuple[str, str, str], Finding] = {}
    kept: dict[tuple[str, str], pd.DataFrame] = {}
    looks = []
    while left:
        looks.append(n)
        draws = range(1, n + 1)
        rows = execute(cases_of(left, draws, suite, "check"), folder, jobs, f"{title}, {n} draws", pool=pool)
        for setup in left:
            kept[setup.name] = own = rows[(rows.scene == setup.title) & (rows.recipe == setup.recipe_name)]
            for figure in suite.figures_of(setup.title):
                name = (*setup.name, figure.key)
                if name not in decided or decided[name].verdict is Verdict.UNKNOWN:
                    base = baseline.figures.get(name)
                    decided[name] = judged(
                        *setup.name,
                        figure,
                        None if base is None else base[:n],
                        values_of(own, setup.name, figure.key, draws),
                        error_rate,
                        suite.arithmetic,
                        same,
                        why_failed(own, setup.name),
                    )
        left = [setup for setup in left if _open(decided, setup)] if n < most else []
        n = min(most, int(np.ceil(GROWTH * n)))
    findings = [_worded(one, suite.budget, baseline.draws) for one in decided.values()] + _gone(baseline, decided)
    return Checked(findings, pd.concat(kept.values(), ignore_index=True), tuple(looks))


def _open(decided: dict[tuple[str, str, str], Finding], setup: Setup) -> bool:
    return any(one.verdict is Verdict.UNKNOWN for name, one in decided.items() if name[:2] == setup.name)


def _worded(finding: Finding, budget: int, draws: int) -> Finding:
    """What was looked at until the end says what would decide it."""
    if finding.verdict is not Verdict.UNKNOWN:
        return finding
    do = "raise the budget" if budget < draws else f"the baseline has {draws} draws: record it with a larger budget"
    return replace(finding, detail=f"not decided in {finding.difference.draws} draws; {do}")


def _gone(baseline: Baseline, decided: dict[tuple[str, str, str], Finding]) -> list[Finding]:
    """What the baseline has and the suite no longer asks for."""
    found = []
    for (scene, recipe, key), values in baseline.figures.items():
        if (scene, recipe, key) not in decided:
            finding = judged(scene, recipe, Figure(key, 1.0), values, None, 0.5, why="the suite no longer asks for it")
            found.append(finding)
    return found


def by_weight(findings: Sequence[Finding]) -> list[Finding]:
    """What is no pass, the heaviest first: failing before unknown before improved."""
    order = (Verdict.WORSE, Verdict.NOT_A_NUMBER, Verdict.MISSING, Verdict.UNKNOWN, Verdict.IMPROVED)
    other = [one for one in findings if one.verdict in order]
    return sorted(other, key=lambda one: (order.index(one.verdict), -one.weight if one.weight > 0 else 0.0))
