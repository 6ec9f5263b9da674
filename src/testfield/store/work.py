"""The one executor: items of work done by this process or by several, results in the order of the items.

Who wants finished work kept has the function write it to a file under its key; then a killed worker or an interrupt
loses only the items at hand. Workers end with the process that began them (`testfield.store.pool`).
"""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from multiprocessing.synchronize import Event
from threading import Event as Signal
from typing import Any, Protocol, TypeVar

from testfield.store.pool import SPAWN, process_pool

LOOK_S = 0.3
"""How often it is asked what a group that still works has finished."""
Item = TypeVar("Item")
Result = TypeVar("Result")


class Pool(Protocol):
    """Where work runs: of `concurrent.futures`, and of Dask's client, only this is used."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """A future of the function's result, with `done`, `result` and `add_done_callback`."""


def each(function: Callable[[Item], Result], items: Sequence[Item], jobs: int = 1, **how: Any) -> Iterator[Result]:
    """The function's result for each item, in the order of the items, however they are done: `as_done`, sorted."""
    results: dict[int, Result] = {}
    following = 0
    for k, result in as_done(function, items, jobs, **how):
        results[k] = result
        while following in results:
            yield results.pop(following)
            following += 1


def as_done(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    jobs: int = 1,
    *,
    pool: Pool | None = None,
    groups: Sequence[Sequence[int]] | None = None,
    kept: Callable[[int], bool] = lambda _: False,
    moved: Callable[[int], None] = lambda _: None,
    alone: int = 1,
) -> Iterator[tuple[int, Result]]:
    """Each item's number with the function's result, as they are done.

    `jobs` processes of this machine do them, or a `pool` if one is given; this process does them itself where jobs is
    1 or there are no more than `alone` groups, for a pool takes seconds to begin. `groups` are items by number that one
    process does one after another (default: each alone). `moved` hears an item's number as soon as it is done; of a
    group that still works, where `kept` says that the item's result is kept already.

    An error of an item ends the work: what has not begun is dropped, and workers stop after the items at hand. So does
    an interrupt. Raises `TestfieldError` where a worker was ended from outside.
    """
    parts = [[k] for k in range(len(items))] if groups is None else [list(part) for part in groups if len(part)]
    if pool is None and (jobs <= 1 or len(parts) <= alone):
        done = _here(function, items, parts)
    else:
        done = _elsewhere(function, items, parts, nullcontext(pool) if pool else local_pool(jobs), kept)
    told: set[int] = set()
    for k, *result in done:
        if k not in told:
            moved(k)
            told.add(k)
        if result:
            yield k, result[0]


Done = Iterator[tuple[int] | tuple[int, Any]]
"""Items by number as they are done: alone where only that is known, with the result once it is here."""


def _here(function: Callable, items: Sequence[Any], parts: list[list[int]]) -> Done:
    for k in (k for part in parts for k in part):
        yield k, function(items[k])


def _elsewhere(
    function: Callable,
    items: Sequence[Any],
    parts: list[list[int]],
    opened: AbstractContextManager[Pool],
    kept: Callable[[int], bool],
) -> Done:
    awake = Signal()
    with opened as pool:
        left = {pool.submit(_group, function, [items[k] for k in part]): part for part in parts}
        for future in left:
            future.add_done_callback(lambda _: awake.set())
        while left:
            awake.wait(LOOK_S)
            awake.clear()
            for future in list(left):
                if future.done():
                    yield from zip(left.pop(future), future.result(), strict=True)
                else:
                    yield from ((k,) for k in left[future] if kept(k))


def _group(function: Callable, items: list[Any]) -> list[Any]:
    """What a process of the pool does."""
    results = []
    for item in items:
        if _end is not None and _end.is_set():
            sys.exit()  # nobody waits for the rest
        results.append(function(item))
    return results


@contextmanager
def local_pool(jobs: int) -> Iterator[Pool]:
    """Processes on this machine, one thread each; an interrupt is the parent's to handle: they finish their items."""
    end = SPAWN.Event()
    with process_pool(jobs, _start, (end,)) as pool:
        try:
            yield pool
        except BaseException:
            end.set()
            raise


_end: Event | None = None
"""In a process of the pool: set when it is to stop after the item at hand."""


def _start(end: Event) -> None:
    global _end
    _end = end
    os.environ["TQDM_DISABLE"] = "1"
