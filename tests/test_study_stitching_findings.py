"""The findings of the study on stitched boards follow from its rows, and turn where these are contrary."""

import json
from functools import lru_cache
from html import unescape
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from testfield.score.scorecard import plain
from testfield.study.finding import Outcome
from testfield.study.page import drawn, write_page
from testfield.study.study import Extent, Results, summary
from testfield_studies.stitching.experiment import NO_BAR
from testfield_studies.stitching.page import STUDY

HOLDS, FAILS, OPEN = Outcome.HOLDS, Outcome.FAILS, Outcome.OPEN
FIELDS = {
    ("planned", 1, "stitched"): 0.9,
    ("planned", 3, "stitched"): 0.1,
    ("planned", 6, "stitched"): 0.015,
    ("planned", 12, "stitched"): 0.01,
    ("planned", 12, "stitched_given"): 0.008,
    ("planned", 1, "zhang"): 2e4,
    ("planned", 3, "zhang"): np.nan,
    ("planned", 3, NO_BAR): 5.0,
    ("flat", 3, "stitched"): 0.2,
    ("flat", 12, "stitched"): 0.018,
    ("random", 3, "stitched"): 0.1,
    ("random", 12, "stitched"): 0.011,
    ("full-size", 3, "stitched"): 0.02,
    ("full-size", 12, "stitched"): 0.005,
    ("charuco", 3, "opencv"): 80.0,
    ("charuco", 3, "stitched"): 0.3,
    ("charuco", 3, NO_BAR): 90.0,
    ("sub-board, close", 1, "zhang"): 0.004,
    ("charuco, close", 1, "opencv"): 0.05,
}
"""Median corner errors; worlds scatter by a fifth about them."""
MM_OF = {"stitched": 0.02, "stitched_given": 0.005}
Frame = pd.DataFrame


def _count_rows(fields: dict = FIELDS, worlds: int = 10, rendered: int = 2, costs: float = 4.0) -> Frame:
    rows = []
    for (target, boards, method), corner in fields.items():
        for evidence, n in (("drawn", worlds), ("rendered", rendered)):
            if evidence == "drawn" and ("charuco" in target or method == NO_BAR):
                continue
            for world, factor in enumerate(np.linspace(0.8, 1.2, n)):
                failed = "nothing was determined" if np.isnan(corner) else ""
                own = 1 + 0.1 * np.sin(7 * world)
                rows.append(
                    {
                        "experiment": "count",
                        "target": target,
                        "boards": boards,
                        "level": 0.0,
                        "evidence": evidence,
                        "method": method,
                        "failed": failed,
                        "cut": "",
                        "window": 1.0,
                        "world": world,
                        "corner_px": corner * factor,
                        "coverage": min(1, boards / 12),
                        "sigma0": 1.0,
                        "interior_nees": 1.0,
                        "boards_nees": 1.0,
                        "check_nees": 1.0,
                        "check_rmse_mm": 0.01 / boards * factor,
                        "mother_rms_mm": 0.01 * factor,
                        "mother_flatness_mm": 0.02 * factor,
                        "true_flatness_mm": 0.0,
                        "flat_passed": 1.0,
                        "check_unfitted_mm": 0.005 * own * (costs if method == "stitched" else 1.0),
                    }
                )
    return pd.DataFrame(rows)


def _coverage_rows(middle: float = 2.0, spread: float = 0.03) -> Frame:
    rows = []
    for cut, window, world in product(("middle", "spread"), (0.5, 0.8, 1.0), range(6)):
        corner = (middle if cut == "middle" else spread) if window == 0.5 else 0.01
        rows.append(
            {
                "experiment": "coverage",
                "target": "planned",
                "boards": 12,
                "level": 0.0,
                "evidence": "drawn",
                "cut": cut,
                "window": window,
                "corner_px": corner * (0.9 + 0.04 * world),
                "method": "stitched",
                "failed": "",
                "world": world,
                "coverage": window,
                "observations": 100,
            }
        )
    return pd.DataFrame(rows)


def _fault_rows(full: float = 60.0, passed: bool = False, failing: int = 0, worlds: int = 8) -> Frame:
    rows = []
    for fault, target, level, corner in (
        ("bent", "planned", 1.0, 2.0),
        ("bent", "full-size", 1.0, full),
        ("scale", "planned", 200.0, 0.1),
    ):
        for world in range(worlds):
            good = world >= failing
            rows.append(
                {
                    "experiment": fault,
                    "target": target,
                    "boards": 6,
                    "level": level,
                    "evidence": "drawn",
                    "cut": "",
                    "method": "stitched",
                    "window": 1.0,
                    "world": world,
                    "failed": "" if good else "no board was seen",
                    **(
                        {
                            "corner_px": corner * (0.9 + 0.02 * world),
                            "check_rmse_mm": 0.05,
                            "mother_rms_mm": 0.1,
                            "sigma0": 8.0,
                            "check_nees": 9.0,
                            "test_passed": passed,
                            "coverage": 1.0,
                        }
                        if good
                        else {}
                    ),
                }
            )
    return pd.DataFrame(rows)


def _chain_rows(back: float = 1.0, by: float = 1.5, worlds: int = 40, mother_by: float = 1.0) -> Frame:
    """Chains of eight: image noise alone by the law of independent links, print errors of which a part `back` is turned
    back by the next link; wide views divide the errors by `by`."""
    rows: list[dict[str, Any]] = []
    for sigma in (0.0, 0.01):
        rng = np.random.default_rng(4)
        for world in range(worlds):
            noise = rng.normal(0, 1e-5, (7, 2))
            prints = rng.normal(0, 2e-5, (8, 2))
            alone = rng.normal(0, 2e-5, (7, 2))
            turn = noise if sigma == 0 else back * np.diff(prints, axis=0) + (1 - back) * alone
            shift = rng.normal(0, 0.001, (7, 2))
            place = np.cumsum(shift + 440 * (np.cumsum(turn, axis=0) - turn), axis=0)
            for wide, k in product((0, 4), range(7)):
                row = {
                    "experiment": "chain",
                    "target": "chain",
                    "boards": 8,
                    "evidence": "drawn",
                    "level": sigma,
                    "wide": wide,
                    "links": k + 1,
                    "world": world,
                    "nees": 1.0,
                    "method": "stitched",
                    "failed": "",
                    "u_out_mm": 0.01,
                    "u_up_mm": 0.01,
                    "mother_rms_mm": 0.01 * (1 + 0.2 * np.sin(world)) / (mother_by if wide else 1),
                }
                for i, axis in enumerate(("out", "up")):
                    row |= {
                        f"shift_{axis}_mm": shift[k, i],
                        f"turn_{axis}_rad": turn[k, i],
                        f"{axis}_mm": place[k, i] / (by if wide else 1),
                    }
                rows.append(row)
    rendered = [row | {"evidence": "rendered"} for row in rows if row["level"] and row["world"] < 2]
    return pd.DataFrame(rows + rendered)


PARTS = {"count": _count_rows, "coverage": _coverage_rows, "fault": _fault_rows, "chain": _chain_rows}


def _table(**parts: Frame) -> Frame:
    """All rows, one or more of the four parts given."""
    return pd.concat([parts.get(name, make()) for name, make in PARTS.items()], ignore_index=True)


def _read(**parts: Frame) -> Results:
    return STUDY.read(_table(**parts))


@lru_cache
def _usual() -> Results:
    return _read()


def _changed(**fields: float) -> Frame:
    """Count rows with other corner errors, by target and boards: `planned_12=0.3`."""
    names = {"close_1": ("sub-board, close", 1, "zhang")}
    keys = {
        name: names.get(
            name, (name.rpartition("_")[0].replace("full", "full-size"), int(name.rpartition("_")[2]), "stitched")
        )
        for name in fields
    }
    assert all(key in FIELDS for key in keys.values())
    return _count_rows(FIELDS | {keys[name]: value for name, value in fields.items()})


def _value(results: Results, finding: str, quantity: str) -> float:
    return results[finding].quantities[quantity].value


def test_usual_rows_give_the_outcomes_that_were_put_in() -> None:
    found = {finding.name: finding.outcome for finding in _usual().findings}
    assert STUDY.verdict(_usual()) == FAILS  # for stitching has an error
    assert {name for name, outcome in found.items() if outcome == FAILS} == {
        "letter",
        "as_full",
        "law_printed_out",
        "law_printed_up",
        "random_walk",
    }
    assert {name for name, outcome in found.items() if outcome == OPEN} == {
        "as_full_points",
        "random_three",
        "random_most",
        "charuco",
        "independent",
        "loops_exact_mother",
        "loops_printed_mother",
        "long_law_exact_out",
        "long_law_printed_up",
    }


def test_figures_are_those_of_the_rows() -> None:
    r = _usual()
    assert _value(r, "method", "boards") == 12 and _value(r, "charuco", "boards") == 3
    assert _value(r, "method", "corner") == pytest.approx(0.01)
    assert _value(r, "rendered_full", "rendered") == pytest.approx(0.005)
    assert _value(r, "coverage", "middle") == pytest.approx(2.0)
    assert _value(r, "coverage", "spread") == pytest.approx(0.03)
    assert _value(r, "letter", "cost_ratio") == pytest.approx(4)
    assert _value(r, "loops_exact_out", "divided_by") == pytest.approx(1.5)
    # By the rule that made the rows: independent links follow the law, print errors that turn back stay below it.
    for axis in ("out", "up"):
        exact, printed = (r[f"law_{what}_{axis}"].quantities for what in ("exact", "printed"))
        assert exact["found"].low < exact["law"].value < exact["found"].high
        assert printed["law"].value > 1.3 * printed["found"].high


CONTRARY = {
    "close board worse": ({"count": _changed(close_1=0.1)}, "close", HOLDS, FAILS),
    "close board like": ({"count": _changed(close_1=0.01)}, "close", HOLDS, OPEN),
    "as full-size": ({"count": _changed(full_12=0.01)}, "as_full", FAILS, OPEN),
    "above full-size": ({"count": _changed(full_12=0.03)}, "as_full", FAILS, HOLDS),
    "corners not good": ({"count": _changed(planned_12=0.3)}, "method", HOLDS, FAILS),
    "corners near": ({"count": _changed(planned_12=0.02)}, "method", HOLDS, OPEN),
    "corners of three worlds": ({"count": _count_rows(worlds=3)}, "method", HOLDS, OPEN),
    "costs nothing": ({"count": _count_rows(costs=1.0)}, "letter", FAILS, OPEN),
    "helps": ({"count": _count_rows(costs=0.5)}, "letter", FAILS, HOLDS),
    "flat like leaning": ({"count": _changed(flat_12=0.01)}, "flat_most", HOLDS, OPEN),
    "flat better": ({"count": _changed(flat_12=0.002)}, "flat_most", HOLDS, FAILS),
    "full-size does not fill": ({"count": _changed(full_3=0.5)}, "full_three", HOLDS, FAILS),
    "one board does": ({"count": _changed(planned_1=0.0001)}, "points", HOLDS, HOLDS),
    "coverage idle": ({"coverage": _coverage_rows(0.03, 0.03)}, "coverage", HOLDS, OPEN),
    "coverage harms": ({"coverage": _coverage_rows(0.01, 0.03)}, "coverage", HOLDS, FAILS),
    "law agrees": ({"chain": _chain_rows(back=0.0)}, "random_walk", FAILS, HOLDS),
    "law agrees upwards": ({"chain": _chain_rows(back=0.0)}, "law_printed_up", FAILS, HOLDS),
    "few worlds": ({"chain": _chain_rows(worlds=5)}, "random_walk", FAILS, OPEN),
    "loops idle": ({"chain": _chain_rows(by=1.0)}, "loops_exact_out", HOLDS, OPEN),
    "loops harm": ({"chain": _chain_rows(by=0.5)}, "loops_exact_out", HOLDS, FAILS),
    "prints idle": ({"chain": _chain_rows(by=1.0)}, "loops_printed_up", HOLDS, OPEN),
    "fit gains": ({"chain": _chain_rows(mother_by=2.0)}, "loops_printed_mother", OPEN, HOLDS),
    "full-size bends better": ({"fault": _fault_rows(full=0.1)}, "bent", HOLDS, FAILS),
    "bent alike": ({"fault": _fault_rows(full=2.0)}, "bent", HOLDS, OPEN),
    "test blind": ({"fault": _fault_rows(passed=True)}, "noticed_bent", HOLDS, FAILS),
    "test of few": ({"fault": _fault_rows(passed=True, worlds=2)}, "noticed_scale", HOLDS, OPEN),
}


@pytest.mark.parametrize(("parts", "finding", "before", "after"), CONTRARY.values(), ids=CONTRARY)
def test_contrary_rows_turn_a_finding(parts: dict[str, Frame], finding: str, before: Outcome, after: Outcome) -> None:
    contrary = STUDY.read(pd.concat(parts.values(), ignore_index=True))
    assert _usual()[finding].outcome == before and contrary[finding].outcome == after
    assert STUDY.concluded(contrary)


@pytest.mark.parametrize(
    ("errors", "enough", "coverage"),
    [
        ({}, 6, 50),
        ({"planned_3": 0.001, "planned_6": 0.5}, 12, 100),
        ({"planned_3": 0.001}, 3, 25),
        ({"planned_12": 0.5}, 0, None),
    ],
)
def test_enough_boards_are_those_from_which_on_all_are_good(
    errors: dict[str, float], enough: int, coverage: float | None
) -> None:
    found = _read(count=_changed(**errors))["enough"]
    assert found.quantities["enough_boards"].value == enough
    assert found.outcome == (FAILS if coverage is None else HOLDS)
    if coverage is not None:
        assert found.quantities["coverage"].value == pytest.approx(coverage)


def test_rendered_worlds_stand_beside_those_of_drawn_pixels() -> None:
    count = _count_rows(rendered=1)
    here = (count["evidence"] == "rendered") & (count["target"] == "planned") & (count["boards"] == 12)
    for factor, outcome in ((1.2, HOLDS), (1.45, OPEN), (5.0, FAILS), (0.5, FAILS)):
        moved = count.assign(corner_px=count["corner_px"].where(~here, count["corner_px"] * factor))
        found = _read(count=moved)["rendered_planned"]
        assert found.outcome == outcome and found.quantities["rendered"].value == pytest.approx(0.008 * factor)
    only_three = count[~((count["evidence"] == "rendered") & (count["boards"] == 12))]
    assert _value(_read(count=only_three), "rendered_full", "boards") == 3


def test_worlds_that_failed_are_beyond_all_in_every_column_and_say_why() -> None:
    found = _read(fault=_fault_rows(failing=5))
    table = next(table for table in found.tables if table.title == "Bent boards and own scales").frame
    assert table["failed"].tolist() == [5, 5, 5] and set(table["reason"]) == {"no board was seen"}
    for column in ("corner, px", "check points, mm", "mother board, mm", "s0", "NEES check"):
        assert set(table[column]) == {"beyond all"}, column
    assert np.isinf(_value(found, "noticed_bent", "corner")) and np.isinf(_value(found, "noticed_bent", "points"))
    some = next(t for t in _read(fault=_fault_rows(failing=2)).tables if t.title == "Bent boards and own scales").frame
    assert some["failed"].tolist() == [2, 2, 2] and set(some["s0"]) == {"8"}


def test_a_chain_that_failed_in_one_world_is_told_of_the_others() -> None:
    broken = {
        "experiment": "chain",
        "target": "chain",
        "boards": 8,
        "level": 0.0,
        "evidence": "drawn",
        "wide": 0,
        "world": 99,
        "method": "stitched",
        "failed": "the chain is broken",
    }
    whole, part = _usual(), _read(chain=pd.concat([_chain_rows(), pd.DataFrame([broken])]))
    assert STUDY.concluded(part) == STUDY.concluded(whole)
    table = next(table for table in part.tables if table.title == "The last board of each chain").frame
    assert table["failed"].max() == 1 and table["worlds"].max() == 40


def test_a_single_board_that_determines_nothing_is_beyond_all() -> None:
    table = next(table for table in _usual().tables if table.title == "All fields").frame
    alone = table[(table["target"] == "one of them alone") & (table["evidence"] == "drawn")]
    assert alone["corner, px"].tolist()[1] == "beyond all" and alone["failed"].tolist() == [0, 10]


def test_the_page_is_made_of_made_up_rows(tmp_path: Path) -> None:
    extent = Extent(cases=9, done=9, failures=[], quick=False)
    write_page(STUDY, _usual(), extent, tmp_path)
    page = unescape((tmp_path / "report.html").read_text())
    assert all(finding.question in page for finding in _usual().findings)
    assert len(_usual().plots) == 4 and all((tmp_path / f"{plot.name}.csv").is_file() for plot in _usual().plots)
    kept = json.loads(json.dumps(plain(summary(STUDY, _usual(), extent)), allow_nan=False))
    assert kept["verdict"] == "fails" and len(kept["findings"]) == len(_usual().findings)


WITHOUT = {
    "no count": lambda table: table[table["experiment"] != "count"],
    "no coverage": lambda table: table[table["experiment"] != "coverage"],
    "no bent": lambda table: table[table["experiment"] != "bent"],
    "no scale": lambda table: table[table["experiment"] != "scale"],
    "no faults": lambda table: table[~table["experiment"].isin(["bent", "scale"])],
    "no chain": lambda table: table[table["experiment"] != "chain"],
    "chains only": lambda table: table[table["experiment"] == "chain"],
    "coverage only": lambda table: table[table["experiment"] == "coverage"],
    "faults only": lambda table: table[table["experiment"].isin(["bent", "scale"])],
    "rendered only": lambda table: table[table["evidence"] == "rendered"],
    "drawn only": lambda table: table[table["evidence"] == "drawn"],
    "no print errors": lambda table: table[(table["experiment"] != "chain") | (table["level"] == 0)],
    "no wide views": lambda table: table[table["wide"] != 4],
    "one planned board": lambda table: table[
        (table["experiment"] == "count") & (table["target"] == "planned") & (table["boards"] == 1)
    ],
}


@pytest.mark.parametrize("left", WITHOUT.values(), ids=WITHOUT)
def test_what_is_not_done_yet_is_open_and_the_rest_is_as_before(left: Any) -> None:
    rows = left(_table()).dropna(axis=1, how="all").reset_index(drop=True)
    found, whole = STUDY.read(rows), _usual()
    open_now = {finding.name for finding in found.findings if finding.outcome == OPEN}
    assert open_now > {finding.name for finding in whole.findings if finding.outcome == OPEN}
    assert 0 < len(STUDY.concluded(found)) < len(STUDY.concluded(whole))
    json.dumps(plain([finding.row() for finding in found.findings]), allow_nan=False)
    for plot in found.plots if len(found.plots) < 3 else ():
        assert b"<svg" in drawn(plot)
    for table in found.tables:
        assert len(table.frame)


def test_one_kind_of_case_alone_gives_no_verdict_on_the_claim() -> None:
    rows = _table()
    one = STUDY.read(rows[(rows["experiment"] == "count") & (rows["target"] == "planned") & (rows["boards"] == 1)])
    assert one["method"].outcome == FAILS  # of a single board
    assert STUDY.verdict(STUDY.read(rows[rows["experiment"] == "coverage"])) == OPEN
