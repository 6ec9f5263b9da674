"""The one function that does all studies' cases."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from testfield.chain.run import Run
from testfield.errors import TestfieldError
from testfield.study.cases import Case
from testfield.study.run_cases import run_cases
from testfield.study.study import Findings, Plot, Study, Table, run_study

DONE: list[Any] = []


def count(case: Case, run: Run | None) -> list[dict[str, Any]]:
    DONE.append(case.labels["n"])
    if case.labels["n"] in case.options.get("killed", ()):
        raise KeyboardInterrupt
    if case.labels["n"] in case.options.get("hopeless", ()):
        raise TestfieldError("nothing was seen", "here", "look")
    return [{"square": case.labels["n"] ** 2, "row": k} for k in range(2)]


def _cases(numbers: range, **options: Any) -> list[Case]:
    return [Case({"n": n}, f"{__name__}:count", options=options) for n in numbers]


def test_what_is_finished_so_far_can_be_read_while_the_rest_is_not(tmp_path: Path) -> None:
    run_cases(_cases(range(2)), tmp_path)
    DONE.clear()
    assert run_cases(_cases(range(4)), tmp_path, so_far=True)["n"].unique().tolist() == [0, 1] and not DONE
    study = Study("squares", "Squares", "They grow.", lambda quick: _cases(range(4)), lambda table: Findings("So.", []))
    run_study(study, tmp_path, False, 1, so_far=True)
    assert "2 of 4 cases are done" in (tmp_path / "report.html").read_text()
    with pytest.raises(TestfieldError, match="no case is finished"):
        run_study(study, tmp_path / "empty", False, 1, so_far=True)


def test_a_study_of_which_all_cases_fail_says_why_the_first_did(tmp_path: Path) -> None:
    def read(table: pd.DataFrame) -> Findings:
        raise AssertionError("there is nothing to read")

    study = Study("squares", "Squares", "They grow.", lambda quick: _cases(range(2), hopeless=[0, 1]), read)
    with pytest.raises(TestfieldError, match=r"all cases failed.*here: nothing was seen; look"):
        run_study(study, tmp_path, False, 1)
    assert not (tmp_path / "findings.json").exists()


def test_a_study_writes_its_page_its_figures_and_their_data(tmp_path: Path) -> None:
    def read(table: pd.DataFrame) -> Findings:
        data = table[["n", "square"]]
        plot = Plot("squares", "Squares", "As they grow.", data, lambda axes, d: axes.plot(d["n"], d["square"]))
        return Findings(
            "It holds.",
            ["Squares grow."],
            [Table("All", data)],
            [plot],
            {"largest": data["square"].max(), "none": float("nan")},
        )

    study = Study("squares", "Squares", "They grow.", lambda quick: _cases(range(2 if quick else 3)), read)
    run_study(study, tmp_path, True, 1)
    page = (tmp_path / "report.html").read_text()
    assert "It holds." in page and "<svg" in page and "testfield study squares --quick" in page
    assert pd.read_csv(tmp_path / "squares.csv")["square"].tolist() == [0, 0, 1, 1]
    assert json.loads((tmp_path / "findings.json").read_text())["figures"] == {"largest": 1, "none": None}
