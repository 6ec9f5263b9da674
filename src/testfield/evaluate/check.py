"""A figure held against its limit: what certificates, benchmarks, acceptance tests and comparisons conclude."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from testfield.errors import TestfieldError


class Outcome(Enum):
    """What a check says; `OPEN` where its interval lies on both sides of a limit."""

    PASS = "pass"
    FAIL = "fail"
    OPEN = "open"
    NONE_STATED = "none stated"


@dataclass(frozen=True)
class Limit:
    """From `least` to `most`, both allowed, in the unit of the check; infinite where there is none.

    Raises `TestfieldError` where an end is not a number, or nothing lies between.
    """

    least: float = -np.inf
    most: float = np.inf

    def __post_init__(self) -> None:
        if not self.least <= self.most:
            raise TestfieldError(
                f"no value lies between {self.least:g} and {self.most:g}", "Limit", "give the smaller one as `least`"
            )

    def holds(self, value: float) -> bool:
        """Whether a value keeps the limit; one that is not a number does not."""
        return bool(self.least <= value <= self.most)

    def __str__(self) -> str:
        if np.isinf(self.least):
            return "" if np.isinf(self.most) else f"<= {self.most:g}"
        return f">= {self.least:g}" if np.isinf(self.most) else f"{self.least:g} to {self.most:g}"


@dataclass(frozen=True)
class Check:
    """A figure and what is asked of it.

    `name` of the figure, its `value` in `unit` with the `interval` that holds it (None where nobody asked how sure it
    is), the `limit` (None where none is stated), and `how` it was measured, in one sentence.
    """

    name: str
    value: float
    interval: tuple[float, float] | None = None
    limit: Limit | None = None
    unit: str = ""
    how: str = ""

    @property
    def outcome(self) -> Outcome:
        """Without an interval, whether the value keeps the limit. With one, pass where all of it does, fail where none
        of it does, and open between."""
        if self.limit is None:
            return Outcome.NONE_STATED
        if self.interval is None:
            return Outcome.PASS if self.limit.holds(self.value) else Outcome.FAIL
        low, high = self.interval
        if not np.isfinite(self.value) or high < self.limit.least or low > self.limit.most:
            return Outcome.FAIL
        return Outcome.PASS if self.limit.holds(low) and self.limit.holds(high) else Outcome.OPEN

    @property
    def passed(self) -> bool:
        """Whether the outcome is a pass."""
        return self.outcome is Outcome.PASS

    def row(self) -> dict[str, Any]:
        """The check as plain values for JSON; None where there is no number."""
        limit = self.limit or Limit()
        low, high = self.interval or (np.nan, np.nan)
        numbers = {"value": self.value, "low": low, "high": high, "least": limit.least, "most": limit.most}
        plain = {name: float(number) if np.isfinite(number) else None for name, number in numbers.items()}
        return {"name": self.name, **plain, "unit": self.unit, "outcome": self.outcome.value, "how": self.how}

    @staticmethod
    def of_row(row: dict[str, Any]) -> "Check":
        """The check that `row` gave."""
        least, most = row["least"], row["most"]
        limit = Limit(-np.inf if least is None else least, np.inf if most is None else most)
        ends = row["low"], row["high"]
        return Check(
            name=row["name"],
            value=np.nan if row["value"] is None else row["value"],
            interval=None if None in ends else ends,
            limit=None if least is most is None else limit,
            unit=row["unit"],
            how=row["how"],
        )


def all_passed(checks: Iterable[Check]) -> bool:
    """Whether no check with a stated limit failed or is open."""
    return all(check.outcome in (Outcome.PASS, Outcome.NONE_STATED) for check in checks)


def table(checks: Iterable[Check]) -> str:
    """The checks for a person, one a line: outcome, name, value with its interval, limit."""
    rows = [(check.outcome.value, check.name, _value(check), f"{check.limit or 'none'}") for check in checks]
    if not rows:
        return ""
    width = [max(len(row[k]) for row in rows) for k in range(3)]
    return "\n".join(
        f"{outcome:<{width[0]}}  {name:<{width[1]}}  {value:<{width[2]}}  limit {limit}"
        for outcome, name, value, limit in rows
    )


def _value(check: Check) -> str:
    unit = f" {check.unit}" if check.unit else ""
    if check.interval is None:
        return f"{check.value:.4g}{unit}"
    return f"{check.value:.4g} [{check.interval[0]:.4g}, {check.interval[1]:.4g}]{unit}"
