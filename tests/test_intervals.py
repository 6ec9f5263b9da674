"""Intervals of medians, rms, shares, ratios and correlations."""

import numpy as np
import pytest

from testfield.statistics.intervals import lag_of, median_of, ratio_of, rms_of, share_of


def test_medians_and_their_intervals() -> None:
    found = median_of(np.arange(1.0, 101.0))
    assert found == {"worlds": 100, "median": 50.5, "low": 40.0, "high": 61.0}
    assert median_of(np.array([3.0, np.nan, 1.0])) == {"worlds": 3, "median": 3.0, "low": 1.0, "high": np.inf}
    assert median_of(np.arange(6.0)) == {"worlds": 6, "median": 2.5, "low": 0.0, "high": 5.0}
    assert median_of(np.array([]))["worlds"] == 0 and np.isnan(median_of(np.array([]))["median"])


def test_an_rms_lies_in_its_interval_as_often_as_is_said() -> None:
    rng = np.random.default_rng(3)
    held = []
    for _ in range(500):
        _, low, high = rms_of(rng.normal(0, 2, 8))
        held.append(low < 2 < high)
    assert 0.92 < np.mean(held) < 0.98


def test_shares_have_the_interval_of_clopper_and_pearson() -> None:
    # Of 0 of n the upper end solves (1 - p)^n = 0.025, of n of n the lower end p^n = 0.025.
    assert share_of(0, 5) == pytest.approx((0, 0, 1 - 0.025**0.2))
    assert share_of(5, 5) == pytest.approx((1, 0.025**0.2, 1))


def test_what_worlds_in_pairs_share_does_not_blur_their_ratio() -> None:
    rng = np.random.default_rng(5)
    shared = rng.normal(0, 1, 40)
    over, under = 1.3 * shared + 0.05 * rng.normal(0, 1, 40), shared
    found, low, high = ratio_of(over, under)
    assert low < 1.3 < high and high - low < 0.1 and low < found < high
    apart = ratio_of(over, rng.permutation(under))
    assert apart[2] - apart[1] > 4 * (high - low)


def test_too_few_worlds_tell_no_ratio() -> None:
    found, low, high = ratio_of(np.full(5, 3.0), np.full(5, 1.0))
    assert (found, low, high) == (3.0, -np.inf, np.inf)
    assert np.isnan(ratio_of(np.array([]), np.array([]))).all()


def test_turns_that_turn_back_their_neighbours_correlate_by_minus_a_half() -> None:
    rng = np.random.default_rng(6)
    back, alone = np.diff(rng.normal(0, 1, (60, 8))), rng.normal(0, 1, (60, 7))
    found, low, high = lag_of(back)
    assert low < -0.5 < high < 0 and low < found < high
    _, low, high = lag_of(alone)
    assert low < 0 < high
    assert np.isnan(lag_of(alone[:, :1])).all()
