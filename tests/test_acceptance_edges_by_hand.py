"""Which lengths, spacings and planes an acceptance tests, and its verdict in words, by hand on the hand-made field."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade, Page

from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.report.accept import MOST_ROWS, accept_page, sentence
from testfield.scene.load import load_scene
from testfield.scene.schema import SceneFile
from testfield.scene.target_parts import CheckGrid
from testfield.scene.world import BAR, CHECK
from testfield.score.acceptance import acceptance, planes, points_card, spacing, test_lengths
from testfield.score.length_test import Limit, MeasuredLengths, figures, limit_of, slope

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
UM = 1e-3


def volume(*size_mm: float, **changes: Any) -> SceneFile:
    """A scene of that size."""
    quick = load_scene(QUICK)
    size = quick.volume.model_copy(update={"size_mm": size_mm})
    return quick.model_copy(update={"volume": size, **changes})


# ------------------------------------------------------------------ which lengths, spacings and planes
def test_without_lines_all_pairs_of_check_targets_and_the_check_bars_are_lengths(by_hand: HandMade) -> None:
    asked, _ = test_lengths(by_hand.world)
    assert len(asked) == 7 * 6 // 2 + 3
    assert asked[0] == ("from 21", 21, 22, pytest.approx(2000.0, rel=1e-12), 0.0)
    assert [row[:3] for row in asked[-3:]] == [("check one", 33, 34), ("check two", 35, 36), ("check three", 37, 38)]
    assert asked[-3][3:] == (700.0, 0.003)


def test_without_lines_and_bars_the_spacing_is_that_of_nearest_neighbours(by_hand: HandMade) -> None:
    """22, 24 and 23 to 25, and 26 to 23; 21 and 23 to 27 besides, which was not measured."""
    world = replace(by_hand.world, field=replace(by_hand.world.field, scale_bars=()))
    found = spacing(world, by_hand.points)
    assert found is not None
    assert found["rule"] == "each check target and the one nearest to it"
    assert found["spacings"] == 4
    # 22 to 25 is longer by (1 * 2 + 3) / sqrt(5), 23 to 25 by (2 * 6 + 3 * 5) / sqrt(61) um.
    long, short = 5 / 5**0.5, (2 * 6 + 3 * 5) / 61**0.5
    assert found["max_abs_mm"] == pytest.approx(short * UM, rel=1e-5)
    assert found["rms_mm"] == pytest.approx(((long**2 + 3 * short**2) / 4) ** 0.5 * UM, rel=1e-5)
    assert found["rms_u_mm"] == pytest.approx(8**0.5 * UM, rel=1e-8)
    assert spacing(world, replace(by_hand.points, code=by_hand.points.code + 500)) is None


def test_a_plane_of_check_targets_on_a_board_has_nothing_of_the_board_itself(by_hand: HandMade) -> None:
    """21 to 24 stuck on board A, whose number 1 is a point that was measured 9 mm off."""
    marks = by_hand.world.marks
    on = np.isin(marks.code, [21, 22, 23, 24])
    at = np.array([[90.0, 0], [-90, 0], [0, 90], [0, -90]])
    xy = marks.xy_mm.copy()
    xy[on] = at
    world = replace(by_hand.world, marks=replace(marks, panel=np.where(on, 0, marks.panel), xy_mm=xy))
    points = Points(
        method="hand",
        code=np.array([21, 22, 23, 24, 1, 31]),
        xyz_mm=np.array([[90, 0, 0.02], [-90, 0, 0.02], [0, 90, -0.02], [0, -90, -0.02], [0, 50, 9], [0, 0, 2000]]),
        cov_xyz_mm2=1e-6 * np.eye(18),
        rays=np.full(6, 2),
        residual_rms_px=np.zeros(6),
        rejected=np.zeros(6, int),
    )
    scene = volume(1200.0, 2000.0, 1000.0, check_targets=())
    (plane,) = planes(scene, world, points)
    assert plane["plane"] == "targets on board A" and plane["targets"] == 4
    assert plane["error_mm"] == pytest.approx(0.04, abs=1e-9) and plane["true_mm"] == pytest.approx(0, abs=1e-9)
    assert planes(scene, by_hand.world, points) == []


@pytest.mark.parametrize(
    ("counts", "is_plane"), [((2, 2, 1), True), ((1, 2, 2), True), ((2, 2, 2), False), ((4, 1, 1), False)]
)
def test_a_grid_one_target_deep_is_a_plane(by_hand: HandMade, counts: tuple[int, int, int], is_plane: bool) -> None:
    quick = load_scene(QUICK)
    grid = next(part for part in quick.check_targets if isinstance(part, CheckGrid))
    scene = quick.model_copy(update={"check_targets": (grid.model_copy(update={"first_code": 21, "counts": counts}),)})
    found = planes(scene, by_hand.world, by_hand.points)
    assert [row["plane"] for row in found] == (["grid of targets 21 to 24"] if is_plane else [])
    assert [row["targets"] for row in found] == ([4] if is_plane else [])


def test_three_targets_are_no_plane(by_hand: HandMade) -> None:
    quick = load_scene(QUICK)
    grid = next(part for part in quick.check_targets if isinstance(part, CheckGrid))
    scene = quick.model_copy(
        update={"check_targets": (grid.model_copy(update={"first_code": 24, "counts": (2, 2, 1)}),)}
    )
    assert planes(scene, by_hand.world, by_hand.points) == []  # of 24 to 27 the last was not measured


def one_length() -> MeasuredLengths:
    return MeasuredLengths(("x",), np.array([[22, 21]]), np.ones(1), np.zeros(1), np.ones(1), np.ones((1, 1)))


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_of_fewer_than_three_check_points_only_lengths_are_judged(by_hand: HandMade, n: int) -> None:
    keep = [33, 34, 21, 23, 25][: 2 + n]
    gone = np.where(np.isin(by_hand.points.code, keep), by_hand.points.code, 900 + np.arange(13))
    card = points_card(by_hand.world, by_hand.calibration, replace(by_hand.points, code=gone), one_length())
    assert card is not None and card["check_points"] == n and card["of_lengths"]["lengths"] == 1
    assert ("rmse_mm" in card) == (n == 3)


def test_an_acceptance_without_a_length_says_what_lacks(by_hand: HandMade) -> None:
    scene = volume(1200.0, 2000.0, 1000.0)
    with pytest.raises(TestfieldError) as none_measured:
        acceptance(scene, by_hand.world, by_hand.calibration, replace(by_hand.points, code=by_hand.points.code + 500))
    assert "none of the 24 test lengths" in str(none_measured.value)
    marks = by_hand.world.marks
    bare = replace(
        by_hand.world,
        marks=replace(marks, role=np.where(marks.role == CHECK, BAR, marks.role)),
        field=replace(by_hand.world.field, scale_bars=()),
    )
    with pytest.raises(TestfieldError):
        acceptance(scene, bare, by_hand.calibration, by_hand.points)


def test_equal_lengths_have_no_slope_and_two_have_none() -> None:
    def some(*calibrated_mm: float) -> MeasuredLengths:
        n = len(calibrated_mm)
        L = np.array(calibrated_mm)
        ends = np.arange(2 * n).reshape(n, 2)
        return MeasuredLengths(("x",) * n, ends, L, np.zeros(n), L + UM, 1e-6 * np.eye(n))

    assert slope(some(700, 700, 700)) is None and slope(some(500, 700)) is None
    assert figures(some(500, 700))["slope"] is None
    found = slope(some(500, 700, 900))
    assert found is not None and found["slope_ppm"] == pytest.approx(0, abs=1e-9)
    assert found["offset_mm"] == pytest.approx(UM, rel=1e-8)


# ------------------------------------------------------------------ the verdict in words
def card_of(verdict: str | None, shown: str = "shown", b_mm: float | None = None, rows: Any = None) -> dict[str, Any]:
    """A card of which all numbers differ."""
    judged = {
        "a_mm": 0.003,
        "k_ppm": 2.5,
        "b_mm": b_mm,
        "verdict": verdict,
        "with_test_uncertainty": shown,
        "outside": 4,
        "of": 16,
        "missing": 6,
        "worst_codes": [35, 38],
        "worst_dl_mm": -0.0125,
        "worst_limit_mm": 0.0075,
    }
    lengths = {"lengths": 17, "max_abs_dl_mm": 0.0321, "envelope": {"a_mm": 0.0123, "k_ppm": 4.56}}
    return {"lengths": lengths, "verdict": None if verdict is None else judged, "arrangement": rows}


@pytest.mark.parametrize(
    ("verdict", "begins", "figures_said", "not_said"),
    [
        ("passed", "Passed:", ("all 16", "-0.0125 mm where 0.0075 mm", "targets 35 and 38"), ("4 of", "6 of")),
        ("failed", "Failed:", ("4 of 16", "-0.0125 mm where 0.0075 mm", "targets 35 and 38"), ("6 of", "all 16")),
        ("incomplete", "Incomplete:", ("6 of", "other 16"), ("4 of", "all 16", "0.0125")),
    ],
)
@pytest.mark.parametrize("b_mm", [None, 0.0064])
def test_the_sentence_is_that_of_its_verdict_with_its_numbers(
    verdict: str, begins: str, figures_said: tuple[str, ...], not_said: tuple[str, ...], b_mm: float | None
) -> None:
    said = sentence(card_of(verdict, b_mm=b_mm))
    assert said.startswith(begins) and "E = 0.003 mm + 2.5 ppm L" in said
    assert ("0.0064 mm" in said) == (b_mm is not None)
    for figure in figures_said:
        assert figure in said, figure
    for figure in not_said:
        assert figure not in said, figure


def test_without_a_limit_there_is_no_verdict_but_the_envelope() -> None:
    said = sentence(card_of(None))
    assert "Passed" not in said and "Failed" not in said
    for figure in ("17 errors", "0.0321 mm", "0.0123 mm + 4.56 ppm L"):
        assert figure in said, figure


def test_each_state_of_the_tests_own_uncertainty_is_told_apart() -> None:
    said = {shown: sentence(card_of("passed", shown)) for shown in ("shown", "refuted", "open")}
    assert "holds" in said["shown"] and "open" in said["open"] and "not explain" in said["refuted"]
    assert len(set(said.values())) == 3


def test_only_what_the_arrangement_lacks_is_named() -> None:
    rows = [
        {"what": "measuring lines", "asked": "7 or more", "found": "3", "met": False},
        {"what": "one line at least", "asked": "800 mm", "found": "900 mm", "met": True},
        {"what": "corners", "asked": "8", "found": "5", "met": False},
    ]
    said = sentence(card_of("passed", rows=rows))
    assert "measuring lines (3, asked: 7 or more); corners (5, asked: 8)." in said and "900" not in said
    assert "arrangement" not in sentence(card_of("passed", rows=[rows[1]])) and "part 1" in sentence(card_of("passed"))


def test_a_limit_comes_back_from_the_verdict_it_gave() -> None:
    assert limit_of({"a_mm": 0.003, "k_ppm": 2.0, "b_mm": None}) == Limit(0.003, 2.0)
    assert limit_of({"a_mm": 0.003, "k_ppm": 2.0, "b_mm": 0.006}) == Limit(0.003, 2.0, 0.006)


# ------------------------------------------------------------------ the page
def test_of_many_lengths_the_page_shows_the_largest_errors(by_hand: HandMade) -> None:
    scene = volume(1200.0, 2000.0, 1000.0)
    card, found = acceptance(scene, by_hand.world, by_hand.calibration, by_hand.points)
    assert len(found) == 6 * 5 // 2 + 2
    card["rows"] = [card["rows"][0] | {"dl_mm": sign * k * UM} for k in range(45) for sign in (1, -1)]
    rows = Page(accept_page(by_hand.world, card, found, None, [])).table("line", "ends")
    assert len(rows) == MOST_ROWS
    assert [abs(float(row[6])) for row in rows] == pytest.approx([k * UM for k in range(44, 14, -1) for _ in (1, -1)])


def test_as_many_lengths_as_a_page_shows_stay_in_their_order(by_hand: HandMade) -> None:
    card, found = acceptance(volume(1200.0, 2000.0, 1000.0), by_hand.world, by_hand.calibration, by_hand.points)
    for count in (MOST_ROWS, MOST_ROWS + 1):
        card["rows"] = [card["rows"][0] | {"dl_mm": k * UM} for k in range(count)]
        rows = Page(accept_page(by_hand.world, card, found, None, [])).table("line", "ends")
        first = 0.0 if count == MOST_ROWS else MOST_ROWS * UM
        assert len(rows) == MOST_ROWS and float(rows[0][6]) == pytest.approx(first)
