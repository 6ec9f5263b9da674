"""What makes a study: findings with rules, a conclusion beside them, a page, and cases that are done once."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from testfield.chain.run import Run
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.evaluate.execute import execute
from testfield.store.code import sources
from testfield.study.conclusion import concluded, read_conclusion
from testfield.study.finding import Finding, Outcome, Quantity, Rule, above, below, less, number, verdict_of, within
from testfield.study.studies import find_study, study_names
from testfield.study.study import Plot, Results, Study, Table, run_study

HOLDS, FAILS, OPEN = Outcome.HOLDS, Outcome.FAILS, Outcome.OPEN
DONE: list[Any] = []


def count(case: Case, run: Run | None) -> list[dict[str, Any]]:
    DONE.append(case.labels["n"])
    if case.labels["n"] in case.options.get("hopeless", ()):
        raise TestfieldError("nothing was seen", "here", "look")
    return [{"square": case.labels["n"] ** 2, "row": k} for k in range(2)]


def _cases(numbers: range, **options: Any) -> list[Case]:
    return [Case({"n": n}, f"{__name__}:count", options=options) for n in numbers]


def _read(table: pd.DataFrame) -> Results:
    data = table[["n", "square"]]
    largest = Finding("largest", "Do squares grow?", {"square": Quantity(data["square"].max())}, above("square", 0.5))
    missing = Finding("missing", "Do cubes grow?", {}, above("cube", 0.5))
    plot = Plot("squares", "Squares", "As they grow.", data, lambda axes, d: axes.plot(d["n"], d["square"]))
    return Results([largest, missing], [Table("All", data)], [plot])


def _study(folder: Path, numbers: range = range(4), **options: Any) -> Study:
    conclusion = folder / "conclusion.md"
    conclusion.write_text("<!-- largest: holds -->\nThey grow to {square.value:.0f}.\n\n<!-- largest: fails -->\nNo.\n")
    return Study(
        name="squares",
        title="Squares",
        claim="They grow.",
        rests_on=("largest",),
        cases=lambda quick: _cases(numbers[:2] if quick else numbers, **options),
        read=_read,
        conclusion=conclusion,
    )


# ------------------------------------------------------------------ rules
@pytest.mark.parametrize(
    ("quantity", "outcome"),
    [
        (Quantity(1.2, 1.1, 1.3), HOLDS),
        (Quantity(0.8, 0.7, 0.9), FAILS),
        (Quantity(1.2, 0.9, 1.5), OPEN),
        (Quantity(1.2), HOLDS),
        (Quantity(1.2, -np.inf, np.inf), OPEN),
        (Quantity(np.inf, 2.0, np.inf), HOLDS),
        (Quantity(np.nan), OPEN),
    ],
)
def test_a_rule_asks_for_the_whole_interval(quantity: Quantity, outcome: Outcome) -> None:
    assert above("x", 1).outcome({"x": quantity}) == outcome
    mirrored = {HOLDS: FAILS, FAILS: HOLDS, OPEN: OPEN}
    assert below("x", 1).outcome({"x": quantity}) == mirrored[outcome]


def test_too_few_worlds_leave_a_comparison_open() -> None:
    x = {"a": Quantity(1, 0.9, 1.1), "b": Quantity(2, 1.9, 2.1), "worlds": Quantity(3)}
    assert less("a", "b").outcome(x) == HOLDS and less("b", "a").outcome(x) == FAILS
    assert less("a", "b", enough=("worlds", 4)).outcome(x) == OPEN
    assert less("a", "b", enough=("worlds", 3)).outcome(x) == HOLDS
    assert below("a", 2, enough=("worlds", 4)).outcome(x) == OPEN
    assert less("a", "b").outcome(x | {"b": Quantity(1.15, 1.05, 1.2)}) == OPEN


def test_an_interval_may_lie_within_another_outside_it_or_across_its_end() -> None:
    for ends, outcome in (((0.95, 1.05), HOLDS), ((1.2, 1.3), FAILS), ((0.95, 1.2), OPEN), ((0.5, 2.0), OPEN)):
        assert within("x", 0.9, 1.1).outcome({"x": Quantity(1, *ends)}) == outcome
    assert within("x", 0.9, 1.1).outcome({"x": Quantity(1.11)}) == FAILS


def test_what_a_rule_needs_and_was_not_measured_leaves_it_open() -> None:
    always = Rule("always", ("x", "y"), lambda _: HOLDS)
    assert always.outcome({"x": Quantity(1), "y": Quantity(2)}) == HOLDS
    assert always.outcome({"x": Quantity(1), "y": Quantity(np.nan)}) == always.outcome({}) == OPEN


def test_a_claim_is_worth_what_its_worst_finding_is() -> None:
    assert verdict_of([HOLDS, HOLDS]) == HOLDS
    assert verdict_of([HOLDS, OPEN]) == OPEN and verdict_of([OPEN, FAILS, HOLDS]) == FAILS
    assert verdict_of([]) == OPEN


@pytest.mark.parametrize(
    ("value", "form", "shown"),
    [
        (0.0601, "", "0.0601"),
        (0.9, "", "0.900"),
        (20321.0, "", "20321"),
        (20321.4, "", "20300"),
        (0.99996, "", "1.00"),
        (-1.2345, "", "-1.23"),
        (4.0, "", "4"),
        (2e-9, "", "2.00e-09"),
        (0.0, "", "0"),
        (np.inf, ".3f", "beyond all measure"),
        (0.631, ".0%", "63 %"),
        (1.2345, "+.1f", "+1.2"),
    ],
)
def test_numbers_are_shown_with_three_digits_or_as_asked(value: float, form: str, shown: str) -> None:
    assert number(value, form) == shown


def test_a_quantity_is_shown_with_unit_and_interval() -> None:
    assert f"{Quantity(0.0123, 0.01, 0.02, 'px'):.3f}" == "0.012 px [0.010 to 0.020]"
    assert f"{Quantity(3.0, -np.inf, np.inf)}" == "3" and f"{Quantity(np.inf, 2.0, np.inf, 'mm')}".startswith("beyond")


# ------------------------------------------------------------------ conclusions
def _conclusion(folder: Path, text: str) -> Path:
    path = folder / "conclusion.md"
    path.write_text(text)
    return path


def _finding(name: str, value: float, **more: float) -> Finding:
    quantities = {"x": Quantity(value)} | {key: Quantity(v) for key, v in more.items()}
    return Finding(name, f"Is {name} large?", quantities, above("x", 1))


def test_a_paragraph_stands_where_all_its_findings_have_the_outcomes_it_asserts(tmp_path: Path) -> None:
    text = "<!-- a: holds; b: fails or open -->\nA {x:.1f} and\nnot b.\n<!-- b: holds -->\nB {x:.1f}.\n"
    paragraphs = read_conclusion(_conclusion(tmp_path, text))
    for a, b, said in (
        (2.0, 0.5, ["A 2.0 and not b."]),
        (2.0, 1.0, ["A 2.0 and not b."]),
        (2.0, 3.0, ["B 3.0."]),
        (0.5, 0.5, []),
    ):
        assert concluded(paragraphs, [_finding("a", a), _finding("b", b)]) == said


def test_a_paragraph_whose_figures_were_not_measured_is_left_out(tmp_path: Path) -> None:
    paragraphs = read_conclusion(_conclusion(tmp_path, "<!-- a: holds -->\n{y}\n<!-- a: open -->\n{x}\n"))
    assert concluded(paragraphs, [_finding("a", 2.0, y=np.nan)]) == []
    assert concluded(paragraphs, [_finding("a", 2.0, y=5.0)]) == ["5"]
    assert concluded(paragraphs, [Finding("a", "Is a large?", {}, above("x", 1))]) == []
    told = read_conclusion(_conclusion(tmp_path, "<!-- a: open -->\nNobody knows.\n"))
    assert concluded(told, [_finding("a", np.nan)]) == []
    assert concluded(told, [Finding("a", "Is a large?", {"x": Quantity(1, 0.5, 2)}, above("x", 1))]) == [
        "Nobody knows."
    ]


@pytest.mark.parametrize(
    ("text", "named"),
    [("<!-- c: holds -->\nText.", "c"), ("<!-- a: holds -->\n{z}", "z"), ("<!-- a: true -->\nText.", "a: true")],
)
def test_a_conclusion_that_names_what_there_is_not_is_refused(text: str, named: str, tmp_path: Path) -> None:
    with pytest.raises(TestfieldError, match=named):
        concluded(read_conclusion(_conclusion(tmp_path, text)), [_finding("a", 0.0)])


def test_a_text_before_the_first_finding_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TestfieldError, match="belongs to no finding"):
        read_conclusion(_conclusion(tmp_path, "Text.\n<!-- a: holds -->\nMore."))


# ------------------------------------------------------------------ the four studies
ROWS = {"wls": ("points",), "grey": ("part",), "fitting_point": ("bar", "seed"), "stitching": ("experiment",)}


@pytest.mark.parametrize("name", ["fitting_point", "grey", "stitching", "wls"])
def test_every_finding_of_a_study_has_a_paragraph_for_holding_or_failing(name: str) -> None:
    study = find_study(name)
    findings = study.read(pd.DataFrame(columns=list(ROWS[name]))).findings
    names = [finding.name for finding in findings]
    assert len(set(names)) == len(names) and set(study.rests_on) <= set(names)
    said = {
        (name, outcome)
        for part in read_conclusion(study.conclusion)
        for name in part.asserted
        for outcome in part.asserted[name]
    }
    assert {name for name, _ in said} <= set(names)
    silent = [name for name in names if not {(name, HOLDS), (name, FAILS)} & said]
    assert not silent
    assert {finding.outcome for finding in findings} == {OPEN} and study.verdict(Results(findings)) == OPEN
    assert not study.concluded(Results(findings))


def test_studies_are_found_by_name_and_an_unknown_one_is_refused() -> None:
    assert {"fitting_point", "grey", "stitching", "wls"} <= set(study_names())
    with pytest.raises(TestfieldError, match=r"no study is called 'no-such'.*wls"):
        find_study("no-such")


@pytest.mark.parametrize(
    "work", ["stitching.experiment", "wls.experiment", "fitting_point.experiment", "grey.runs", "grey.samples"]
)
def test_rewording_a_finding_or_a_page_throws_no_case_away(work: str) -> None:
    used = sources((f"testfield_studies.{work}",), ("testfield.report", "testfield.certify"))
    own = {path.stem for path in used if "testfield_studies" in path.parts}
    assert not own & {"page", "findings", "figures", "conclusion", "tables"}
    assert not {"report", "certify"} & {path.parent.name for path in used}
    assert {"render", "detect", "sensor"} <= {path.parent.name for path in used} or work == "grey.samples"


# ------------------------------------------------------------------ running
def test_what_is_finished_so_far_can_be_read_while_the_rest_is_not(tmp_path: Path) -> None:
    execute(_cases(range(2)), tmp_path)
    DONE.clear()
    assert execute(_cases(range(4)), tmp_path, so_far=True)["n"].unique().tolist() == [0, 1] and not DONE
    run_study(_study(tmp_path), tmp_path, False, 1, so_far=True)
    assert "2 of 4 cases are done" in (tmp_path / "report.html").read_text()
    with pytest.raises(TestfieldError, match="no case is finished"):
        run_study(_study(tmp_path), tmp_path / "empty", False, 1, so_far=True)


def test_a_study_of_which_all_cases_fail_says_why_the_first_did(tmp_path: Path) -> None:
    with pytest.raises(TestfieldError, match=r"all cases failed.*here: nothing was seen; look"):
        run_study(_study(tmp_path, range(2), hopeless=[0, 1]), tmp_path, False, 1)
    assert not (tmp_path / "findings.json").exists()


def test_a_study_writes_its_page_its_figures_and_their_data(tmp_path: Path) -> None:
    run_study(_study(tmp_path), tmp_path, True, 1)
    page = (tmp_path / "report.html").read_text()
    for shown in ("Do squares grow?", "They grow to 1.", "<svg", "testfield study squares --quick", "Do cubes grow?"):
        assert shown in page
    assert pd.read_csv(tmp_path / "squares.csv")["square"].tolist() == [0, 0, 1, 1]
    kept = json.loads((tmp_path / "findings.json").read_text())
    assert (kept["verdict"], kept["cases"], kept["failed"]) == ("holds", 2, 0)
    outcomes = {finding["name"]: finding["outcome"] for finding in kept["findings"]}
    assert outcomes == {"largest": "holds", "missing": "open"}
    assert kept["findings"][0]["quantities"]["square"] == {"value": 1, "low": None, "high": None, "unit": ""}


def test_contrary_rows_turn_the_verdict(tmp_path: Path) -> None:
    study = _study(tmp_path)
    rows = pd.DataFrame({"n": [0], "square": [0]})
    assert study.verdict(study.read(rows)) == FAILS and study.concluded(study.read(rows)) == ["No."]
