"""A mean that is looked at after every value: its interval holds at all numbers of values at once."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import nct, t

from testfield.errors import TestfieldError
from testfield.evaluate.regress.simulation import simulated
from testfield.statistics.sequential import PRIOR, reach_of, running_mean

LOOKS = range(2, 65)


def _ever_outside(reach: list[float], paths: int = 4000) -> float:
    """How often one of the intervals of normal values about 0 leaves the true mean out, at any number of them."""
    values = np.random.default_rng(1).standard_normal((paths, max(LOOKS)))
    outside = np.zeros(paths, bool)
    for n, half in zip(LOOKS, reach, strict=True):
        part = values[:, :n]
        outside |= np.abs(part.mean(axis=1)) > half * part.std(axis=1, ddof=1)
    return float(outside.mean())


def test_the_interval_holds_at_all_numbers_at_once() -> None:
    assert _ever_outside([reach_of(n, 0.1) for n in LOOKS]) <= 0.1


def test_students_interval_looked_at_after_every_value_does_not() -> None:
    assert _ever_outside([t.ppf(0.95, n - 1) / np.sqrt(n) for n in LOOKS]) > 0.3


@pytest.mark.parametrize("n", [3, 8, 40])
def test_the_interval_ends_where_the_mixture_of_t_densities_says(n: int) -> None:
    """The Bayes factor of t under effects of N(0, 1 / c^2), from the noncentral density, is 1 / error rate there."""
    error_rate = 0.2 if n == 3 else 0.01
    at = reach_of(n, error_rate) * np.sqrt(n)
    spread = 1 / np.sqrt(PRIOR)

    def weighed(effect: float) -> float:
        normal = np.exp(-0.5 * (effect / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
        return float(nct.pdf(at, n - 1, effect * np.sqrt(n)) * normal)

    over = quad(weighed, -8 * spread, 8 * spread, points=[at / np.sqrt(n)], limit=400)[0]
    assert over / t.pdf(at, n - 1) == pytest.approx(1 / error_rate, rel=1e-4)


def test_too_few_values_have_an_interval_without_end_and_identical_ones_none_at_all() -> None:
    assert running_mean(np.array([1.0, 2.0]), 0.01).high == np.inf
    same = running_mean(np.full(8, 0.3), 0.01)
    assert (same.value, same.low, same.high) == (0.3, 0.3, 0.3)


@pytest.mark.parametrize("values, error_rate", [([1.0, np.nan], 0.1), ([1.0, np.inf], 0.1), ([1.0, 2.0], 0.0)])
def test_what_is_no_number_and_no_error_rate_is_refused(values: list[float], error_rate: float) -> None:
    with pytest.raises(TestfieldError):
        running_mean(np.array(values), error_rate)


@pytest.mark.parametrize("shape", ["normal", "heavy tails (Student, 5 degrees)"])
def test_unchanged_checks_raise_no_more_alarms_than_is_stated(shape: str) -> None:
    found = simulated(shape, checks=300, figures=4, error_rate=0.05, budget=27)
    assert found.alarms <= 0.05 * found.checks
