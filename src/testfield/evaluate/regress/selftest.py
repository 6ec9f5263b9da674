"""The suite is put to the test: defects are planted, and each must be found; unchanged code must raise no alarm."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path

import pandas as pd

from testfield.evaluate.regress.baseline import Baseline
from testfield.evaluate.regress.check import Checked, by_weight, checked, recorded
from testfield.evaluate.regress.suite import Suite
from testfield.evaluate.regress.verdict import FAILING, Finding, Verdict, judged
from testfield.measure.recipe import Algorithm, Loaded, Recipe
from testfield.registry import load_file
from testfield.scene.shipped import SHIPPED
from testfield.store.digests import file_digest
from testfield.store.work import Pool

SUITE, CODES = SHIPPED / "regress/selftest.toml", SHIPPED / "regress/codes.toml"
"""The suite in which defects are planted, and the one for misread codes, which are rare."""
PLANTED = Path(__file__).with_name("planted.py")
NAME = "the chain"
"""What every recipe of the self-test is called: a defect does not introduce itself."""
UNCHANGED = 20
"""Checks of unchanged code under other noise."""


@dataclass(frozen=True)
class Defect:
    """A planted defect: what it is, the recipe that has it, and the suite that should find it."""

    title: str
    recipe: Recipe
    suite: Path = SUITE


@dataclass(frozen=True)
class Outcome:
    """What a check said of a defect, or of unchanged code: whether it `found` something worse, after how many `draws`,
    and by which figures, the first and heaviest first; `planted` says whether it should."""

    title: str
    planted: bool
    found: bool
    draws: int
    by: tuple[Finding, ...]
    status: str

    @property
    def as_it_should(self) -> bool:
        """Whether a defect was found, or unchanged code raised no alarm; undecided is none."""
        return self.found if self.planted else not self.found and self.status != "improved"


def _own(**parts: Algorithm) -> Recipe:
    return replace(Recipe(NAME, files=(_loaded(),)), **parts)  # type: ignore[arg-type]


@cache
def _loaded() -> Loaded:
    load_file(PLANTED)  # so that keys know the file from the first case on, as of recipes that are read
    return Loaded(PLANTED, file_digest(PLANTED))


def whole_chain() -> Recipe:
    """The true algorithms, wrapped in the same way and not spoilt."""
    return _own(
        detector=Algorithm("planted_detector"),
        calibrator=Algorithm("planted_calibrator"),
        reconstructor=Algorithm("planted_reconstructor"),
    )


def defects() -> tuple[Defect, ...]:
    """All that is planted."""
    chain = whole_chain()

    def one(title: str, stage: str, suite: Path = SUITE, **options: float | bool | tuple[str, ...]) -> Defect:
        spoilt = {stage: Algorithm(f"planted_{stage}", options)}
        return Defect(title, replace(chain, **spoilt), suite)  # type: ignore[arg-type]

    return (
        one("centres shifted by half a pixel", "detector", shift_px=0.5),
        one("centres shifted by 0.02 px", "detector", shift_px=0.02),
        one("eccentricity correction off", "calibrator", eccentricity=False),
        one("one distortion term (k2) dropped", "calibrator", hold=("k2",)),
        one("covariance of points scaled by 2", "reconstructor", covariance=2.0),
        one("one wrong code in 500", "detector", CODES, wrong_code_in=500),
        one("detector 20 % noisier", "detector", noisier=0.20),
        one("detector 3 % noisier", "detector", noisier=0.03),
        one("one camera's principal point shifted by 0.1 px", "calibrator", principal_point_px=0.1),
        one("datum error of 0.1 mm", "calibrator", datum_mm=0.1),
        one("scale bar read in inches", "calibrator", unit=25.4),
        one("detector two times slower", "detector", times=2),
    )


def suite(path: Path = SUITE, recipe: Recipe | None = None) -> Suite:
    """A suite of the self-test, with the chain as its recipe, or with a spoilt one."""
    return replace(Suite.load(path), recipes=(recipe or whole_chain(),))


def tried(
    folder: Path, jobs: int = 1, pool: Pool | None = None, unchanged: int = UNCHANGED, only: str = ""
) -> Iterator[Outcome]:
    """Record the suites with the true chain; check every defect whose title has the word `only`, then unchanged code
    under the same noise, and under other noise so many times. Cases are kept in `folder`."""
    planted = [defect for defect in defects() if only in defect.title]
    wanted = dict.fromkeys([defect.suite for defect in planted] + [SUITE] * (unchanged > 0))
    baselines = {path: recorded(suite(path), folder, jobs, pool)[0] for path in wanted}
    for defect in planted:
        spoilt = suite(defect.suite, defect.recipe)
        yield outcome(defect.title, True, _checked(spoilt, baselines[defect.suite], folder, jobs, pool))
    if unchanged > 0:
        true = suite()
        yield outcome("unchanged, the same noise", False, _checked(true, baselines[SUITE], folder, jobs, pool))
        yield from under_other_noise(true, baselines[SUITE], unchanged)


def under_other_noise(suite: Suite, baseline: Baseline, most: int = UNCHANGED) -> Iterator[Outcome]:
    """Checks of unchanged code whose noise is not the baseline's: blocks of the recorded draws, each as many as a first
    look takes, are held against one another, every pair in turn.

    A block is in several pairs, so the checks are not independent; no two of a pair have a draw in common.
    """
    n = suite.draws
    blocks = [range(start, start + n) for start in range(0, baseline.draws - n + 1, n)]
    for k, (first, other) in enumerate(list(combinations(blocks, 2))[:most], 1):
        findings = []
        for (scene, recipe, key), values in baseline.figures.items():
            figure = next(one for one in suite.figures_of(scene) if one.key == key)
            rate = suite.error_rate / len(baseline.figures)
            findings.append(judged(scene, recipe, figure, values[list(first)], values[list(other)], rate))
        yield outcome(f"unchanged, other noise, no. {k}", False, Checked(findings, pd.DataFrame(), (n,)))


def _checked(suite: Suite, baseline: Baseline, folder: Path, jobs: int, pool: Pool | None) -> Checked:
    """Checked as a person would, who stops where the answer is known: the first look at which something fails ends it,
    otherwise the last."""
    found = checked(suite.within(suite.draws), baseline, folder, jobs, pool)
    if any(one.verdict in FAILING for one in found.findings):
        return found
    return checked(suite, baseline, folder, jobs, pool)


def outcome(title: str, planted: bool, found: Checked) -> Outcome:
    """What a check says in a row of the table."""
    failing = [one for one in by_weight(found.findings) if one.verdict in FAILING]
    alarms = failing or [one for one in found.findings if one.verdict is Verdict.IMPROVED]
    first = min((one.difference.draws or found.looks[0] for one in failing), default=found.looks[-1])
    by = sorted(failing, key=lambda one: (one.difference.draws or found.looks[0], -one.weight))
    unknown = any(one.verdict is Verdict.UNKNOWN for one in found.findings)
    status = "found" if failing else "improved" if alarms else "undecided" if unknown else "no alarm"
    return Outcome(title, planted, bool(failing), first, tuple(by), status)
