"""What all stages share: how much they made, and items of work done in several processes."""

from collections.abc import Callable, Iterable
from typing import Any

from testfield.chain.progress import bar
from testfield.chain.run import Run
from testfield.store.work import each

ALONE = 2
"""So many items this process does itself: others take seconds to begin."""
Made = tuple[int, int]
"""How many of a stage's items were made, and how many there are."""


def each_item(run: Run, title: str, function: Callable, work: list, unit: str) -> Iterable[Any]:
    """Results in order, from several processes where there is enough to do."""
    pool = run.pool if len(work) > ALONE and run.jobs > 1 else None
    with bar(title, len(work), unit) as move:
        yield from each(function, work, run.jobs, pool=pool, alone=ALONE, moved=lambda _: move(1))
