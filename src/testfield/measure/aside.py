"""Time that this project spends on its own account while it measures with somebody else's program."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

_spent = {"time": 0.0, "cpu": 0.0}


def clocks() -> dict[str, float]:
    """Seconds: `time` that has passed, and `cpu` that this process has worked, and the programs that it began and that
    have ended; other work beside lengthens that far less."""
    programs = os.times()
    worked = time.process_time() + programs.children_user + programs.children_system
    return {"time": time.perf_counter(), "cpu": worked}


@contextmanager
def aside() -> Iterator[None]:
    """What happens within is no work of the algorithm that is measured with."""
    begun = clocks()
    try:
        yield
    finally:
        for clock, now in clocks().items():
            _spent[clock] += now - begun[clock]


def spent() -> dict[str, float]:
    """Seconds that were spent so since somebody last asked, by clock."""
    found = dict(_spent)
    _spent.update(dict.fromkeys(_spent, 0.0))
    return found
