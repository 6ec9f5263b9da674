"""The scorer where there is little to score, and its small parts, against arithmetic by hand."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.reconstruct.points import Points
from testfield.report.page import _check_rows, _interior_rows, _making_rows, _status_rows, _telling_station
from testfield.score.camera import _places, imaging_score, score_boards, score_camera
from testfield.score.points import PointScore, score_lengths, score_points, world_scale
from testfield.score.scorecard import TEN, plain, ten_figures


def some(points: Points, *codes: int) -> Points:
    """Those of the points, in the order of the codes."""
    k = np.array([int(np.flatnonzero(points.code == code)[0]) for code in codes], int)
    flat = (3 * k[:, None] + np.arange(3)).ravel()
    return replace(
        points,
        code=points.code[k],
        xyz_mm=points.xyz_mm[k],
        cov_xyz_mm2=points.cov_xyz_mm2[np.ix_(flat, flat)],
        rays=points.rays[k],
        residual_rms_px=points.residual_rms_px[k],
        rejected=points.rejected[k],
    )


# ------------------------------------------------------------------ the console's ten figures
def card_of(**leaves: Any) -> dict[str, Any]:
    """A card with the ten figures at 1, and other leaves by room and name."""
    card: dict[str, Any] = {"lengths": {"bars": []}, "points": {"anees_fitted": 1.25}}
    for _, key, form in TEN:
        room, name = key.split(".")
        card.setdefault(room, {})[name] = 1 if ":d" in form else 1.0
    for key, value in leaves.items():
        room, name = key.split("__")
        card[room][name] = value
    return card


@pytest.mark.parametrize(
    ("en", "failed"),
    [
        ([], False),
        ([None], False),
        ([0.0], False),
        ([0.5, None], False),
        ([1.0], False),
        ([-1.0], False),
        ([1.001], True),
        ([-1.001], True),
        ([0.2, None, -3.0], True),
        ([2.0, 0.1], True),
    ],
)
def test_a_check_bar_fails_where_its_error_exceeds_its_expanded_uncertainty(
    en: list[float | None], failed: bool
) -> None:
    bars: list[dict[str, Any]] = [{"role": "check", "en": one} for one in en]
    rows = ten_figures(card_of(lengths__bars=[*bars, {"role": "check", "note": "not measured"}]))
    assert rows[-1][1] == ("+1.0000 mm, FAILED" if failed else "+1.0000 mm")
    assert not any("FAILED" in said for _, said in rows[:-1])


def test_a_figure_that_does_not_exist_is_not_measured_and_zero_is_a_figure() -> None:
    none = {f"{key.replace('.', '__')}": None for _, key, _ in TEN if key != "points.anees"}
    assert [said for _, said in ten_figures(card_of(**none))] == [*["not measured"] * 8, "1.00", "not measured"]
    said = dict(ten_figures(card_of(detection__wrong_code=0, detection__centre_rms_px=0.0, points__anees=0.0)))
    assert [said[TEN[k][0]] for k in (1, 2, 8)] == ["0", "0.0000 px", "0.00"]


def test_nees_of_a_free_network_is_that_after_the_fit_and_says_so() -> None:
    rows = ten_figures(card_of(points__anees=None))
    assert rows[8][1] == "1.25" and rows[8][0] != TEN[8][0] and rows[8][0].startswith(TEN[8][0])
    assert ten_figures(card_of())[8] == (TEN[8][0], "1.00")


def test_what_is_no_number_is_null_and_all_else_stays() -> None:
    card = {"a": np.float64(1.5), "b": [np.int64(2), float("nan")], "c": (np.inf, None, True), "d": {"e": "f"}}
    assert plain(card) == {"a": 1.5, "b": [2, None], "c": [None, None, True], "d": {"e": "f"}}
    assert json.dumps(plain(card), allow_nan=False)


# ------------------------------------------------------------------ check points
def test_two_check_points_are_compared_without_a_fit(by_hand: HandMade) -> None:
    """21 and 23: off by (11, 20, -20) and (10, 22, -20) um."""
    two = score_points(by_hand.world, by_hand.calibration, some(by_hand.points, 31, 21, 23, 32))
    card = two.card()
    assert (card["measured"], card["expected"]) == (2, 7)
    rmse = ((121 + 400 + 400 + 100 + 484 + 400) / 6) ** 0.5 * 1e-3
    assert card["rmse_mm"] == pytest.approx(rmse, rel=1e-8) and card["rmse_unfitted_mm"] == card["rmse_mm"]
    assert card["worst_mm"] == pytest.approx(984**0.5 * 1e-3, rel=1e-8)
    assert card["relative_accuracy"] == pytest.approx(5000 / rmse, rel=1e-8)
    assert card["relative_accuracy_largest_distance"] == pytest.approx((1000**2 + 600**2) ** 0.5 / rmse, rel=1e-8)
    # The mean of two has the variance 4/2 + 5 um^2 (z: 12), half the difference 4/2.
    mean = (10.5**2 + 21**2) / (2 + 5) + 20**2 / (2 + 12)
    assert card["anees"] == pytest.approx((mean + (0.5**2 + 1) / 2) / 6, rel=1e-7)
    assert np.isnan(card["anees_fitted"])
    assert card["anees_band_95"] == pytest.approx([1.237 / 6, 14.449 / 6], rel=1e-3)  # chi-squared of 6, from a table
    assert two.error_mm is two.fitted_mm and not two.free


def test_one_check_point_has_no_largest_distance_and_none_has_no_figures(by_hand: HandMade) -> None:
    one = score_points(by_hand.world, by_hand.calibration, some(by_hand.points, 21)).card()
    assert one["measured"] == 1 and np.isnan(one["relative_accuracy_largest_distance"])
    assert one["rmse_mm"] == pytest.approx((921 / 3) ** 0.5 * 1e-3, rel=1e-8)
    assert one["anees"] == pytest.approx((11**2 / 9 + 20**2 / 9 + 20**2 / 16) / 3, rel=1e-8)
    none = plain(score_points(by_hand.world, by_hand.calibration, some(by_hand.points, 31, 32)).card())
    assert (none["measured"], none["expected"], none["worst_mm"], none["anees_band_95"]) == (0, 7, 0.0, None)
    for key in (
        "rmse_mm",
        "rmse_unfitted_mm",
        "mean_u_mm",
        "relative_accuracy",
        "anees",
        "anees_fitted",
        "relative_accuracy_largest_distance",
    ):
        assert none[key] is None, key


def test_a_free_network_of_fewer_than_three_check_points_says_nothing_of_them(by_hand: HandMade) -> None:
    free = replace(by_hand.calibration, board_names=(), boards=Poses.identity(0))
    assert score_points(by_hand.world, free, some(by_hand.points, 21, 22)).card()["measured"] == 0
    three = score_points(by_hand.world, free, some(by_hand.points, 21, 23, 25))
    assert three.card()["measured"] == 3 and three.free


def test_points_without_a_covariance_have_errors_and_no_nees(by_hand: HandMade) -> None:
    silent = replace(by_hand.points, cov_xyz_mm2=np.full_like(by_hand.points.cov_xyz_mm2, np.nan))
    whole, bare = (score_points(by_hand.world, by_hand.calibration, p).card() for p in (by_hand.points, silent))
    assert (bare["rmse_mm"], bare["worst_mm"]) == (whole["rmse_mm"], whole["worst_mm"])
    assert np.isnan(bare["anees"]) and np.isnan(bare["anees_fitted"]) and np.isfinite(whole["anees_fitted"])


def test_a_row_of_the_check_points_table_is_in_millimetres_and_micrometres() -> None:
    """Errors of metres show a factor that is wrong by a thousandth."""
    error, u = np.array([[1.0, 2, 2], [-30, 40, 120]]), np.array([[7.0, 8, 9], [10, 11, 12]])
    true = np.array([[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]])
    score = PointScore(
        code=np.array([8, 9]),
        true_mm=true,
        error_mm=error,
        fitted_mm=error,
        cov_mm2=np.diag(u.ravel() ** 2),
        anees=1.0,
        anees_fitted=1.0,
        diagonal_mm=5000.0,
        expected=2,
    )
    assert np.array(_check_rows(score)) == pytest.approx(
        np.array(
            [
                [9, 4.5, 5.5, 6.5, -30_000, 40_000, 120_000, 10_000, 11_000, 12_000],
                [8, 1.5, 2.5, 3.5, 1000, 2000, 2000, 7000, 8000, 9000],
            ]
        ),
        rel=1e-12,
    )


# ------------------------------------------------------------------ lengths
def test_the_scale_is_compared_to_a_part_in_a_thousand_million(by_hand: HandMade) -> None:
    found = score_lengths(by_hand.world, by_hand.calibration, by_hand.points)
    assert world_scale(by_hand.world) == pytest.approx(1.00002, rel=1e-14)
    assert found["scale_error_ppm"] == pytest.approx(15.0, rel=1e-9)
    assert found["u_scale_ppm"] == pytest.approx(5.0, rel=1e-9)


def test_without_boards_a_scale_label_or_check_bars_there_is_no_such_figure(by_hand: HandMade) -> None:
    c = by_hand.calibration
    given = score_lengths(by_hand.world, replace(c, labels=("given", *c.labels[1:])), by_hand.points)
    assert given["u_scale_ppm"] is None and given["scale_error_ppm"] == pytest.approx(15.0, rel=1e-9)
    free = score_lengths(by_hand.world, replace(c, board_names=(), boards=Poses.identity(0)), by_hand.points)
    assert free["scale_error_ppm"] is None and free["check_error_mm"] == pytest.approx(-0.014, rel=1e-8)
    control = score_lengths(by_hand.world, c, some(by_hand.points, 31, 32, 33))
    assert control["check_error_mm"] is None
    assert [bar.get("measured_mm") is not None for bar in control["bars"]] == [True, False, False, False]


# ------------------------------------------------------------------ camera
def test_a_place_is_what_lies_nearest_to_the_middle_of_its_cell() -> None:
    """Cells of 100 px; where two lie in one, the nearer to the middle is not the nearer to a corner."""
    camera = Interior(1300, 1100, np.array([1000.0, 1000, 649.5, 549.5, 0, 0, 0, 0, 0]))
    seen = np.array(
        [
            [95.0, 95],
            [45, 52],  # the first cell: the second
            [1299.9, 1099.9],
            [1210, 1095],  # the last cell: 69 and 60 px from its middle
            [160, 40],
            [101, 1],
            [199, 50],  # beside the first
            [50, 199],  # below it, alone
            [-0.4, 349.0],  # half a pixel left of the image, and all the same its first column
            [1300.0, 720.0],  # and right of it
        ]
    )
    expected = [[45, 52], [160, 40], [50, 199], [-0.4, 349], [1300, 720], [1210, 1095]]
    assert _places(camera, seen).tolist() == expected


def test_fewer_than_three_places_or_no_parameter_say_nothing_of_imaging(by_hand: HandMade) -> None:
    nothing = {"imaging_error_px": None, "imaging_u_px": None, "imaging_anees": None}
    c, true = by_hand.calibration, by_hand.world.interior
    assert imaging_score(true, replace(c, residual_at_px=c.residual_at_px[:2])) == nothing
    held = replace(c, labels=tuple(f"held {label}" for label in c.labels))
    assert imaging_score(true, held) == nothing
    assert imaging_score(true, c)["imaging_error_px"] > 0


def test_another_lens_model_is_judged_by_where_it_images(by_hand: HandMade) -> None:
    """A rational lens without distortion images like the pinhole of the hand-made field."""
    c = by_hand.calibration
    size = len(Interior(1000, 800, np.zeros(0), "rational").names)
    other = Interior(1000, 800, np.array([1001.0, 1001, 499.8, 399.5, *[0.0] * (size - 4)]), "rational")
    one, same = (score_camera(by_hand.world, calibration) for calibration in (replace(c, interior=other), c))
    assert (one["interior_error"], one["interior_u"], one["interior_anees"]) == ({}, {}, None)
    for key in ("corner_error_px", "imaging_error_px", "imaging_u_px", "imaging_anees"):
        assert one[key] == pytest.approx(same[key], rel=1e-6), key
    rows = _interior_rows(by_hand.world, replace(c, interior=other), one)
    assert rows[0] == ("fx", "–", "1001.0000", None, None) and len(rows) == size


def test_the_datum_alone_has_no_error_and_no_board_has_no_figure(by_hand: HandMade) -> None:
    c = by_hand.calibration
    alone = score_boards(by_hand.world, replace(c, board_names=("A",), boards=c.boards[:1]))
    assert (alone["joined"], alone["pose_rms_mm"], alone["names"]) == (1, 0.0, []) and np.isnan(alone["anees"])
    none = score_boards(by_hand.world, replace(c, board_names=(), boards=Poses.identity(0)))
    assert (none["joined"], none["pose_rms_mm"], none["names"]) == (0, None, [])


def test_a_board_whose_covariance_nobody_states_has_a_shift_and_no_nees(by_hand: HandMade) -> None:
    """C alone has NEES then: (0.03 / 0.06)^2 + (0.04 / 0.16)^2."""
    c = by_hand.calibration
    labels = tuple(label.replace("board:B.tx", "board:?.tx") for label in c.labels)
    boards = score_boards(by_hand.world, replace(c, labels=labels))
    assert boards["anees"] == pytest.approx((0.25 + 0.0625) / 6, rel=1e-6)
    assert boards["translation_error_mm"] == pytest.approx([0.05, 0.12], rel=1e-8)


# ------------------------------------------------------------------ the page's small tables
def test_the_page_shows_the_station_that_measured_most(by_hand: HandMade) -> None:
    o = by_hand.observations
    assert _telling_station(o) == "left"  # 13 of 14 against 4 of 5
    assert _telling_station(replace(o, station=1 - o.station)) == "right"
    assert _status_rows(o)[0] == ("measured", 17) and sorted(n for _, n in _status_rows(o)) == [1, 1, 17]
    few = replace(o, status=np.where(np.arange(19) < 3, "measured", np.where(np.arange(19) < 9, "astray", "skew")))
    assert _status_rows(few) == [("measured", 3), ("skew", 10), ("astray", 6)]


def test_images_are_told_by_the_way_they_were_made() -> None:
    made = {
        "a": {"mode": "fast", "samples": 0, "noise": 0.0, "over_target": 0.0},
        "b": {"mode": "sampled", "samples": 30, "noise": 0.002, "over_target": 0.02},
        "c": {"mode": "sampled", "samples": 50, "noise": 0.0051, "over_target": 0.01},
        "d": {"mode": "fast", "samples": 0, "noise": 0.0, "over_target": 0.0},
    }
    fast, sampled = _making_rows(made)
    assert fast == "fast: a, d"
    for figure in ("sampled: b, c;", "40 samples", "0.20 to 0.51 %", "2.00 %"):
        assert figure in sampled
    assert _making_rows({}) == []
