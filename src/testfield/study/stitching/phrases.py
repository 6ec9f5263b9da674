"""How the study on stitched boards says a figure, and what a comparison of intervals lets it say."""

import re
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from testfield.study.stitching.intervals import LEAST_WORLDS

BEYOND = 1e4
TELLING_WORLDS = 4
"""That ranges of fewer worlds each do not overlap happens by chance more than once in twenty times."""


class MissingFigure(Exception):
    """What is to be said needs a figure that no finished case gives."""


class Known:
    """Figures by name; `f[name]` raises `MissingFigure` where there is none."""

    def __init__(self, figures: dict[str, Any]):
        self.figures = figures

    def __getitem__(self, name: str) -> Any:
        value = self.figures.get(name)
        if value is None or value != value:
            raise MissingFigure(name)
        return value


Said = Callable[[Known], str]


def said(figures: dict[str, Any], parts: Iterable[Said]) -> list[str]:
    """What the parts say, without those whose figures are missing."""
    known, found = Known(figures), []
    for part in parts:
        try:
            text = part(known)
        except MissingFigure:
            continue
        if text and not re.search(r"\b(nan|inf)\b", text):
            found.append(text)
    return found


def order(f: Known, one: str, other: str) -> int:
    """-1 where the interval of one figure lies below the other's, 1 where above, 0 where they cannot be told apart."""
    if min(f[f"{one}_worlds"], f[f"{other}_worlds"]) < TELLING_WORLDS:
        return 0
    return apart(*(f[f"{name}_{end}"] for name in (one, other) for end in ("low", "high")))


def apart(low: float, high: float, other_low: float, other_high: float) -> int:
    """-1 where an interval lies below another, 1 where above, 0 where they have a part in common."""
    return -1 if high < other_low else int(low > other_high)


def about(f: Known, name: str, value: float) -> int:
    """-1 where a figure's interval lies below a value, 1 where above, 0 where the value is in it."""
    return apart(f[f"{name}_low"], f[f"{name}_high"], value, value)


def pick(order: int, less: str, unclear: str, more: str) -> str:
    """One of three texts by what a comparison gave."""
    return {-1: less, 0: unclear, 1: more}[order]


def px(f: Known, name: str) -> str:
    """A corner error with its interval."""
    value, *ends = (f[f"{name}_corner_px{end}"] for end in ("", "_low", "_high"))
    if value > BEYOND:
        return "beyond all measure"
    digits = 4 if value < 0.1 else 2
    return f"{value:.{digits}f} px [{', '.join(_number(v, digits) for v in ends)}]"


def mm(f: Known, name: str, digits: int = 4) -> str:
    """A length with its interval."""
    value, *ends = (f[f"{name}{end}"] for end in ("", "_low", "_high"))
    if value > BEYOND:
        return "beyond all measure"
    return f"{value:.{digits}f} mm [{', '.join(_number(v, digits) for v in ends)}]"


def um(f: Known, name: str) -> str:
    """An rms in a chain with its interval."""
    rms, low, high = (1e3 * f[f"{name}_{end}_mm"] for end in ("rms", "low", "high"))
    return f"{rms:.0f} µm [{low:.0f}, {high:.0f}]"


def ratio(f: Known, name: str, digits: int = 1) -> str:
    """A ratio with its interval, or without where the worlds are too few for one."""
    value, *ends = (f[f"{name}{end}"] for end in ("", "_low", "_high"))
    if not np.isfinite(ends).all():
        return f"{value:.{digits}f}"
    return f"{value:.{digits}f} [{ends[0]:.{digits}f}, {ends[1]:.{digits}f}]"


def rendered(f: Known, name: str) -> str:
    """A corner error on rendered images with its number of worlds and their range."""
    value, low, high, worlds = (f[f"{name}_corner_px{end}"] for end in ("", "_low", "_high", "_worlds"))
    if value > BEYOND:
        return f"beyond all measure ({_worlds(worlds)})"
    digits = 4 if value < 0.1 else 2
    if worlds == 1:
        return f"{value:.{digits}f} px (1 world)"
    what = "range" if worlds < LEAST_WORLDS else "95 % interval"
    return f"{value:.{digits}f} px ({_worlds(worlds)}, {what} {_number(low, digits)} to {_number(high, digits)})"


def both_kinds(f: Known, name: str) -> str:
    """A rendered corner error, and where it lies beside the interval of the drawn median of the same field; of a single
    world it may well lie outside that, so the range of the drawn worlds is told then."""
    value, drawn = f[f"rendered_{name}_corner_px"], f"rendered_{name}_drawn"
    low, high, worlds = (f[f"{drawn}_corner_px_{end}"] for end in ("low", "high", "worlds"))
    least, largest = f[f"{drawn}_least_px"], f[f"{drawn}_largest_px"]
    where = f"inside the interval {_ends(low, high)} of drawn pixels"
    if not low <= value <= high:
        side = "below" if value < low else "above"
        among = "within" if least <= value <= largest else "outside"
        where = (
            f"{side} the interval {_ends(low, high)} of the drawn median, {among} the range {_ends(least, largest)} of "
            f"{worlds:.0f} drawn worlds"
        )
    return f"{rendered(f, f'rendered_{name}')}, {where}"


def _worlds(worlds: float) -> str:
    return "1 world" if worlds == 1 else f"{worlds:.0f} worlds"


def _ends(low: float, high: float) -> str:
    return f"[{_number(low, 4)}, {_number(high, 4)}]"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if value < BEYOND else "beyond all"
