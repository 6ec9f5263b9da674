"""The one executor: items of work done by this process or by several, results in the order of the items.

Who wants finished work kept has the function write it to a file under its key; then a killed worker or an interrupt
loses only the items at hand. Workers end with the process that began them (`testfield.store.pool`); those of a pool
that is given, like a cluster's, may come and go, and what they lost is given again.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Protocol, TypeVar

from testfield.errors import TestfieldError
from testfield.store.pool import SPAWN, process_pool

LOOK_S = 0.3
"""How often it is asked what a group that still works has finished, and no more often than costs `LOOK_SHARE`."""
LOOK_SHARE = 0.05
"""The part of the time that may be spent on asking."""
TRIES = 3
"""So often a group is given to a pool whose processes die of it without having finished anything more."""
Item = TypeVar("Item")
Result = TypeVar("Result")


class Pool(Protocol):
    """Where work runs: of `concurrent.futures`, and of Dask's client, only this is used.

    A pool may also have `at_once()`, how many groups it is given at a time (all, where it has none), and
    `fetch(futures)`, which is told what will be asked for next; and its futures may raise `Lost`.
    """

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """A future of the function's result, with `done`, `result` and `add_done_callback`."""


class Lost(Exception):
    """A group's results are lost, because its process or the pool has ended; it is to be given again. `blamed` is
    whether processes died at work on it, so that it may be the group itself that ends them."""

    def __init__(self, said: str, blamed: bool = False):
        super().__init__(said, blamed)
        self.said, self.blamed = said, blamed


class Unwanted(Exception):
    """In a process of a pool: nobody waits for the rest of a group."""


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


@dataclass
class _Given:
    """A group that is given to a pool: items by number, how many were finished when it was given, and how often it has
    ended processes since it last got on."""

    part: list[int]
    finished: int = 0
    tries: int = 0


def _elsewhere(
    function: Callable,
    items: Sequence[Any],
    parts: list[list[int]],
    opened: AbstractContextManager[Pool],
    kept: Callable[[int], bool],
) -> Done:
    ready: SimpleQueue[Any] = SimpleQueue()
    waiting, given = deque(_Given(part) for part in parts), dict[Any, _Given]()
    look = 0.0
    with opened as pool:
        at_once = getattr(pool, "at_once", lambda: len(parts))
        fetch = getattr(pool, "fetch", lambda _: None)
        while waiting or given:
            while waiting and len(given) < at_once():
                group = waiting.popleft()
                future = pool.submit(_group, function, [items[k] for k in group.part])
                given[future] = group
                future.add_done_callback(ready.put)
            done = list(_ready(ready))
            fetch(done)
            for future in done:
                group = given.pop(future)
                try:
                    results = future.result()
                except Lost as lost:
                    waiting.appendleft(_again(group, lost, kept))
                else:
                    yield from zip(group.part, results, strict=True)
            if time.monotonic() >= look:
                begun = time.monotonic()
                yield from ((k,) for group in given.values() for k in group.part if kept(k))
                now = time.monotonic()
                look = now + max(LOOK_S, (now - begun) / LOOK_SHARE)


def _ready(ready: SimpleQueue) -> Iterator[Any]:
    """What has been put into a queue, after no more than `LOOK_S`."""
    try:
        yield ready.get(timeout=LOOK_S)
        while True:
            yield ready.get_nowait()
    except Empty:
        return


def _again(group: _Given, lost: Lost, kept: Callable[[int], bool]) -> _Given:
    """A group to be given again. Raises `TestfieldError` where it ends processes and gets no further."""
    finished = sum(kept(k) for k in group.part)
    if finished > group.finished:
        group.finished, group.tries = finished, 0
    group.tries += lost.blamed
    if group.tries >= TRIES:
        raise TestfieldError(
            f"the same work has ended {TRIES} times with its process ({lost.said})",
            "",
            "what is finished is kept; see whether the processes have enough memory, and give the same command again",
        ) from lost
    return group


def _group(function: Callable, items: list[Any]) -> list[Any]:
    """What a process of the pool does."""
    results = []
    for item in items:
        if unwanted():
            raise Unwanted
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


def unwanted() -> bool:
    """In a process of a pool: whether it is to stop after the item at hand."""
    return _stops()


def stop_when(asked: Callable[[], bool]) -> None:
    """Have this process, one of a pool, stop after the item at hand when `asked` says so."""
    global _stops
    _stops = asked


_stops: Callable[[], bool] = bool


def _start(end: Any) -> None:
    stop_when(end.is_set)
    os.environ["TQDM_DISABLE"] = "1"
