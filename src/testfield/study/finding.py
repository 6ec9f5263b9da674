"""What a study finds: a question, the quantities that answer it, and the rule by which they do."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from testfield.statistics.decide import Side, side_of, side_of_interval


class Outcome(StrEnum):
    """What a rule says of its quantities."""

    HOLDS = "holds"
    FAILS = "fails"
    OPEN = "open"


@dataclass(frozen=True)
class Quantity:
    """A value in `unit` with the interval from `low` to `high`; NaN where there is none.

    A value that is infinite was beyond all measure: in more than half of the worlds nothing was determined.
    """

    value: float
    low: float = np.nan
    high: float = np.nan
    unit: str = ""

    @property
    def known(self) -> bool:
        """Whether it was measured."""
        return not np.isnan(self.value)

    @property
    def ends(self) -> tuple[float, float]:
        """The interval; the value itself where it has none."""
        return (self.value, self.value) if np.isnan(self.low) or np.isnan(self.high) else (self.low, self.high)

    @property
    def shown(self) -> str:
        """The value with its unit."""
        return f"{number(self.value)} {self.unit}".strip() if self.known else "–"

    @property
    def interval(self) -> str:
        """The interval, empty where it says nothing."""
        return self._between("")

    def _between(self, form: str) -> str:
        if np.isnan(self.low) or np.isnan(self.high) or np.isinf([self.low, self.high]).all():
            return ""
        return f"{number(self.low, form)} to {number(self.high, form)}"

    def __format__(self, form: str) -> str:
        unit = f" {self.unit}" if self.unit and np.isfinite(self.value) else ""
        between = self._between(form)
        return f"{number(self.value, form)}{unit}{f' [{between}]' if between else ''}"


def number(value: float, form: str = "") -> str:
    """A number by its format, by default with three significant digits; in words where nothing was determined."""
    if not np.isfinite(value):
        return "–" if np.isnan(value) else "beyond all measure" if value > 0 else "below all measure"
    if form:
        return format(value, form).replace("%", " %")
    if value == 0 or (abs(value) < 1e6 and float(value).is_integer()):
        return f"{value:.0f}"
    scientific = f"{value:.2e}"
    digits = 2 - int(scientific.partition("e")[2])
    return scientific if digits > 7 or digits < -3 else f"{float(scientific):.{max(digits, 0)}f}"


Quantities = Mapping[str, Quantity]


@dataclass(frozen=True)
class Rule:
    """When a finding `holds` and when it `fails`, in `words` and as a function; where a quantity that it `needs` is
    missing it is open."""

    words: str
    needs: tuple[str, ...]
    decide: Callable[[Quantities], Outcome]

    def outcome(self, quantities: Quantities) -> Outcome:
        """What the rule says."""
        return self.decide(quantities) if self.can_tell(quantities) else Outcome.OPEN

    def can_tell(self, quantities: Quantities) -> bool:
        """Whether all that it needs was measured."""
        return all(name in quantities and quantities[name].known for name in self.needs)


@dataclass(frozen=True)
class Finding:
    """A question with its quantities by name (none where nothing of it is measured yet) and the rule that answers it.
    `name` is what a conclusion calls it."""

    name: str
    question: str
    quantities: dict[str, Quantity]
    rule: Rule

    @property
    def outcome(self) -> Outcome:
        """Whether it holds, fails or is open."""
        return self.rule.outcome(self.quantities)

    @property
    def measured(self) -> bool:
        """Whether an open outcome is the quantities' and not for want of them."""
        return self.rule.can_tell(self.quantities)

    def row(self) -> dict[str, Any]:
        """The finding as plain values."""
        quantities = {
            name: {"value": q.value, "low": q.low, "high": q.high, "unit": q.unit}
            for name, q in self.quantities.items()
        }
        return {
            "name": self.name,
            "question": self.question,
            "outcome": str(self.outcome),
            "measured": self.measured,
            "rule": self.rule.words,
            "quantities": quantities,
        }


def above(name: str, limit: float, *, least: float = 0.0, enough: tuple[str, float] | None = None) -> Rule:
    """Holds where the whole interval lies above the limit, and the value by more than `least`; fails where it lies
    below it in the same manner. With `enough`, a quantity and its least value, it is open below that."""
    return _side(name, limit, Side.ABOVE, least, enough)


def below(name: str, limit: float, *, least: float = 0.0, enough: tuple[str, float] | None = None) -> Rule:
    """Holds where the whole interval lies below the limit, fails where it lies above it; else as `above`."""
    return _side(name, limit, Side.BELOW, least, enough)


def _side(name: str, limit: float, holds: Side, least: float, enough: tuple[str, float] | None) -> Rule:
    def decide(quantities: Quantities) -> Outcome:
        low, high = quantities[name].ends
        if enough is not None and not quantities[enough[0]].value >= enough[1]:
            return Outcome.OPEN
        return by_side(side_of(low, high, limit, value=quantities[name].value, least=least), holds)

    by_more = f" by more than {least:g}" if least else ""
    told = f", of {plain(enough[0])} of {enough[1]:g} or more" if enough else ""
    words = f"{plain(name)} with its whole interval {holds.value} {limit:g}{by_more}{told}; fails on the other side"
    return Rule(words, (name, *([enough[0]] if enough else [])), decide)


def within(name: str, low: float, high: float, words: str = "") -> Rule:
    """Holds where the whole interval lies from `low` to `high`, fails where all of it lies outside."""

    def decide(quantities: Quantities) -> Outcome:
        return inside(quantities[name].ends, low, high)

    return Rule(words or f"{plain(name)} with its whole interval from {low:g} to {high:g}", (name,), decide)


def less(one: str, other: str, *, enough: tuple[str, float] | None = None) -> Rule:
    """Holds where the interval of `one` lies below that of `other`, fails where it lies above; with `enough` it is open
    where either side's `worlds` (a quantity) are fewer."""

    def decide(quantities: Quantities) -> Outcome:
        if enough is not None and not quantities[enough[0]].value >= enough[1]:
            return Outcome.OPEN
        return by_side(side_of_interval(*quantities[one].ends, *quantities[other].ends), Side.BELOW)

    told = f", of {plain(enough[0])} of {enough[1]:g} or more" if enough else ""
    words = f"the interval of {plain(one)} lies below that of {plain(other)}{told}; fails where above"
    return Rule(words, (one, other, *([enough[0]] if enough else [])), decide)


def by_side(side: Side, holds: Side) -> Outcome:
    """What a side means where one of them is what holds and the other what fails."""
    fails = Side.BELOW if holds is Side.ABOVE else Side.ABOVE
    return Outcome.HOLDS if side is holds else Outcome.FAILS if side is fails else Outcome.OPEN


def inside(ends: tuple[float, float], low: float, high: float) -> Outcome:
    """Whether an interval lies within another, outside it, or neither."""
    if low <= ends[0] and ends[1] <= high:
        return Outcome.HOLDS
    return Outcome.FAILS if ends[1] < low or ends[0] > high else Outcome.OPEN


def plain(name: str) -> str:
    """A quantity's name for a person."""
    return name.replace("_", " ")


def verdict_of(outcomes: list[Outcome]) -> Outcome:
    """What a claim is worth that rests on several findings: it fails with any of them and is open with any of them."""
    for worst in (Outcome.FAILS, Outcome.OPEN):
        if worst in outcomes:
            return worst
    return Outcome.HOLDS if outcomes else Outcome.OPEN
