"""Ranks, curves and shares of a comparison hold what they say they hold."""

import numpy as np
import pandas as pd
import pytest

from testfield.evaluate.curves import axis_of, curve
from testfield.evaluate.paired import Word, difference, mean_over_levels
from testfield.evaluate.ranks import rank_intervals
from testfield.evaluate.stated import stated_table
from testfield.statistics.consistency import nees_band


def test_rank_intervals_hold_all_true_places_at_once_in_95_of_a_hundred() -> None:
    rng, trials, true = np.random.default_rng(1), 300, {"a": 1.0, "b": 1.0, "c": 1.3, "d": 5.0}
    held = []
    for _ in range(trials):
        common = rng.normal(size=8)
        figures = {name: [mean + common + 0.3 * rng.normal(size=8)] for name, mean in true.items()}
        table = rank_intervals(figures, 0.1).set_index("recipe")
        # a and b share the first place: each may be first or second.
        places = {"a": (1, 2), "b": (1, 2), "c": (3, 3), "d": (4, 4)}
        held.append(all(table.best[n] <= low and high <= table.worst[n] for n, (low, high) in places.items()))
    assert np.mean(held) >= 0.93
    assert (table.best["d"], table.worst["d"], table["rank"]["d"]) == (4, 4, 4)


def test_who_gave_no_figures_has_no_place() -> None:
    figures = {"a": [np.array([1.0, 1.1, 0.9])], "b": [np.array([2.0, 2.1, 1.9])], "c": [np.full(3, np.nan)]}
    table = rank_intervals(figures, 0.1)
    assert table.recipe.tolist() == ["a", "b"] and table.worst.tolist() == [1, 2]


def test_who_fails_where_it_is_hard_gains_no_place() -> None:
    easy, hard = np.array([1.0, 1.01, 0.99]), np.array([5.0, 5.01, 4.99])
    table = rank_intervals({"a": [easy, np.full(3, np.nan)], "b": [easy - 0.1, hard]}, 0.001).set_index("recipe")
    assert table["mean"].tolist() == pytest.approx([1.0, 0.9])
    assert ((table.best <= table["rank"]) & (table["rank"] <= table.worst)).all()
    assert table["rank"].to_dict() == {"a": 2, "b": 1}
    assert set(table.draws) == {3} and set(table.of_draws) == {6}


def test_ranks_lie_in_their_intervals_whatever_failed() -> None:
    rng = np.random.default_rng(12)
    for _ in range(200):
        figures = {name: [rng.normal(size=(2, 6)) * 0.1 + rng.integers(0, 3) for _ in range(3)] for name in "abc"}
        for values in figures.values():
            for scene in values:
                scene[rng.random(scene.shape) < 0.3] = np.nan
        table = rank_intervals(figures, 0.1)
        assert ((table.best <= table["rank"]) & (table["rank"] <= table.worst)).all()


def test_where_no_draw_is_common_to_all_nobody_has_a_place() -> None:
    figures = {"a": [np.array([1.0, np.nan])], "b": [np.array([np.nan, 2.0])]}
    assert not len(rank_intervals(figures, 0.1))


def test_levels_of_a_factor_are_no_draws() -> None:
    rng, trials = np.random.default_rng(2), 1000
    found = []
    for _ in range(trials):
        levels = np.array([[0.0], [5.0], [10.0]])  # what the factor does is no noise
        first = levels + rng.normal(size=(3, 1)) * 0 + rng.normal(size=(3, 6))
        other = first + levels + 0.3 * rng.normal(size=(3, 6)) * [[1.0], [2.0], [3.0]]
        low, high = difference([first], [other], 1e-9).estimate.interval()
        found.append(low <= 5 <= high)
    assert 0.93 <= np.mean(found) <= 0.97


@pytest.mark.parametrize("lost", [0.0, 0.15])
def test_noise_that_levels_share_is_not_averaged_away(lost: float) -> None:
    rng, found = np.random.default_rng(4), []
    for _ in range(1000):
        own, common = 0.3 * rng.normal(size=(5, 12)), rng.normal(size=(1, 12))
        other = own + common + np.arange(5.0)[:, None]
        other[rng.random(other.shape) < lost] = np.nan
        low, high = difference([np.zeros((5, 12))], [other], 1e-9).estimate.interval()
        found.append(low <= 2 <= high)
    assert 0.93 <= np.mean(found) <= 0.97


def test_a_level_of_one_draw_says_nothing_of_how_sure() -> None:
    assert mean_over_levels(np.array([[1.0, 2.0], [4.0, np.nan]])).freedom == 0
    assert difference([np.array([[1.0, 2.0], [3.0, np.nan]])], [np.ones((2, 2))], 1.0).word is Word.ONE


def test_a_curve_has_bands_of_draws_or_of_scenes() -> None:
    rng = np.random.default_rng(3)
    index = pd.MultiIndex.from_product([["s"], ["blur"], [0, 1], range(6)], names=["scene", "factor", "level", "draw"])
    level = index.get_level_values("level").to_numpy()
    common = rng.normal(size=len(index))
    table = pd.DataFrame({"a": level + common, "b": 3 * level + common + 0.01 * rng.normal(size=len(index))}, index)
    found = curve(table, ["a", "b"]).set_index(["level", "recipe"])
    assert found["mean"][1, "b"] - found["mean"][1, "a"] == pytest.approx(2, abs=0.02)
    assert found.difference_low[1, "b"] < 2 < found.difference_high[1, "b"]
    width = found.high - found.low
    assert width[1, "b"] > 20 * (found.difference_high - found.difference_low)[1, "b"]
    two = pd.concat([table, table.rename(index={"s": "t"}) + 100])
    assert curve(two, ["a", "b"]).high.iloc[0] > 500  # two scenes that differ by 100


def test_values_that_are_no_numbers_are_named_on_the_axis() -> None:
    at, words = axis_of((4, 8.0))
    assert at.tolist() == [4, 8] and words is None
    at, words = axis_of(((0, 1), (1, 0)))
    assert at.tolist() == [0, 1] and words == ["(0, 1)", "(1, 0)"]


@pytest.mark.parametrize(("factor", "too_small"), [(1.0, False), (4.0, True)])
def test_true_claims_lie_in_the_band_and_small_ones_above(factor: float, too_small: bool) -> None:
    rng = np.random.default_rng(4)
    rows = []
    for scene in ("s", "t", "u", "v"):
        for draw in range(10):
            squares = {"centre_nees": (factor * rng.chisquare(2, 300)).tolist(), "station": [0] * 300}
            squares |= {"point_nees": (factor * rng.chisquare(3, 30)).tolist()}
            claims = {"calibration.interior_error.fx": np.sqrt(factor) * rng.normal(), "calibration.interior_u.fx": 1.0}
            rows.append({"scene": scene, "level": -1, "draw": draw, "recipe": "a"} | squares | claims)
    found = stated_table(pd.DataFrame(rows), ["a"]).set_index("of")
    assert found.anees["centres"] == pytest.approx(factor, rel=0.03)
    for of in ("centres", "check points"):
        assert (found.anees[of] > found.high[of]) == too_small
        assert (found.held_95_low[of] <= 0.95 <= found.held_95_high[of]) != too_small
        assert (found.held_68_low[of] <= 0.68 <= found.held_68_high[of]) != too_small
    assert found.errors["interior orientation"] == 40


def parameters(camera: str, error: float, u: float) -> dict[str, float]:
    return {f"calibration.{camera}interior_error.fx": error, f"calibration.{camera}interior_u.fx": u}


def test_what_is_not_stated_makes_no_band_narrower() -> None:
    of = {"centre_nees": [1.0, 2.0], "point_nees": [3.0, 2.0], "station": [0, 0]} | parameters("", 1.0, 1.0)
    none = {"centre_nees": [np.nan] * 2, "point_nees": [np.nan] * 2, "station": [0, 0]} | parameters("", 1.0, np.nan)
    failed = {"centre_nees": None, "point_nees": None}
    labels = {"level": -1, "draw": 1, "recipe": "a"}
    alone = stated_table(pd.DataFrame([{"scene": "s"} | labels | of]), ["a"])
    some = [("s", of | {"calibration.interior_u.cx": np.nan, "calibration.interior_error.cx": 0.1})]
    rows = [{"scene": scene} | labels | row for scene, row in [*some, ("t", none), ("u", none), ("v", failed)]]
    found = stated_table(pd.DataFrame(rows), ["a"])
    for key in ("anees", "low", "high", "errors"):
        assert found[key].tolist() == pytest.approx(alone[key].tolist())


def test_of_several_cameras_each_counts_and_not_the_worst_alone() -> None:
    rng, rows = np.random.default_rng(6), []
    for scene in range(40):
        errors = rng.normal(size=4)
        each = [parameters(f"cameras.{k}.", error, 1.0) for k, error in enumerate(errors)]
        row = {"scene": f"s{scene}", "level": -1, "draw": 1, "recipe": "a"}
        rows.append(row | parameters("", errors[np.argmax(abs(errors))], 1.0))
        for one in each:
            rows[-1] |= one
    found = stated_table(pd.DataFrame(rows), ["a"]).set_index("of").loc["interior orientation"]
    assert found.errors == 160 and found.low < found.anees < found.high
    assert found.held_95_low <= 0.95 <= found.held_95_high
    assert found.high - found.low == pytest.approx(np.subtract(*nees_band(160)[::-1]))


def test_what_states_nothing_has_no_figures() -> None:
    rows = pd.DataFrame(
        [{"scene": "s", "level": -1, "draw": 1, "recipe": "a", "centre_nees": [np.nan] * 3, "station": [0] * 3}]
    )
    found = stated_table(rows, ["a"])
    assert found.errors.tolist() == [0, 0, 0] and found.anees.isna().all() and found.held_95.isna().all()
