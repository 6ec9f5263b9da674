"""The inverse of the Poisson distribution against sums in 60 digits and against SciPy."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from scipy.special import gammainc, gammaincc, ndtr
from scipy.stats import poisson

import testfield.sensor.poisson as room
from testfield.seeds import Plane
from testfield.sensor.poisson import poisson_quantile


def exact_quantiles(mean: float, us: list[float]) -> list[int]:
    """The smallest k with P(N <= k) >= u for ascending `us`, summed in 60 digits from far below."""
    with localcontext() as context:
        context.prec = 60
        rate = Decimal(mean)
        k = int(max(mean - 12 * np.sqrt(mean) - 30, 0))
        logarithm = -rate + k * rate.ln() - sum((Decimal(i).ln() for i in range(2, k + 1)), Decimal(0))
        chance = logarithm.exp()
        total, found = chance, []
        if k:  # what lies below is a geometric series at most, and far less than 2^-53
            total += chance * k / (rate - k)
        for u in us:
            while total < Decimal(u):
                k += 1
                chance = chance * rate / k
                total += chance
            found.append(k)
        return found


def both_tails() -> np.ndarray:
    """Ascending u from 2^-53 to 1 - 2^-53, dense in both tails."""
    small = 2.0 ** -np.arange(53.0, 1.0, -0.37)
    return np.concatenate([small, [0.5], (1 - small)[::-1]])


@pytest.mark.parametrize("mean", [1e-6, 1e-3, 0.1, 0.5, 1.0, 3.3, 4.999, 5.0, 5.001, 7.0, 12.5, 40.0, 333.3, 2000.0])
def test_both_tails_agree_with_sums_in_sixty_digits(mean: float) -> None:
    u = both_tails()
    assert poisson_quantile(u, np.full(len(u), mean)).tolist() == exact_quantiles(mean, u.tolist())


# SciPy takes long where the mean is large.
MANY = [(mean, 200_000) for mean in (0.02, 1.0, 4.9, 5.1, 9.0, 60.0, 6000.0)] + [(1e5, 50_000), (1e6, 25_000)]
ALL = [pytest.param(mean, 200_000, marks=pytest.mark.slow) for mean in (1e5, 1e6)]


@pytest.mark.parametrize(("mean", "numbers"), MANY + ALL)
def test_counts_of_many_numbers_are_those_of_scipy(mean: float, numbers: int) -> None:
    u = Plane(1, "quantiles").uniforms(range(1), numbers)[0]
    ours, theirs = poisson_quantile(u, np.full(len(u), mean)), poisson.ppf(u, mean)
    for k in np.flatnonzero(ours != theirs):  # SciPy's own distribution must call such a number a tie
        assert abs(poisson.cdf(min(ours[k], theirs[k]), mean) - u[k]) < 1e-13


def test_at_the_steps_of_the_distribution_the_count_changes() -> None:
    """A little below P(N <= k) the count is k at most, a little above it is k + 1 at least."""
    mean = np.geomspace(1e-3, 1e6, 400)
    for w in (-7, -3, -1, 0, 1, 3, 7):
        k = np.maximum(np.rint(mean + w * np.sqrt(mean)), 0)
        level, rest = gammaincc(k + 1, mean), gammainc(k + 1, mean)
        small = (level < 0.5) & (level > 1e-14)
        near = 1e-9 * level
        assert (poisson_quantile(level - near, mean) <= k)[small].all()
        assert (poisson_quantile(level + near, mean) >= k + 1)[small].all()
        high = (level >= 0.5) & (rest > 1e-6)
        assert (poisson_quantile(1 - rest * (1 + 1e-9), mean) <= k)[high].all()
        assert (poisson_quantile(1 - rest * (1 - 1e-9), mean) >= k + 1)[high].all()


def test_a_larger_mean_never_gives_a_smaller_count() -> None:
    u = Plane(2, "monotone").uniforms(range(1), 400)
    fine = np.concatenate([np.linspace(0, 12, 1201), np.geomspace(12, 1e6, 1200), 6000 * (1 + 1e-7 * np.arange(300))])
    fine = np.sort(fine)[:, None]
    counts = poisson_quantile(np.broadcast_to(u, (len(fine), 400)), np.broadcast_to(fine, (len(fine), 400)))
    assert (np.diff(counts, axis=0) >= 0).all()
    assert (counts[0] == 0).all()


def continuous(mean: float, w: np.ndarray) -> np.ndarray:
    """The x of Q(x, mean) = P(Z <= w), by bisection."""
    low, high = np.zeros(len(w)), np.full(len(w), mean + 20 * np.sqrt(mean) + 50)
    for _ in range(200):
        middle = (low + high) / 2
        below = np.where(w < 0, gammaincc(middle, mean) < ndtr(w), gammainc(middle, mean) > ndtr(-w))
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return low


def test_the_expansion_errs_less_than_its_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    w = np.linspace(-8.2, 8.2, 165)
    searched: list[int] = []
    monkeypatch.setattr(room, "_searched", lambda count, u, mean: searched.append(len(count)) or count)
    for mean in (5.0, 5.7, 7.0, 11.0, 30.0, 1e3, 1e5):
        x = continuous(mean, w)
        means = np.full(len(w), mean)
        error = room._error(w * w, means, 1 / np.sqrt(means))
        expanded = (
            mean
            + w * np.sqrt(mean)
            + (2 + w**2) / 6
            - w * (2 + w**2) / (72 * np.sqrt(mean))
            + (w**4 / 270 + 7 * w**2 / 810 - 8 / 405) / mean
        )
        assert (np.abs(expanded - x) < error).all()
        sure = np.floor(x - 2 * error) == np.floor(x + 2 * error)
        assert np.array_equal(room._expanded(ndtr(w), means)[sure & (w < 5)], np.floor(x)[sure & (w < 5)])
