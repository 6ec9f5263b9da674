"""Work in threads where it is large enough to pay for them; results come in order, so sums are the same bytes."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

THREADS = min(os.cpu_count() or 1, 8)
WORTH = 20_000_000
"""Multiplications from which threads save more than they cost."""
Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(work: Callable[[Item], Result], items: Sequence[Item], multiplications: int) -> Iterator[Result]:
    """The results of `work` on each item, which takes about so many `multiplications` in all."""
    if multiplications < WORTH or THREADS == 1 or len(items) < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(THREADS) as pool:  # NumPy lets go of the interpreter
        yield from pool.map(work, items)
