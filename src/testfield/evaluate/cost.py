"""What a table of cases will cost, said before it begins."""

import math
from collections.abc import Sequence

from testfield.chain.progress import say, spoken_s
from testfield.evaluate.case import Case
from testfield.evaluate.kept_rows import Found


def expected_s(cases: Sequence[Case], found: Sequence[Found | None], processes: int) -> float:
    """The time (s) that those cases will take which are not `found`, from what the others took for their weight; not a
    number where none tells."""
    known = [(f.seconds, case.weight) for case, f in zip(cases, found, strict=True) if f and math.isfinite(f.seconds)]
    weight = sum(weight for _, weight in known)
    if not weight:
        return math.nan
    left = sum(case.weight for case, f in zip(cases, found, strict=True) if f is None)
    return sum(seconds for seconds, _ in known) / weight * left / max(processes, 1)


def say_cost(title: str, cases: Sequence[Case], found: Sequence[Found | None], processes: int) -> None:
    """One line on standard error: how many cases, how many of them finished, and how long the rest will take."""
    todo = sum(f is None for f in found)
    seconds = expected_s(cases, found, processes)
    time = "the time is known once a case is done" if math.isnan(seconds) else f"about {spoken_s(seconds)}"
    by = f"{processes} processes" if processes > 1 else "one process"
    say(title, f"{len(cases)} cases, {len(cases) - todo} finished; {todo} to do by {by}, {time}")
