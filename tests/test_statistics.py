"""Bands, intervals and decisions keep the probabilities that they state, also where values come in clusters."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from testfield.errors import TestfieldError
from testfield.statistics.clusters import (
    Estimate,
    bootstrap_ratio,
    clopper_pearson,
    cluster_means,
    mean_of_clusters,
    share_of_clusters,
)
from testfield.statistics.consistency import hit_band, joint_hit_band, nees_band, trials_to_tell
from testfield.statistics.decide import Margin, Side, equivalence, holm, side_of, side_of_interval
from testfield.statistics.jackknife import jackknife, jackknife_ratio


# ------------------------------------------------------------------ clusters
def test_an_estimate_has_students_interval() -> None:
    found = mean_of_clusters(np.array([1.0, 2.0, 3.0]))
    assert (found.value, found.freedom) == (2.0, 2) and found.u == pytest.approx(1 / np.sqrt(3))
    assert found.interval(0.95) == pytest.approx((2 - 4.302653 / np.sqrt(3), 2 + 4.302653 / np.sqrt(3)), abs=1e-5)
    assert found.chance(2 + 4.302653 / np.sqrt(3)) == pytest.approx(0.05, abs=1e-6)
    assert Estimate(value=0.0, u=1.0).interval(0.95) == pytest.approx((-1.959964, 1.959964), abs=1e-6)


@pytest.mark.parametrize("means", [np.zeros(0), np.ones(1)])
def test_one_cluster_decides_nothing(means: np.ndarray) -> None:
    found = mean_of_clusters(means)
    assert found.interval() == (-np.inf, np.inf) and found.chance(7.0) == 1.0
    assert equivalence(found, 1.0, Margin(below=9, above=9, reason="wide")) == 1.0


def test_values_are_averaged_within_their_clusters_first() -> None:
    means = cluster_means(np.array([1.0, 1, 1, 4]), np.array(["a", "a", "a", "b"]))
    assert means.tolist() == [1, 4] and mean_of_clusters(means).value == 2.5
    with pytest.raises(TestfieldError, match="clusters"):
        cluster_means(np.ones(3), np.zeros(2))


def in_clusters(rng: np.random.Generator, shape: tuple[int, int], correlation: float) -> np.ndarray:
    """(clusters, values) standard normal values, alike within a cluster by `correlation`."""
    shared = np.sqrt(correlation) * rng.standard_normal((*shape[:-1], 1))
    return shared + np.sqrt(1 - correlation) * rng.standard_normal(shape)


def test_the_spread_between_clusters_keeps_a_mean_where_that_of_all_values_does_not() -> None:
    rng, by_cluster, by_value = np.random.default_rng(1), 0, 0
    for _ in range(1000):
        values = in_clusters(rng, (12, 20), 0.5)
        by_cluster += mean_of_clusters(values.mean(axis=1)).chance(0.0) < 0.05
        by_value += mean_of_clusters(values.ravel()).chance(0.0) < 0.05
    low, high = hit_band(1000, 0.05, 0.999)
    assert low <= by_cluster <= high and by_value > 400


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.99])
def test_a_shares_interval_holds_whatever_the_correlation_within_clusters(correlation: float) -> None:
    rng, missed, missed_by_count = np.random.default_rng(2), 0, 0
    for _ in range(2000):
        hits = (np.abs(in_clusters(rng, (100, 20), correlation)) <= norm.ppf(0.975)).sum(axis=1)
        _, low, high = share_of_clusters(hits, np.full(100, 20), 0.99)
        missed += not low <= 0.95 <= high
        low, high = clopper_pearson(hits.sum(), 2000, 0.99)
        missed_by_count += not low <= 0.95 <= high
    assert missed <= hit_band(2000, 0.01)[1]
    if correlation > 0.4:
        assert missed_by_count > 2000 * 0.1


def test_a_share_that_does_not_scatter_counts_its_clusters() -> None:
    share, low, high = share_of_clusters(np.full(50, 20), np.full(50, 20), 0.95)
    assert (share, high) == (1, 1) and low == pytest.approx(0.025 ** (1 / 50))
    assert share_of_clusters(np.array([3]), np.array([4])) == (0.75, 0, 1)
    assert clopper_pearson(1, 10) == pytest.approx((0.002529, 0.445016), abs=1e-6)


def test_a_bootstrap_of_clusters_holds_the_ratio() -> None:
    rng, held = np.random.default_rng(3), 0
    for _ in range(300):
        under = rng.exponential(1, 60) + 1
        _, low, high = bootstrap_ratio(3 * under + rng.normal(0, 0.5, 60), under, "a test")
        held += low <= 3 <= high
    assert 0.90 < held / 300 < 0.98
    assert bootstrap_ratio(np.array([2.0]), np.array([1.0]), "a test") == (2, -np.inf, np.inf)


# ------------------------------------------------------------------ jackknife
def test_the_jackknife_of_a_mean_is_students_interval() -> None:
    values = np.array([1.0, 4, 2, 8])
    left = (values.sum() - values) / 3
    value, low, high = jackknife(values.mean(), left)
    assert (low, high) == pytest.approx(mean_of_clusters(values).interval())
    assert value == values.mean()


def test_the_jackknife_of_a_ratio_leaves_out_clusters_without_both_sums() -> None:
    rng = np.random.default_rng(4)
    over, under = rng.exponential(1, 8) + 2, rng.exponential(1, 8) + 1
    found = jackknife_ratio(over, under, 0.5)
    assert jackknife_ratio(np.append(over, 9), np.append(under, 0), 0.5) == found
    assert found[0] == pytest.approx(np.sqrt(over.sum() / under.sum())) and found[1] < found[0] < found[2]
    assert np.isnan(jackknife_ratio(np.zeros(3), np.ones(3))).all()
    assert np.isnan(jackknife_ratio(np.ones(1), np.ones(1))[1:]).all()


# ------------------------------------------------------------------ decisions
@pytest.mark.parametrize(
    ("low", "high", "value", "side"),
    [
        (1.02, 1.2, 1.1, Side.ABOVE),
        (0.7, 0.9, 0.8, Side.BELOW),
        (0.7, 1.1, 0.9, Side.OPEN),
        (0.96, 1.04, 1.0, Side.SAME),
        (1.001, 1.009, 1.005, Side.SAME),  # certainly above, but by less than counts
        (np.nan, np.nan, 1.0, Side.OPEN),
        (-np.inf, np.inf, 1.0, Side.OPEN),
    ],
)
def test_an_interval_decides_the_side(low: float, high: float, value: float, side: Side) -> None:
    assert side_of(low, high, 1.0, value=value, least=0.01, same=0.05) is side


def test_the_side_of_zero_is_a_sign() -> None:
    assert [side_of(*ends).sign for ends in ((0.1, 0.2), (-0.2, -0.1), (-0.1, 0.1))] == [1, -1, 0]
    assert side_of_interval(1, 2, 3, 4) is Side.BELOW and side_of_interval(3, 4, 1, 2) is Side.ABOVE
    assert side_of_interval(1, 3, 2, 4) is Side.OPEN and side_of_interval(1, np.inf, 2, np.inf) is Side.OPEN


def test_equivalence_needs_a_value_well_within_its_margin() -> None:
    margin = Margin(below=0.1, above=0.1, reason="a tenth is of no consequence here")
    assert equivalence(Estimate(value=1.0, u=0.02), 1.0, margin) < 1e-6
    assert equivalence(Estimate(value=1.0, u=0.1), 1.0, margin) > 0.1
    assert equivalence(Estimate(value=1.1, u=0.02), 1.0, margin) == pytest.approx(0.5)
    assert equivalence(Estimate(value=1.0, u=0.0, freedom=3), 1.0, margin) == 0
    rng = np.random.default_rng(5)
    called = [equivalence(mean_of_clusters(rng.normal(1.1, 0.1, 12)), 1.0, margin) < 0.05 for _ in range(2000)]
    low, high = hit_band(2000, 0.05, 0.999)
    assert low <= sum(called) <= high  # at the edge of the margin one in twenty is called the same


def test_holm_multiplies_by_the_tests_that_are_left() -> None:
    # The example of R's p.adjust: 0.01, 0.02, 0.03, 0.04, 0.05 become 0.05, 0.08, 0.09, 0.09, 0.09.
    assert holm(np.array([0.03, 0.01, 0.05, 0.02, 0.04])) == pytest.approx([0.09, 0.05, 0.09, 0.08, 0.09])
    assert holm(np.array([0.9, 0.8])) == pytest.approx([1, 1]) and len(holm(np.zeros(0))) == 0
    false_alarms = (np.array([holm(p).min() for p in np.random.default_rng(6).random((4000, 10))]) < 0.05).mean()
    assert 0.03 < false_alarms <= 0.06


# ------------------------------------------------------------------ bands of claims
def test_joint_hits_of_independent_parts_are_binomial_and_of_one_error_all_or_none() -> None:
    low, high = hit_band(60, 0.95)
    found = joint_hit_band(np.diag(np.random.default_rng(7).exponential(1, 180)), 3)
    assert abs(found[0] - low) <= 1 and found[1] == high
    together = np.tile(np.eye(3), (10, 10)) + 1e-6 * np.eye(30)
    assert joint_hit_band(together, 3) == (0, 10)


def test_enough_trials_tell_a_covariance_that_is_wrong() -> None:
    n = trials_to_tell(9, 1.2, level=0.01, power=0.95)
    assert n == 121  # METHODS section 9.1
    low, high = nees_band(9 * n, 0.99)
    rng = np.random.default_rng(8)
    nees = chi2.rvs(9 * n, size=4000, random_state=rng) / (9 * n)
    for factor in (1.2, 1 / 1.2):
        assert ((factor * nees < low) | (factor * nees > high)).mean() > 0.93
    assert ((nees < low) | (nees > high)).mean() < 0.016
    assert trials_to_tell(9, 2.0) < n < trials_to_tell(9, 1.1)
    for factor in (1.0, -1.0):
        with pytest.raises(TestfieldError, match="cannot be told"):
            trials_to_tell(9, factor)
