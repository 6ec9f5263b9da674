"""A study: a claim, the cases that put it to the test, and what is found."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.evaluate.execute import execute, finished
from testfield.evaluate.failures import FAILURE
from testfield.score.scorecard import plain
from testfield.store.atomic import whole
from testfield.store.stamp import stamp
from testfield.store.text import write_text
from testfield.store.work import Pool
from testfield.study.conclusion import concluded, read_conclusion
from testfield.study.finding import Finding, Outcome, verdict_of


@dataclass(frozen=True)
class Table:
    """A table on the page: `frame` under `title`, numbers by pandas' `formats` (column to format string)."""

    title: str
    frame: pd.DataFrame
    note: str = ""
    formats: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Plot:
    """A figure on the page: `draw` (axes, data) draws `data`, which is kept as `name`.csv beside it.

    `size_in` of the drawing; where `columns` or `rows` is more than 1, `draw` gets an array of axes.
    """

    name: str
    title: str
    caption: str
    data: pd.DataFrame
    draw: Callable[[Any, pd.DataFrame], None]
    size_in: tuple[float, float] = (7.2, 3.8)
    columns: int = 1
    rows: int = 1


@dataclass(frozen=True)
class Results:
    """What a study found: its findings, and the tables and plots of its page (those without a row are left out)."""

    findings: list[Finding]
    tables: list[Table] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)

    def __getitem__(self, name: str) -> Finding:
        return next(finding for finding in self.findings if finding.name == name)


@dataclass(frozen=True)
class Study:
    """A study by name: the thesis' `claim`, the names of the findings that it `rests_on`, its `cases` (quick or whole),
    how their table is `read`, and the file of its `conclusion`."""

    name: str
    title: str
    claim: str
    rests_on: tuple[str, ...]
    cases: Callable[[bool], list[Case]]
    read: Callable[[pd.DataFrame], Results]
    conclusion: Path

    def verdict(self, results: Results) -> Outcome:
        """Whether the claim holds, fails or is open."""
        return verdict_of([results[name].outcome for name in self.rests_on])

    def concluded(self, results: Results) -> list[str]:
        """The paragraphs of the conclusion that the findings' outcomes allow."""
        return concluded(read_conclusion(self.conclusion), results.findings)


@dataclass(frozen=True)
class Extent:
    """How much of a study is done: `cases`, those that are `done`, the rows of those that gave no figures, and whether
    it is the `quick` setting."""

    cases: int
    done: int
    failures: list[dict[str, Any]]
    quick: bool


def run_study(
    study: Study, folder: Path, quick: bool, jobs: int, so_far: bool = False, pool: Pool | None = None
) -> Results:
    """Do what is missing of a study's cases, by `jobs` processes or a `pool`, and write its page, figures, their data
    and `findings.json`.

    With `so_far` nothing is done any more: the findings are those of the finished cases. Raises `TestfieldError` where
    there are none, or where all failed.
    """
    from testfield.study.page import write_page

    cases = study.cases(quick)
    table = execute(cases, folder, jobs, study.name, so_far, pool)
    if table.empty:
        raise TestfieldError("no case is finished", str(folder), f"begin with `testfield study {study.name}`")
    done = len(finished(cases, folder, pool)) if so_far else len(cases)
    good = table[table[FAILURE].isna()].drop(columns=FAILURE) if FAILURE in table else table
    if good.empty:
        raise TestfieldError(
            f"all cases failed, the first of them thus: {table[FAILURE].iloc[0]}", str(folder), "mend this and go on"
        )
    results = study.read(good)
    failures = table[table[FAILURE].notna()].to_dict("records") if FAILURE in table else []
    extent = Extent(cases=len(cases), done=done, failures=failures, quick=quick)
    with whole(folder / "findings.json") as path:
        write_text(path, json.dumps(plain(summary(study, results, extent)), indent=1, allow_nan=False))
    write_page(study, results, extent, folder)
    return results


def summary(study: Study, results: Results, extent: Extent) -> dict[str, Any]:
    """What `findings.json` says."""
    return stamp() | {
        "study": study.name,
        "quick": extent.quick,
        "claim": study.claim,
        "rests_on": list(study.rests_on),
        "verdict": str(study.verdict(results)),
        "findings": [finding.row() for finding in results.findings],
        "conclusion": study.concluded(results),
        "cases": extent.cases,
        "done": extent.done,
        "failed": len(extent.failures),
    }
