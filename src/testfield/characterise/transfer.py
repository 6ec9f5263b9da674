"""Gain, responsivity, saturation and linearity from lit levels and darks (EMVA 1288 release 4.0, sections 6 and 7)."""

from dataclasses import dataclass

import numpy as np

from testfield.characterise.curve import Curve, weights_of_darks
from testfield.characterise.figures import Line, through_origin
from testfield.errors import TestfieldError

GAIN_SHARE, LINEAR_SHARES = 0.7, (0.05, 0.95)
"""Shares of saturation up to which gain is fitted, and between which linearity is judged: the standard's."""
CLEARLY_LESS = 0.9
"""The last level's variance over the largest, below which saturation was passed."""
PLATEAU_SHARE = 0.05
"""A level whose variance is less than this share of the largest is saturated in all its pixels."""


@dataclass(frozen=True)
class Linearity:
    """The line of mean over light between 5 and 95 % of saturation, weighted so that relative deviations count, and
    the relative deviations of all levels from it (NaN outside), in %."""

    slope: float
    offset_dn: float
    deviation_percent: np.ndarray


@dataclass(frozen=True)
class Transfer:
    """The photon transfer of one kind of pixels; arrays (n,) belong to the lit levels."""

    signal_dn: np.ndarray
    excess_dn2: np.ndarray
    u_excess_dn2: np.ndarray
    fitted: np.ndarray
    saturation: int
    saturated: bool
    gain: Line
    response: Line | None
    saturation_dn: float
    u_saturation_dn: float
    plateau_dn: float | None
    u_plateau_dn: float
    linearity: Linearity | None


def transfer_of(lit: Curve, dark: Curve, where: str) -> Transfer:
    """Raises `TestfieldError` where fewer than three levels lie below 70 % of saturation."""
    W = weights_of_darks(lit.time_ms, dark.time_ms)
    signal, excess = lit.mean_dn - W @ dark.mean_dn, lit.var_dn2 - W @ dark.var_dn2
    cov_excess = np.diag(lit.u_var_dn2**2) + W * dark.u_var_dn2**2 @ W.T
    cov_signal = np.diag(lit.u_mean_dn**2) + W * dark.u_mean_dn**2 @ W.T
    place, reached = saturation_place(lit.var_dn2)
    fitted = np.arange(len(lit)) <= np.flatnonzero(signal <= GAIN_SHARE * signal[place]).max(initial=-1)
    fitted &= np.arange(len(lit)) <= place
    if fitted.sum() < 3:
        raise TestfieldError(
            f"{fitted.sum()} lit level(s) below {GAIN_SHARE:.0%} of saturation, and 3 are needed for the gain",
            where,
            "give pairs at more levels of light (the standard asks for 50, equally spaced)",
        )
    part = np.ix_(fitted, fitted)
    gain = through_origin(signal[fitted], excess[fitted], cov_excess[part])
    known = bool(np.isfinite(lit.light).all())
    response = through_origin(lit.light[fitted], signal[fitted], cov_signal[part]) if known else None
    x = lit.light * response.slope if response else signal
    high = x[min(place + 1, len(x) - 1)]
    step = max((high - x[max(place - 1, 0)]) / 2, 1e-12)
    flat = np.flatnonzero(lit.var_dn2 < PLATEAU_SHARE * lit.var_dn2[place])
    flat = flat[flat > place]
    plateau = float(signal[flat].mean()) if len(flat) else None
    u_plateau = float(np.sqrt((cov_signal[np.ix_(flat, flat)]).mean())) if len(flat) else float("nan")
    return Transfer(
        signal,
        excess,
        np.sqrt(np.diag(cov_excess)),
        fitted,
        place,
        reached,
        gain,
        response,
        float(x[place]),
        float(step / np.sqrt(3)),
        plateau,
        u_plateau,
        linearity_of(lit.light, signal, place) if known else None,
    )


def saturation_place(var_dn2: np.ndarray) -> tuple[int, bool]:
    """Number of the level of saturation, and whether saturation was reached.

    It is where temporal variance is largest, sought from the brightest level down, so that one noisy level in the
    middle is none: two levels in a row below the largest so far end the search.
    """
    best = len(var_dn2) - 1
    for k in range(len(var_dn2) - 1, -1, -1):
        if var_dn2[k] >= var_dn2[best]:
            best = k
        elif k and var_dn2[k - 1] < var_dn2[best] and var_dn2[-1] < CLEARLY_LESS * var_dn2[best]:
            break
    return best, bool(best < len(var_dn2) - 1 and var_dn2[-1] < CLEARLY_LESS * var_dn2[best])


def linearity_of(light: np.ndarray, signal_dn: np.ndarray, place: int) -> Linearity | None:
    """None where fewer than three levels lie between 5 and 95 % of saturation.

    Release 4.0 minimises the sum of squares of relative deviations, that is, weighs with 1 / signal.
    """
    low, high = (share * signal_dn[place] for share in LINEAR_SHARES)
    inside = (signal_dn >= low) & (signal_dn <= high) & (np.arange(len(light)) <= place)
    if inside.sum() < 3:
        return None
    offset, slope = np.polynomial.polynomial.polyfit(light[inside], signal_dn[inside], 1, w=1 / signal_dn[inside])
    line = offset + slope * light
    return Linearity(float(slope), float(offset), np.where(inside, 100 * (signal_dn - line) / line, np.nan))
