"""The score of detections at its bounds, on the hand-made observations: what just belongs to a mark, and what not."""

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hand_made import HandMade

from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.scene.truth import Views
from testfield.score.detection import DetectionScore, score_detection
from testfield.score.scorecard import plain

CODED, UNNAMED = 2, 7
"""Rows: the one of code 1 at the image of mark 4; one without a name, 5 px beside mark 0."""
Score = Callable[..., DetectionScore]


@pytest.fixture
def score(by_hand: HandMade) -> Score:
    """Scores the hand-made observations with one of them that far from its mark, and with that width."""

    def scored(row: int, mark: int, off_px: float, width_px: float, views: Views = by_hand.views) -> DetectionScore:
        o = by_hand.observations
        xy, moments = o.xy_px.copy(), o.moments_px2.copy()
        xy[row] = views.disc_px[0, mark] + [0, off_px]
        moments[row] = (width_px / 4) ** 2 * np.eye(2)
        return score_detection(by_hand.world, views, replace(o, xy_px=xy, moments_px2=moments))

    return scored


def none_of(o: Observations) -> Observations:
    """The same, nothing having been measured."""
    return replace(o, status=np.where(o.status == MEASURED, "odd", o.status))


@pytest.mark.parametrize(("width_px", "reach_px"), [(20.0, 10.0), (3.0, 2.0), (4.5, 2.25), (np.nan, 10.0)])
def test_a_named_blob_belongs_to_its_mark_within_half_its_width_and_two_pixels(
    score: Score, width_px: float, reach_px: float
) -> None:
    """Of a blob whose width nobody states that of the mark counts, 20 px."""
    inside, outside = (score(CODED, 4, reach_px + off, width_px) for off in (-0.01, 0.01))
    assert (len(inside.row), len(outside.row)) == (10, 9)
    assert (len(inside.wrong_code), len(outside.wrong_code)) == (3, 4)


def test_of_a_mark_of_three_pixels_an_unstated_width_reaches_two(by_hand: HandMade, score: Score) -> None:
    diameter = by_hand.views.diameter_px.copy()
    diameter[0, 4] = 3.0
    small = replace(by_hand.views, diameter_px=diameter)
    assert [len(score(CODED, 4, off, np.nan, small).row) for off in (1.99, 2.01)] == [10, 9]


@pytest.mark.parametrize(("width_px", "reach_px"), [(20.0, 10.0), (3.0, 2.0), (np.nan, 2.0)])
def test_a_blob_without_a_name_is_false_where_no_mark_is_within_its_reach(
    score: Score, width_px: float, reach_px: float
) -> None:
    inside, outside = (score(UNNAMED, 0, reach_px + off, width_px) for off in (-0.01, 0.01))
    assert (len(inside.false), len(outside.false)) == (2, 3) and UNNAMED in outside.false


def test_a_blob_where_a_station_sees_no_mark_is_false(by_hand: HandMade) -> None:
    blind = by_hand.views.visible.copy()
    blind[1] = 0
    o = by_hand.observations
    unnamed = replace(
        o,
        code=np.where(o.station == 1, 0, o.code),
        board=np.where(o.station == 1, -1, o.board),
        point=np.where(o.station == 1, -1, o.point),
    )
    found = score_detection(by_hand.world, replace(by_hand.views, visible=blind), unnamed)
    assert set(np.flatnonzero((o.station == 1) & (o.status == MEASURED))) <= set(found.false.tolist())


def test_a_target_that_dirt_hides_whole_and_one_too_small_are_no_dirty_ones(by_hand: HandMade) -> None:
    """Of the dirty ones 14 and 15 at the left, one is hidden whole, or below 8 px."""
    v = by_hand.views
    clean, visible, diameter = v.clean.copy(), v.visible.copy(), v.diameter_px.copy()
    clean[15] = visible[0, 15] = 0.0
    hidden = score_detection(by_hand.world, replace(v, clean=clean, visible=visible), by_hand.observations).card()
    assert (hidden["dirty"], hidden["dirty_found"], hidden["expected"]) == (1, 1, 12)
    diameter[0, 14], diameter[0, 15] = 8.0, 7.999
    small = score_detection(by_hand.world, replace(v, diameter_px=diameter), by_hand.observations).card()
    assert (small["dirty"], small["dirty_found"]) == (1, 1)


@pytest.mark.parametrize(("off_px", "why"), [(20.0, "odd"), (20.001, "no blob there")])
def test_a_blob_within_a_targets_width_tells_why_it_is_missed(by_hand: HandMade, off_px: float, why: str) -> None:
    """Mark 4 is expected at the left; the blob nearest to it was turned down. The marks' images are 30 px apart."""
    o, at = by_hand.observations, by_hand.views.disc_px[0, 4]
    status, xy = o.status.copy(), o.xy_px.copy()
    status[CODED] = "odd"
    xy[CODED] = at + [0, off_px]
    before = score_detection(by_hand.world, by_hand.views, o).missed
    after = score_detection(by_hand.world, by_hand.views, replace(o, status=status, xy_px=xy)).missed
    assert {key: n - before.get(key, 0) for key, n in after.items() if n != before.get(key, 0)} == {why: 1}


def test_a_blob_of_another_image_does_not_tell_why_a_target_is_missed(by_hand: HandMade) -> None:
    """One of the right, put where the left misses mark 4 for want of a blob, and the other way round."""
    o, seen = by_hand.observations, by_hand.views.disc_px
    for row, station in ((18, 0), (CODED, 1)):
        xy, status = o.xy_px.copy(), o.status.copy()
        xy[CODED] = [900.0, 30]
        status[row] = "odd"
        before = score_detection(by_hand.world, by_hand.views, replace(o, xy_px=xy, status=status)).missed
        xy[row] = seen[station, 4]
        after = score_detection(by_hand.world, by_hand.views, replace(o, xy_px=xy, status=status)).missed
        assert "odd" not in after and after["no blob there"] >= before["no blob there"] >= 2


def test_what_an_image_without_any_blob_misses_is_not_there(by_hand: HandMade) -> None:
    left = by_hand.observations.take(by_hand.observations.station == 0)
    missed = score_detection(by_hand.world, by_hand.views, left).missed
    whole = score_detection(by_hand.world, by_hand.views, by_hand.observations).missed
    assert sum(missed.values()) - sum(whole.values()) == 3  # 0, 17 and 18 were found at the right
    assert missed["no blob there"] == 5 and "saturated" not in missed  # all five of the right, none of the left


def test_where_nothing_was_measured_no_figure_exists_and_nothing_warns(by_hand: HandMade) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        card = plain(score_detection(by_hand.world, by_hand.views, none_of(by_hand.observations)).card())
    assert (card["measured"], card["found"], card["missed"], card["centre_worst_px"]) == (0, 0, 12, 0.0)
    for key in ("centre_rms_px", "centre_bias_px", "centre_bias_x_px", "centre_bias_y_px", "centre_anees"):
        assert card[key] is None, key


def test_of_no_expected_target_all_were_found(by_hand: HandMade) -> None:
    none = replace(by_hand.views, visible=0.5 * (by_hand.views.visible > 0))
    card = score_detection(by_hand.world, none, by_hand.observations).card()
    assert (card["expected"], card["found"], card["missed"], card["found_fraction"]) == (0, 0, 0, 1.0)


def test_a_covariance_that_is_not_stated_gives_no_nees_and_leaves_the_others(by_hand: HandMade) -> None:
    """Without the first one, whose 25/4 the mean misses."""
    o = by_hand.observations
    cov = o.cov_px2.copy()
    cov[0] = np.nan
    card = score_detection(by_hand.world, by_hand.views, replace(o, cov_px2=cov)).card()
    assert card["centre_anees"] == pytest.approx((1 + 8 / 3 + 2 + 1 + 1 + 5 + 5 + 0 + 1) / 18, rel=1e-9)
    assert card["measured"] == 10


def test_an_image_that_the_scene_has_not_is_named(by_hand: HandMade) -> None:
    other = replace(by_hand.observations, stations=("left", "nowhere"))
    with pytest.raises(TestfieldError, match="'nowhere' is not in the scene") as refused:
        score_detection(by_hand.world, by_hand.views, other)
    assert "left, right" in str(refused.value) and "observations.parquet" in str(refused.value)
