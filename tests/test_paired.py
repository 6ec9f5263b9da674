"""Words of a comparison are as often wrong as is said, and its intervals hold what they say they hold."""

import json

import numpy as np
import pytest
from scipy.stats import nct, t

from testfield.cli.main import main
from testfield.evaluate.paired import LEVEL, Word, difference, together

TRIALS = 1000
NEXT_TO_NOTHING = 1e-9


def drawn(
    rng: np.random.Generator, scenes: int, draws: int, shift: float = 0.0, scene_shift: float = 0.0, own: float = 0.3
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Two figures of about 10: scenes differ by 3, draws by 1 alike for both, and by `own` for each; the second is
    `shift` worse, in every scene by another amount around it."""
    first, other = [], []
    for _ in range(scenes):
        common = 10 + 3 * rng.normal() + rng.normal(size=draws)
        first.append(common + own * rng.normal(size=draws))
        other.append(common + own * rng.normal(size=draws) + shift + scene_shift * rng.normal())
    return first, other


@pytest.mark.parametrize("scenes", [1, 6])
def test_equal_algorithms_are_called_better_or_worse_in_five_of_a_hundred(scenes: int) -> None:
    rng = np.random.default_rng(scenes)
    words = [difference(*drawn(rng, scenes, 8), NEXT_TO_NOTHING).word for _ in range(TRIALS)]
    assert 0.035 <= np.mean([word in (Word.BETTER, Word.WORSE) for word in words]) <= 0.065


def test_intervals_hold_95_of_a_hundred_where_draws_come_in_scenes() -> None:
    rng = np.random.default_rng(3)
    held = []
    for _ in range(TRIALS):
        low, high = difference(*drawn(rng, 8, 12, 0.5, 0.4), NEXT_TO_NOTHING).estimate.interval()
        held.append(low <= 0.5 <= high)
    assert 0.93 <= np.mean(held) <= 0.97


def test_a_difference_of_five_in_a_hundred_is_found_as_often_as_theory_says() -> None:
    rng, draws, shift, own = np.random.default_rng(4), 6, 0.5, 0.3
    words = [difference(*drawn(rng, 1, draws, shift, own=own), NEXT_TO_NOTHING).word for _ in range(TRIALS)]
    limit, off = t.ppf(1 - LEVEL / 2, draws - 1), shift / (own * np.sqrt(2 / draws))
    power = nct.sf(limit, draws - 1, off)
    assert np.mean([word is Word.WORSE for word in words]) == pytest.approx(power, abs=4 * np.sqrt(power / TRIALS))
    assert 0.4 < power < 0.99


def test_of_many_equal_ones_any_is_called_different_in_no_more_than_five_of_a_hundred() -> None:
    rng = np.random.default_rng(5)
    wrong = []
    for _ in range(TRIALS // 2):
        many = together([difference(*drawn(rng, 1, 6), NEXT_TO_NOTHING) for _ in range(12)])
        wrong.append(any(one.word in (Word.BETTER, Word.WORSE) for one in many))
    assert np.mean(wrong) <= 0.075


def test_what_differs_by_less_than_what_matters_is_equivalent_and_by_as_much_is_not() -> None:
    rng = np.random.default_rng(6)
    small = [difference(*drawn(rng, 1, 12, 0.1), 1.0).word for _ in range(200)]
    edge = [difference(*drawn(rng, 1, 12, 1.0), 1.0).word for _ in range(TRIALS)]
    assert np.mean([word is Word.EQUIVALENT for word in small]) > 0.99
    assert np.mean([word is Word.EQUIVALENT for word in edge]) <= 0.065


def test_of_many_that_just_matter_any_is_called_equivalent_in_no_more_than_five_of_a_hundred() -> None:
    rng = np.random.default_rng(8)
    wrong = []
    for _ in range(TRIALS // 2):
        many = together([difference(*drawn(rng, 1, 12, 1.0), 1.0) for _ in range(12)])
        wrong.append(any(one.word is Word.EQUIVALENT for one in many))
    assert np.mean(wrong) <= 0.075


def test_common_noise_makes_intervals_several_times_narrower() -> None:
    one = difference(*drawn(np.random.default_rng(7), 1, 400), NEXT_TO_NOTHING)
    assert one.unpaired_u / one.estimate.u == pytest.approx(np.sqrt((1 + 0.09) / 0.09), rel=0.1)


def test_one_draw_and_what_gave_no_figure_are_called_so() -> None:
    one = difference([np.array([1.0])], [np.array([2.0])], 0.1)
    assert one.word is Word.ONE and one.estimate.value == 1 and one.estimate.interval() == (-np.inf, np.inf)
    none = difference([np.array([np.nan, 1.0])], [np.array([2.0, np.nan])], 0.1)
    assert none.draws == 0 and none.word is Word.NOTHING
    some = difference([np.array([1.0, 2.0, np.nan])], [np.array([1.5, 2.5, 9.0])], 0.1)
    assert some.draws == 2 and some.estimate.value == 0.5


def test_the_benchmark_draws_comparisons_and_says_of_each_claim_whether_it_is_kept(
    capsys: pytest.CaptureFixture,
) -> None:
    status = main(["bench", "compare", "--trials", "200", "--json"])
    checks = json.loads(capsys.readouterr().out)["checks"]
    assert len(checks) == 8 and status == int(any(check["outcome"] != "pass" for check in checks))
    covered = next(check for check in checks if "hold the difference" in check["name"])
    assert 0.9 < covered["value"] < 0.99
    assert main(["bench", "compare", "--trials", "20"]) == 2 and "--trials" in capsys.readouterr().err
