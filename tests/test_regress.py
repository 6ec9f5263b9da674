"""Regressions: what a suite asks for, what a baseline holds, and what a check says; rows are made up, nothing is
rendered."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from conftest import TINY

from testfield.cli.main import main
from testfield.errors import TestfieldError, faults_in
from testfield.evaluate.case import Case
from testfield.evaluate.regress import check
from testfield.evaluate.regress.baseline import Baseline
from testfield.evaluate.regress.suite import Better, Figure, Suite
from testfield.evaluate.regress.verdict import Verdict, judged

RMS, BIAS, TIME = "detection.centre_rms_px", "detection.centre_bias_px", "cpu_detect_s"
SUITE = f"""
name = "own"
draws = 6
budget = 24

[[scene]]
file = "{TINY}"

[[figure]]
key = "{RMS}"
matters_percent = 1

[[figure]]
key = "{BIAS}"
matters = 0.001
better = "same"

[[figure]]
key = "{TIME}"
matters_percent = 50
"""
Rows = Callable[[int], dict[str, Any]]


def unchanged(draw: int) -> dict[str, Any]:
    rng = np.random.default_rng(draw)
    return {RMS: 0.003 * (1 + 0.02 * rng.standard_normal()), BIAS: 1e-4, TIME: 1 + 0.01 * rng.standard_normal()}


class Machine:
    """Stands in for the executor: gives the rows of `rows`, and remembers which draws were asked for."""

    def __init__(self) -> None:
        self.rows: Rows = unchanged
        self.asked: list[int] = []

    def __call__(self, cases: list[Case], *_: Any, **__: Any) -> pd.DataFrame:
        self.asked.append(len(cases))
        return pd.DataFrame([case.labels | self.rows(int(case.labels["draw"])) for case in cases])


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    found = Machine()
    monkeypatch.setattr(check, "execute", found)
    return found


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(SUITE)
    return path


def command(part: str, suite: Path, *more: str) -> int:
    return main(["regress", part, str(suite), "--out", str(suite.parent / "out"), "--jobs", "1", *more])


def recorded(suite: Path) -> Path:
    assert command("record", suite) == 0
    return suite.with_name("own.baseline.json")


def verdicts(suite: Path) -> dict[str, Verdict]:
    baseline = Baseline.load(suite.with_name("own.baseline.json"))
    found = check.checked(Suite.load(suite), baseline, suite.parent / "out").findings
    return {one.figure.key: one.verdict for one in found}


def changed(**by: Callable[[float], float]) -> Rows:
    named = {"rms": RMS, "bias": BIAS, "time": TIME}
    return lambda draw: {key: by.get(short, float)(unchanged(draw)[key]) for short, key in named.items()}


def test_unchanged_code_is_the_same_to_the_last_digit_and_passes_at_the_first_look(
    suite: Path, machine: Machine
) -> None:
    recorded(suite)
    machine.asked.clear()
    assert command("check", suite) == 0
    assert machine.asked == [6]


def test_one_percent_more_spread_is_found_in_tens_of_draws(suite: Path, machine: Machine) -> None:
    path = recorded(suite)
    noisy = np.random.default_rng(5).standard_normal(100)
    machine.rows = changed(rms=lambda v: v * (1.012 + 0.005 * noisy[int(v * 1e9) % 100]))
    assert verdicts(suite)[RMS] is Verdict.WORSE
    assert command("check", suite) == 1
    assert path.is_file()


def test_a_figure_may_improve_and_one_that_should_stay_may_not(suite: Path, machine: Machine) -> None:
    recorded(suite)
    machine.rows = changed(rms=lambda v: 0.9 * v)
    assert verdicts(suite)[RMS] is Verdict.IMPROVED
    assert command("check", suite) == 0
    machine.rows = changed(bias=lambda v: v - 0.1)
    assert verdicts(suite)[BIAS] is Verdict.WORSE


def test_what_is_too_small_to_matter_passes(suite: Path, machine: Machine) -> None:
    recorded(suite)
    machine.rows = changed(rms=lambda v: 1.001 * v, time=lambda v: 1.1 * v)
    assert set(verdicts(suite).values()) == {Verdict.PASS}


def test_what_stays_open_is_looked_at_until_the_budget_ends_and_never_passes(suite: Path, machine: Machine) -> None:
    recorded(suite)
    machine.asked.clear()
    rng = np.random.default_rng(3)
    machine.rows = changed(rms=lambda v: v + 0.0003 * rng.standard_normal())
    assert command("check", suite) == 3
    assert machine.asked == [6, 9, 14, 21, 24]


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("sides", [("base",), ("now",), ("base", "now")])
def test_what_is_no_number_is_a_verdict_of_its_own_on_either_side(
    suite: Path, machine: Machine, value: float, sides: tuple[str, ...]
) -> None:
    bad = changed(rms=lambda v: value)
    machine.rows = bad if "base" in sides else unchanged
    assert command("record", suite) == ("base" in sides)
    machine.rows = bad if "now" in sides else unchanged
    assert verdicts(suite)[RMS] is Verdict.NOT_A_NUMBER
    assert command("check", suite) == 1


@pytest.mark.parametrize("spoilt, status", [(None, 1), ("no JSON", 2)])
def test_a_check_that_could_not_judge_leaves_no_earlier_verdict(
    suite: Path, machine: Machine, spoilt: str | None, status: int
) -> None:
    path, out = recorded(suite), suite.parent / "out"
    assert command("check", suite) == 0
    assert (out / "junit.xml").exists() and (out / "summary.md").exists()
    path.unlink()
    if spoilt:
        path.write_text(spoilt)
    assert command("check", suite) == status
    assert not (out / "junit.xml").exists() and not (out / "summary.md").exists()


def test_a_missing_baseline_stores_a_candidate_and_fails(suite: Path, machine: Machine) -> None:
    assert command("check", suite) == 1
    assert Baseline.load(suite.with_name("own.candidate.json")).draws == 24
    assert not suite.with_name("own.baseline.json").exists()


def test_a_suite_is_validated_with_its_baseline(
    suite: Path, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["validate", str(suite), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["warnings"]) == 1  # there is no baseline yet
    path = recorded(suite)
    capsys.readouterr()
    assert main(["validate", str(suite), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)["warnings"]
    path.write_text(path.read_text().replace("own", "another"))
    assert main(["validate", str(suite)]) == 2


def test_a_figure_that_only_one_side_has_is_missing_and_fails(suite: Path, machine: Machine) -> None:
    recorded(suite)
    suite.write_text(SUITE.replace(BIAS, "detection.missed"))
    machine.rows = lambda draw: unchanged(draw) | {"detection.missed": 0}
    found = verdicts(suite)
    assert found["detection.missed"] is found[BIAS] is Verdict.MISSING
    assert command("check", suite) == 1
    assert suite.with_name("own.candidate.json").exists()


def test_a_recipe_that_fails_where_it_did_not_is_worse(suite: Path, machine: Machine) -> None:
    recorded(suite)
    machine.rows = lambda draw: {"failure": "it broke", "failure_kind": "crashed", "failure_stage": "detect"}
    assert verdicts(suite)["failed"] is Verdict.WORSE
    assert verdicts(suite)[RMS] is Verdict.MISSING


def test_times_are_not_compared_between_processors_and_arithmetic_is_allowed_to_the_rest(
    suite: Path, machine: Machine
) -> None:
    path = recorded(suite)
    baseline = Baseline.load(path)
    Baseline(**{**vars(baseline), "made": {**baseline.made, "processor": "another"}}).save(path)
    machine.rows = changed(rms=lambda v: v * (1 + 1e-7), time=lambda v: 9 * v)
    found = verdicts(suite)
    assert (found[TIME], found[RMS]) == (Verdict.OTHER_MACHINE, Verdict.PASS)


def test_arithmetic_widens_the_interval_between_machines_only() -> None:
    base, figure = np.linspace(1, 1.1, 8), Figure("x", 1e-6)
    now = base + 2e-6 + 1e-9 * np.arange(8)
    assert judged("", "", figure, base, now, 0.01, 1e-5, True).verdict is Verdict.WORSE
    assert judged("", "", figure, base, now, 0.01, 1e-5, False).verdict is Verdict.UNKNOWN


def test_arithmetic_is_a_part_of_a_figures_size_even_where_its_mean_is_nothing() -> None:
    base, figure = np.array([1.0, -1.0] * 4), Figure("x", 1e-6)
    now = base + 2e-6 + 1e-9 * np.arange(8)
    assert judged("", "", figure, base, now, 0.01, 1e-5, False).verdict is Verdict.UNKNOWN


def test_a_percentage_of_nothing_is_refused_by_record_and_told_by_check(
    suite: Path, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.rows = changed(rms=lambda _: 0.0)
    assert command("record", suite) == 2
    assert RMS in capsys.readouterr().err
    found = judged("", "", Figure("x", 1, percent=True), np.zeros(8), np.arange(8.0), 0.01)
    assert found.verdict is not Verdict.PASS and "matters" in found.detail


@pytest.mark.parametrize(
    "better, by, verdict",
    [
        (Better.LESS, 1, Verdict.WORSE),
        (Better.MORE, 1, Verdict.IMPROVED),
        (Better.MORE, -1, Verdict.WORSE),
        (Better.SAME, -1, Verdict.WORSE),
    ],
)
def test_each_figure_has_its_own_direction(better: Better, by: float, verdict: Verdict) -> None:
    base = np.linspace(1, 2, 8)
    assert judged("", "", Figure("x", 0.1, better=better), base, base + by, 0.01).verdict is verdict


def test_a_baseline_that_was_edited_is_refused_whatever_was_edited(
    suite: Path, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recorded(suite)
    text = path.read_text()
    first = json.loads(text)["figures"][1]["draws"][0]
    for old, new in (
        (str(first), str(first * 2)),
        ('"budget"', '"budget"'),
        ('"draws": 24', '"draws": 23'),
        ("{", "", ),
        ('"format": 1', '"format": 2'),
        ('"suite": "own"', '"suite": "other"'),
        (str(first), "NaN"),
        ('"what"', '"that"'),
    ):  # fmt: skip
        path.write_text(text.replace(old, new, 1))
        if old == new:
            continue
        assert command("check", suite) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_baseline_of_another_suite_or_scene_is_refused(
    suite: Path, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(suite)
    for old, new in (
        ('name = "own"', 'name = "their"'),
        ("[[scene]]", "[[scene]]\nchanges = { seed = 9 }\ntitle = 'tiny'"),
    ):
        suite.write_text(SUITE.replace(old, new))
        assert command("check", suite) == 2
        assert "own.baseline.json" in capsys.readouterr().err


def test_a_baseline_keeps_every_digit_and_has_a_line_for_each_figure(suite: Path, machine: Machine) -> None:
    path = recorded(suite)
    loaded = Baseline.load(path)
    assert loaded.figures["tiny", "as the scene asks", RMS].tolist() == [unchanged(d)[RMS] for d in range(1, 25)]
    assert sum(RMS in line for line in path.read_text().splitlines()) == 1


@pytest.mark.parametrize("budget", ["0", "1", "-3", "10001"])
def test_a_budget_of_nothing_is_refused(
    suite: Path, machine: Machine, budget: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("check", suite, "--budget", budget) == 2
    assert "--budget" in capsys.readouterr().err
    assert not machine.asked


@pytest.mark.parametrize(
    "old, new, line, place",
    [
        ("draws = 6", "draws = 1", 3, "draws"),
        ("draws = 6", 'draws = "six"', 3, "draws"),
        ("budget = 24", "budgets = 24", 4, "budgets"),
        ("matters = 0.001", "matters = 0", 15, "figure[1].matters"),
        ("matters = 0.001", "matters = nan", 15, "figure[1].matters"),
        ('better = "same"', 'better = "good"', 16, "figure[1].better"),
        ("matters = 0.001", "", 13, "figure[1]"),
    ],
)
def test_a_suites_faults_are_told_with_line_and_field(suite: Path, old: str, new: str, line: int, place: str) -> None:
    suite.write_text(SUITE.replace(old, new))
    with pytest.raises(TestfieldError) as error:
        Suite.load(suite)
    assert f"{suite}:{line}, {place}" in faults_in(error.value)[0].where


@pytest.mark.parametrize(
    "old, new",
    [
        ("budget = 24", "budget = 5"),
        (f'key = "{BIAS}"', f'key = "{RMS}"'),
        ("matters_percent = 50", 'matters_percent = 50\nscenes = ["none"]'),
        ("[[scene]]", "[[scene]]\nchanges = { 'camera.no_such' = 1 }"),
        (f'file = "{TINY}"', 'file = "nowhere.toml"'),
        ("budget = 24", 'budget = 24\nrecipes = ["nowhere.toml"]'),
        (f'key = "{BIAS}"', 'key = "failed"'),
    ],
)
def test_a_suite_that_cannot_be_done_is_refused_before_anything_is_measured(
    suite: Path, machine: Machine, old: str, new: str
) -> None:
    suite.write_text(SUITE.replace(old, new))
    assert command("record", suite) == 2
    assert not machine.asked


def test_a_figure_that_no_row_has_is_refused_with_the_nearest(
    suite: Path, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    suite.write_text(SUITE.replace(RMS, RMS + "x"))
    assert command("record", suite) == 2
    assert RMS in capsys.readouterr().err


def test_junit_and_the_summary_tell_the_same_and_picture_the_three_worst(suite: Path, machine: Machine) -> None:
    recorded(suite)
    machine.rows = changed(rms=lambda v: 2 * v, bias=lambda v: v + 1, time=lambda v: 3 * v)
    assert command("check", suite) == 1
    out = suite.parent / "out"
    tests = ElementTree.parse(out / "junit.xml").getroot().findall("testsuite/testcase")
    assert [test.get("name") for test in tests if test.find("failure") is not None] == [RMS, BIAS, TIME]
    text = (out / "summary.md").read_text()
    assert [text.count(f"worst_{k}.png") for k in (1, 2, 3, 4)] == [1, 1, 1, 0]
    assert (out / "worst_3.png").stat().st_size > 1000
    machine.rows = unchanged
    assert command("check", suite) == 0
    assert not (out / "worst_1.png").exists()
