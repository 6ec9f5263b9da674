"""Boards that are less flat than their sheets say: how far their marks stand off their plane, from the residuals.

A variance component of the marks' heights: of all standard deviations s the one of the largest restricted likelihood
(Patterson and Thompson 1971; Foerstner 1979). With N the normal matrix of the adjustment whose marks' heights are known
to 0 +- s, I their prior information and f the degrees of freedom, minus twice the log likelihood is

    f log chi^2 + log |N| - log |I|,   sigma^2 = chi^2 / f,

and the heights' standard deviation s sigma, for all covariances are known but for the factor sigma^2.
"""

from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.bundle import adjust
from testfield.adjust.datum import open_motions
from testfield.adjust.network import Network
from testfield.errors import TestfieldError

FIRST, LAST = 2.0**-20, 2.0**-6
"""Heights that are tried, as parts of the boards' extent: each a factor of 4 above the one before."""
LEAST_IMAGES = 3
"""Images from which the heights of a board's marks can be told."""


@dataclass(frozen=True)
class Unflat:
    """Heights of boards' marks: standard deviation `s_mm`, and the `rise` of twice the log likelihood."""

    s_mm: float
    rise: float


def unflat(network: Network, labels: list[str], freedom: int) -> Unflat | None:
    """How far marks stand off their boards; None where that is not more than is known of them, or cannot be told.

    `network` adjusted, its observations' covariances those of their scatter.
    """
    owned = np.unique(network.point_board[network.seen_points])
    images = np.unique(network.image)
    if not (owned >= 0).any() or len(images) < LEAST_IMAGES or freedom < 1:
        return None
    marks = network.known_mm[network.point_board >= 0]
    extent = float(np.linalg.norm(np.ptp(marks[:, :2], axis=0)))
    sizes = extent * 2.0 ** np.arange(np.log2(FIRST), np.log2(LAST) + 1, 2)
    base = _minus_likelihood(network, labels, freedom)[0]
    rises, variances = [], []
    for s in sizes:
        try:
            value, variance, network = _minus_likelihood(with_heights(network, float(s)), labels, freedom)
        except TestfieldError:  # heights that free cannot be told
            value, variance = np.inf, 1.0
        rises.append(base - value)
        variances.append(variance)
        if len(rises) > 2 and rises[-1] < max(rises) - 20:
            break
    best = int(np.argmax(rises))
    s = _peak(np.log(sizes), np.array(rises), best) * np.sqrt(variances[best])
    return Unflat(float(s), float(rises[best]))


def with_heights(network: Network, s_mm: float) -> Network:
    """The network with boards' marks whose heights are known to `s_mm`, where their sheets know them better."""
    information = network.information.copy()
    on = network.point_board >= 0
    information[on, 2, 2] = np.minimum(information[on, 2, 2], 1 / s_mm**2)
    return replace(network, information=information)


def _minus_likelihood(network: Network, labels: list[str], freedom: int) -> tuple[float, float, Network]:
    """Minus twice the log likelihood, but for a constant, sigma^2, and the network at its minimum."""
    found = adjust(network, labels)
    normal = found.equations.reduced(0.0)[0]
    ways = open_motions(found.network)[0]
    if ways.shape[1]:
        basis = np.linalg.qr(ways)[0]
        normal = normal + np.trace(normal) / len(normal) * basis @ basis.T
    seen = network.seen_points[network.point_board[network.seen_points] >= 0]
    blocks = np.linalg.slogdet(found.equations.point_normal)[1].sum()
    told = network.information[seen, 2, 2]
    prior = np.log(told[told > 0]).sum()  # marks whose places were set free are the same for any height
    value = freedom * np.log(found.chi2) + float(np.linalg.slogdet(normal)[1] + blocks - prior)
    return value, found.chi2 / freedom, found.network


def _peak(x: np.ndarray, y: np.ndarray, best: int) -> float:
    """exp of where the parabola through the best of y (n,) and its neighbours is highest."""
    if not 0 < best < len(y) - 1 or not np.isfinite(y[best - 1 : best + 2]).all():
        return float(np.exp(x[best]))
    a, b, c = y[best - 1 : best + 2]
    shift = 0.5 * (a - c) / (a - 2 * b + c)
    return float(np.exp(x[best] + np.clip(shift, -1, 1) * (x[1] - x[0])))
