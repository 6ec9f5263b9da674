"""The inverse of the Poisson distribution: one uniform number gives one count, whatever the mean.

After Giles, Algorithm 955: approximation of the inverse Poisson cumulative distribution function, ACM TOMS 42(1),
2016. With P(N <= k) = Q(k + 1, mean), Q the regularised upper incomplete gamma function, the continuous x of
Q(x, mean) = u has the quantile as its whole part. An expansion of x for large means settles all counts but those of
which x comes closer to a whole number than the expansion may err; these are settled by Q itself. Small means are summed
from zero.
"""

import numpy as np
from scipy.special import gammainc, gammaincc, ndtri

SUMMED_BELOW = 5.0
"""Means below this are summed from zero; above, the expansion is good."""
SUMMED_TO = 0.999
"""Sums from zero lose digits of 1 - u beyond this; the upper tail has its own function."""
FEW = 8
"""Sums go on with those alone that are not done, once these are one in so many: to gather them takes time too."""
WHOLE_BELOW = 1e12
"""Above this mean, digits of the count are lost in rounding anyway."""


def poisson_quantile(u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """The smallest counts k with P(N <= k) >= u, as whole floats, for `u` in (0, 1) and `mean` >= 0 of one shape.

    Correct in both tails, to the rounding of the distribution itself: u is compared with P(N <= k) below the
    median, 1 - u with P(N > k) above it. A larger mean never gives a smaller count.
    """
    shape, u, mean = np.shape(mean), np.ravel(u), np.ravel(mean)
    small = mean < SUMMED_BELOW
    few = np.count_nonzero(small)
    if few == len(small):
        return _summed(u, mean).reshape(shape)
    if few == 0:
        return _expanded(u, mean).reshape(shape)
    count = np.empty(len(mean))
    for where, settle in ((np.flatnonzero(small), _summed), (np.flatnonzero(~small), _expanded)):
        count[where] = settle(u[where], mean[where])
    return count.reshape(shape)


def _expanded(u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    w = ndtri(u)
    w2 = w * w
    root = np.sqrt(mean)
    small = 1 / root
    # Giles' section 2.2: x = mean + w root + (2 + w^2) / 6 - w (2 + w^2) / (72 root)
    #                         + (w^4 / 270 + 7 w^2 / 810 - 8 / 405) / mean
    x = w2 * (1 / 270)
    x += 7 / 810
    x *= w2
    x -= 8 / 405
    x *= small
    two = w2 + 2
    two *= 1 / 6
    x -= w * two * (1 / 12)
    x *= small
    x += two
    x += w * root
    x += mean
    error = _error(w2, mean, small)
    count = np.floor(x)
    x -= count
    near = np.flatnonzero((x < error) | (x + error > 1))
    near = near[mean[near] < WHOLE_BELOW]
    count[near] = _searched(count[near], u[near], mean[near])
    return count


def _error(w2: np.ndarray, mean: np.ndarray, small: np.ndarray) -> np.ndarray:
    """What the expansion may err by, and rounding; `small` is 1 / sqrt(mean).

    1.4 times its largest error over means from 5 and all w of `uniforms`, which `tests/test_poisson.py` measures.
    """
    error = w2 * w2
    error *= w2
    error *= 0.0014
    error += 0.04
    error *= small * small * small  # a power would take longer than all the rest
    error += 1e-15 * mean
    return np.asarray(error)


def _summed(u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    count, level = np.zeros(len(mean)), np.minimum(u, SUMMED_TO)
    at: np.ndarray = np.arange(len(mean))
    own: np.ndarray = np.zeros(len(mean), np.uint8)
    chance, k = np.exp(-mean), 0
    rate, total = mean, chance.copy()
    while True:
        more = level > total
        left = np.count_nonzero(more)
        own += more.view(np.uint8)
        if left == 0:
            break
        if FEW * left < len(at):
            count[at] = own
            some = np.flatnonzero(more)
            at, own, level, rate, chance, total = (v[some] for v in (at, own, level, rate, chance, total))
        k += 1
        chance *= rate
        chance *= 1 / k
        total += chance
    count[at] = own
    far = np.flatnonzero(u > SUMMED_TO)
    count[far] = _searched(count[far], u[far], mean[far])
    return count


def _searched(count: np.ndarray, u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """The quantile, by steps of one from a count nearby."""
    count = np.maximum(count, 0)
    up = _below(count, u, mean)
    for step, side in ((1, np.flatnonzero(up)), (-1, np.flatnonzero(~up & (count > 0)))):
        while len(side):
            # Upwards while the count is too small; downwards while the next smaller one is not.
            if step > 0:
                count[side] += 1
                side = side[_below(count[side], u[side], mean[side])]
            else:
                side = side[~_below(count[side] - 1, u[side], mean[side])]
                count[side] -= 1
                side = side[count[side] > 0]
    return count


def _below(count: np.ndarray, u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Whether P(N <= count) < u, told by the smaller of both tails."""
    upper = u > 0.5
    below = np.empty(len(u), bool)
    low, high = np.flatnonzero(~upper), np.flatnonzero(upper)
    below[low] = gammaincc(count[low] + 1, mean[low]) < u[low]
    below[high] = gammainc(count[high] + 1, mean[high]) > 1 - u[high]
    return below
