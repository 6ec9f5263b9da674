"""The words of the study on stitched boards follow from its rows, and change where these are contrary."""

import re
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import pytest

from testfield.report.study import drawn
from testfield_studies.stitching.experiment import NO_BAR
from testfield_studies.stitching.page import read
from testfield.study.study import Findings

FIELDS = {
    ("planned", 1, "stitched"): 0.9, ("planned", 3, "stitched"): 0.1, ("planned", 6, "stitched"): 0.015,
    ("planned", 12, "stitched"): 0.01, ("planned", 12, "stitched_given"): 0.008, ("planned", 1, "zhang"): 2e4,
    ("planned", 3, "zhang"): np.nan, ("planned", 3, NO_BAR): 5.0, ("flat", 3, "stitched"): 0.2,
    ("flat", 12, "stitched"): 0.018, ("random", 3, "stitched"): 0.1, ("random", 12, "stitched"): 0.011,
    ("full-size", 3, "stitched"): 0.02, ("full-size", 12, "stitched"): 0.005, ("charuco", 3, "opencv"): 80.0,
    ("charuco", 3, "stitched"): 0.3, ("charuco", 3, NO_BAR): 90.0, ("sub-board, close", 1, "zhang"): 0.004,
    ("charuco, close", 1, "opencv"): 0.05,
}  # fmt: skip
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
                rows.append({
                    "experiment": "count", "target": target, "boards": boards, "level": 0.0, "evidence": evidence,
                    "method": method, "failed": failed, "cut": "", "window": 1.0, "world": world,
                    "corner_px": corner * factor, "coverage": min(1, boards / 12), "sigma0": 1.0, "interior_nees": 1.0,
                    "boards_nees": 1.0, "check_nees": 1.0, "check_rmse_mm": 0.01 / boards * factor,
                    "mother_rms_mm": 0.01 * factor, "mother_flatness_mm": 0.02 * factor, "true_flatness_mm": 0.0,
                    "flat_passed": 1.0,
                    "check_unfitted_mm": 0.005 * own * (costs if method == "stitched" else 1.0),
                })  # fmt: skip
    return pd.DataFrame(rows)


def _coverage_rows(middle: float = 2.0, spread: float = 0.03) -> Frame:
    rows = []
    for cut, window, world in product(("middle", "spread"), (0.5, 0.8, 1.0), range(6)):
        corner = (middle if cut == "middle" else spread) if window == 0.5 else 0.01
        rows.append({
            "experiment": "coverage", "target": "planned", "boards": 12, "level": 0.0, "evidence": "drawn", "cut": cut,
            "window": window, "corner_px": corner * (0.9 + 0.04 * world), "method": "stitched", "failed": "",
            "world": world, "coverage": window, "observations": 100,
        })  # fmt: skip
    return pd.DataFrame(rows)


def _fault_rows(full: float = 60.0, passed: bool = False, failing: int = 0, worlds: int = 8) -> Frame:
    rows = []
    for fault, target, level, corner in (
        ("bent", "planned", 1.0, 2.0), ("bent", "full-size", 1.0, full), ("scale", "planned", 200.0, 0.1),
    ):  # fmt: skip
        for world in range(worlds):
            good = world >= failing
            rows.append({
                "experiment": fault, "target": target, "boards": 6, "level": level, "evidence": "drawn", "cut": "",
                "method": "stitched", "window": 1.0, "world": world, "failed": "" if good else "no board was seen",
                **({"corner_px": corner * (0.9 + 0.02 * world), "check_rmse_mm": 0.05, "mother_rms_mm": 0.1,
                    "sigma0": 8.0, "check_nees": 9.0, "test_passed": passed, "coverage": 1.0} if good else {}),
            })  # fmt: skip
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
                    "experiment": "chain", "target": "chain", "boards": 8, "evidence": "drawn", "level": sigma,
                    "wide": wide, "links": k + 1, "world": world, "nees": 1.0, "method": "stitched", "failed": "",
                    "u_out_mm": 0.01, "u_up_mm": 0.01,
                    "mother_rms_mm": 0.01 * (1 + 0.2 * np.sin(world)) / (mother_by if wide else 1),
                }  # fmt: skip
                for i, axis in enumerate(("out", "up")):
                    row |= {f"shift_{axis}_mm": shift[k, i], f"turn_{axis}_rad": turn[k, i],
                            f"{axis}_mm": place[k, i] / (by if wide else 1)}  # fmt: skip
                rows.append(row)
    rendered = [row | {"evidence": "rendered"} for row in rows if row["level"] and row["world"] < 2]
    return pd.DataFrame(rows + rendered)


PARTS = {"count": _count_rows, "coverage": _coverage_rows, "fault": _fault_rows, "chain": _chain_rows}


def _table(**parts: Frame) -> Frame:
    """All rows, one or more of the four parts given."""
    return pd.concat([parts.get(name, make()) for name, make in PARTS.items()], ignore_index=True)


def _read(**parts: Frame) -> Findings:
    return read(_table(**parts))


@lru_cache
def _usual() -> Findings:
    return _read()


def _words(findings: Findings) -> str:
    return " ".join([findings.verdict, *findings.sentences])


def _changed(**fields: float) -> Frame:
    """Count rows with other corner errors, by target and boards: `planned_12=0.3`."""
    names = {"close_1": ("sub-board, close", 1, "zhang")}
    keys = {name: names.get(name, (name.rpartition("_")[0].replace("full", "full-size"),
            int(name.rpartition("_")[2]), "stitched")) for name in fields}  # fmt: skip
    assert all(key in FIELDS for key in keys.values())
    return _count_rows(FIELDS | {keys[name]: value for name, value in fields.items()})


SAID = (
    "How many: at the worst corner", "Check points in the volume, one board and 12", "How placed, three boards",
    "Three boards flat on one wall", "With 12: planned", "How much coverage", "As long as the stations converge",
    "Flatness of the mother board, 3 boards", "Flatness of the mother board, 12 boards",
    "Against an ideal full-size board", "The full-size board with the marks of 12", "Against one sub-board alone",
    "Against one sub-board shown all over", "Against ChArUco of the area of 3 boards", "The same with the bar",
    "A small ChArUco shown all over", "What stitching costs", "After a fit of six parameters the mother board",
    "Growth by image noise alone", "That links are not independent", "Four wide views bring the errors",
    "Growth with print errors of 0.01 mm", "Print errors make no random walk", "With print errors four wide views",
    "A link's turn in the plane", "After a fit of six parameters 1", "What the bundle claims along the chain",
    "On rendered images that NEES", "Six flat boards give", "Six boards bent by 1 mm", "A full-size board of the same",
    "Six boards with scale errors",
)  # fmt: skip


def test_every_question_is_answered_and_nothing_is_left_unknown() -> None:
    findings = _usual()
    unsaid = [start for start in SAID if not any(sentence.startswith(start) for sentence in findings.sentences)]
    # Leaning and flat boards are told apart here, so the sentence on a board's own lean begins otherwise.
    assert unsaid == ["As long as the stations converge"]
    assert len(findings.sentences) == len(SAID)
    assert not re.search(r"\b(nan|inf|None)\b", _words(findings))
    for clause in ("Holds as a method; not to the letter", "12 stitched boards know the lens", "2.0 times the error of",
                   "On rendered images: 12 stitched boards", "Stitching's error is estimated", "grows along a chain",
                   "Four wide views divide what image noise adds by 1.5 [1.5, 1.5]",
                   "For the lens alone stitching is not needed"):  # fmt: skip
        assert clause in findings.verdict
    assert [plot.name for plot in findings.plots if b"<svg" not in drawn(plot)] == [] and len(findings.plots) == 4


def test_figures_are_those_of_the_rows() -> None:
    f = _usual().figures
    assert f["most_boards"] == 12 and f["charuco_boards"] == 3
    assert f["planned_corner_px"] == pytest.approx(0.01) and f["rendered_full_corner_px"] == pytest.approx(0.005)
    assert f["window_middle_corner_px"] == pytest.approx(2.0) and f["window_spread_corner_px"] == pytest.approx(0.03)
    assert f["cost_ratio"] == pytest.approx(4) and f["loops_exact_out"] == pytest.approx(1.5)
    # By the rule that made the rows: independent links follow the law, and its interval holds it.
    for axis in ("out", "up"):
        key = f"chain_exact_close_{axis}"
        assert f[f"{key}_low_mm"] < f[f"{key}_law_mm"] < f[f"{key}_high_mm"]
        assert f[f"chain_printed_close_{axis}_law_mm"] > 1.3 * f[f"chain_printed_close_{axis}_high_mm"]


CONTRARY = {
    "close board worse": ({"count": _changed(close_1=0.1)}, "stitching is not needed", "is worse than 12 stitched"),
    "close board like": ({"count": _changed(close_1=0.01)}, "stitching is not needed", "cannot be told apart from 12"),
    "as full-size": ({"count": _changed(full_12=0.01)}, "2.0 times the error", "which cannot be told apart from the"),
    "above full-size": ({"count": _changed(full_12=0.03)}, "2.0 times the error", "less than the error of an ideal"),
    "corners not good": ({"count": _changed(planned_12=0.3)}, "Holds as a method", "Does not hold as a method"),
    "corners near": ({"count": _changed(planned_12=0.02)}, "Holds as a method", "Whether it holds as a method"),
    "costs nothing": ({"count": _count_rows(costs=1.0)}, "not to the letter", "whether to the letter cannot be told"),
    "helps": ({"count": _count_rows(costs=0.5)}, "not to the letter", "to the letter too"),
    "flat like leaning": ({"count": _changed(flat_12=0.01)}, "a board's own lean still helps",
                          "nothing can be told of a board's own lean"),
    "flat better": ({"count": _changed(flat_12=0.002)}, "a board's own lean still helps", "own lean does harm"),
    "full-size does not fill": ({"count": _changed(full_3=0.5)}, "the full-size board is better. The",
                                "three sub-boards are better"),
    "coverage idle": ({"coverage": _coverage_rows(0.03, 0.03)}, "it is coverage that decides", "cannot be told here"),
    "coverage harms": ({"coverage": _coverage_rows(0.01, 0.03)}, "it is coverage that decides", "the middle alone is"),
    "law agrees": ({"chain": _chain_rows(back=0.0)}, "Print errors make no random walk", "Nothing speaks against a"),
    "few worlds": ({"chain": _chain_rows(worlds=5)}, "Print errors make no random walk", "5 worlds are too few"),
    "loops idle": ({"chain": _chain_rows(by=1.0)}, "divide what image noise adds by 1.5", "cannot be told from 40"),
    "loops harm": ({"chain": _chain_rows(by=0.5)}, "divide what image noise adds by 1.5", "adds worse"),
    "prints idle": ({"chain": _chain_rows(by=1.0)}, "they divide the last board's error", "That they help where print"),
    "fit idle": ({"chain": _chain_rows(mother_by=2.0)}, "views, no difference that 40 worlds tell (divided by 1.00",
                 "with four wide views, divided by 2.00"),
    "full-size bends better": ({"fault": _fault_rows(full=0.1)}, "that is their true advantage", "board errs less"),
    "bent alike": ({"fault": _fault_rows(full=2.0)}, "that is their true advantage", "err less cannot be told"),
    "test blind": ({"fault": _fault_rows(passed=True)}, "the global test notices", "the global test hardly notices"),
    "test of few": ({"fault": _fault_rows(passed=True, worlds=2)}, "; the global test notices",
                    "whether the global test notices cannot be told"),
}  # fmt: skip


@pytest.mark.parametrize(("parts", "before", "after"), CONTRARY.values(), ids=CONTRARY)
def test_contrary_rows_change_the_words(parts: dict[str, Frame], before: str, after: str) -> None:
    usual, contrary = _words(_usual()), _words(_read(**parts))
    assert before in usual and after not in usual
    assert after in contrary and before not in contrary
    assert not re.search(r"\b(nan|inf|None)\b", contrary)


@pytest.mark.parametrize(
    ("errors", "enough", "coverage"),
    [
        ({}, 6, 0.5), ({"planned_3": 0.001, "planned_6": 0.5}, 12, 1.0), ({"planned_3": 0.001}, 3, 0.25),
        ({"planned_12": 0.5}, 0, None),
    ],
)  # fmt: skip
def test_enough_boards_are_those_from_which_on_all_are_good(
    errors: dict[str, float], enough: int, coverage: float | None
) -> None:
    findings = _read(count=_changed(**errors))
    assert findings.figures["enough_boards"] == enough
    if coverage is None:
        assert "with none of the numbers tried does the upper end of the 95 % interval stay" in findings.sentences[0]
    else:
        assert findings.figures["enough_coverage"] == pytest.approx(coverage)
        assert f"from {enough} planned boards on, where they cover {100 * coverage:.0f} %" in findings.sentences[0]


def test_rendered_worlds_stand_beside_the_interval_of_drawn_ones() -> None:
    usual = _usual().verdict
    assert "12 stitched boards 0.0100 px (2 worlds, range 0.0080 to 0.0120), inside the interval" in usual
    count = _count_rows(rendered=1)
    for factor, where in (
        (1.45, "above the interval [0.0084, 0.0116] of the drawn median, within the range [0.0080, 0.0120] of 10"),
        (5.0, "above the interval [0.0084, 0.0116] of the drawn median, outside the range"),
        (0.5, "below the interval [0.0084, 0.0116] of the drawn median, outside the range"),
    ):
        here = (count["evidence"] == "rendered") & (count["target"] == "planned") & (count["boards"] == 12)
        moved = count.assign(corner_px=count["corner_px"].where(~here, count["corner_px"] * factor))
        verdict = _read(count=moved).verdict
        assert f"12 stitched boards {0.008 * factor:.4f} px (1 world), {where}" in verdict
    only_three = count[~((count["evidence"] == "rendered") & (count["boards"] == 12))]
    assert "the full-size board with the marks of 3 0.0160 px (1 world)" in _read(count=only_three).verdict


def test_worlds_that_failed_are_beyond_all_in_every_column_and_say_why() -> None:
    findings = _read(fault=_fault_rows(failing=5))
    table = next(table for table in findings.tables if table.title == "Bent boards and own scales").frame
    assert table["failed"].tolist() == [5, 5, 5] and set(table["reason"]) == {"no board was seen"}
    for column in ("corner, px", "check points, mm", "mother board, mm", "s0", "NEES check"):
        assert set(table[column]) == {"beyond all"}, column
    assert "corners err by beyond all measure, check points by beyond all measure" in _words(findings)
    some = next(t for t in _read(fault=_fault_rows(failing=2)).tables if t.title == "Bent boards and own scales").frame
    assert some["failed"].tolist() == [2, 2, 2] and set(some["s0"]) == {"8"}


def test_a_chain_that_failed_in_one_world_is_told_of_the_others() -> None:
    broken = {"experiment": "chain", "target": "chain", "boards": 8, "level": 0.0, "evidence": "drawn", "wide": 0,
              "world": 99, "method": "stitched", "failed": "the chain is broken"}  # fmt: skip
    whole, part = _usual(), _read(chain=pd.concat([_chain_rows(), pd.DataFrame([broken])]))
    assert part.sentences == whole.sentences
    table = next(table for table in part.tables if table.title == "The last board of each chain").frame
    assert table["failed"].max() == 1 and table["worlds"].max() == 40


def test_a_single_board_that_determines_nothing_is_beyond_all() -> None:
    table = next(table for table in _usual().tables if table.title == "All fields").frame
    alone = table[(table["target"] == "one of them alone") & (table["evidence"] == "drawn")]
    assert alone["corner, px"].tolist()[1] == "beyond all" and alone["failed"].tolist() == [0, 10]


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
def test_what_is_not_done_yet_is_left_out_and_the_rest_is_told(left: Any) -> None:
    rows = left(_table()).dropna(axis=1, how="all").reset_index(drop=True)
    findings = read(rows)
    assert findings.verdict and not re.search(r"\b(nan|inf|None)\b", _words(findings))
    whole = _usual()
    assert 0 < len(findings.sentences) < len(whole.sentences)
    for plot in findings.plots if len(findings.plots) < 3 else ():
        assert b"<svg" in drawn(plot)
    for table in findings.tables:
        assert len(table.frame)


def test_one_kind_of_case_alone_gives_no_verdict_on_the_claim() -> None:
    rows = _table()
    one = read(rows[(rows["experiment"] == "count") & (rows["target"] == "planned") & (rows["boards"] == 1)])
    assert one.verdict.startswith("Does not hold")
    assert read(rows[rows["experiment"] == "coverage"]).verdict.startswith("Not decided")
