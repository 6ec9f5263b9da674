"""A study: a claim, the cases that put it to the test, and what is found."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from testfield.errors import TestfieldError
from testfield.score.scorecard import plain
from testfield.store.atomic import whole
from testfield.store.stamp import stamp
from testfield.store.text import write_text
from testfield.study.cases import Case
from testfield.study.run_cases import FAILURE, finished, run_cases


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
class Findings:
    """What a study found: the `verdict` in a sentence, `sentences` that answer its questions, tables and plots, and
    the key `figures` by name."""

    verdict: str
    sentences: list[str]
    tables: list[Table] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A study by name: the thesis' `claim`, its `cases` (quick or whole), and how their table is `read`."""

    name: str
    title: str
    claim: str
    cases: Callable[[bool], list[Case]]
    read: Callable[[pd.DataFrame], Findings]


def run_study(study: Study, folder: Path, quick: bool, jobs: int, so_far: bool = False) -> Findings:
    """Do what is missing of a study's cases, and write its page, figures, their data and `findings.json`.

    With `so_far` nothing is done any more: the findings are those of the finished cases. Raises `TestfieldError` where
    there are none, or where all failed.
    """
    from testfield.report.study import write_page

    cases = study.cases(quick)
    table = run_cases(cases, folder, jobs, study.name, so_far)
    if table.empty:
        raise TestfieldError("no case is finished", str(folder), f"begin with `testfield study {study.name}`")
    done = len(finished(cases, folder)) if so_far else len(cases)
    good = table[table[FAILURE].isna()].drop(columns=FAILURE) if FAILURE in table else table
    if good.empty:
        raise TestfieldError(
            f"all cases failed, the first of them thus: {table[FAILURE].iloc[0]}", str(folder), "mend this and go on"
        )
    findings = study.read(good)
    failures = table[table[FAILURE].notna()].to_dict("records") if FAILURE in table else []
    summary = stamp() | {
        "study": study.name, "quick": quick, "claim": study.claim, "verdict": findings.verdict,
        "sentences": findings.sentences, "figures": findings.figures,
        "cases": len(cases), "done": done, "failed": len(failures),
    }  # fmt: skip
    with whole(folder / "findings.json") as path:
        write_text(path, json.dumps(plain(summary), indent=1, allow_nan=False))
    write_page(study, findings, failures, folder, quick, f"{done} of {len(cases)}" if done < len(cases) else "")
    return findings
