"""Pools of processes that end with the process that began them, however it ends.

A worker that waits for work never learns that nobody is left to give it any: its queue is a pipe of which all workers
hold both ends. On Linux the kernel ends it with its parent; everywhere a thread watches the parent.
"""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from typing import Any

from testfield.errors import TestfieldError

PR_SET_PDEATHSIG = 1
"""Of Linux' prctl(2): the signal that this process gets when its parent dies."""

SPAWN: BaseContext = multiprocessing.get_context("spawn")
"""Spawned, not forked: the renderer's threads do not survive a fork."""


@contextmanager
def process_pool(
    jobs: int, begin: Callable[..., None] | None = None, arguments: tuple = ()
) -> Iterator[ProcessPoolExecutor]:
    """A pool of `jobs` processes, each of which calls `begin(*arguments)` first.

    Work that has not begun is dropped when the block ends in an exception. Raises `TestfieldError` where a worker was
    ended from outside.
    """
    with _environment():
        pool = ProcessPoolExecutor(jobs, SPAWN, initializer=_begin, initargs=(begin, arguments))
        yield from _until_done(pool)


def _until_done(pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
    try:
        yield pool
    except BaseException as error:
        pool.shutdown(wait=False, cancel_futures=True)
        if isinstance(error, BrokenProcessPool):
            raise TestfieldError(
                "one of this command's processes was ended from outside, perhaps for want of memory",
                "",
                "what is finished is kept; give the same command again, with fewer --jobs",
            ) from error
        raise
    pool.shutdown()


@contextmanager
def _environment() -> Iterator[None]:
    """Workers have one thread each: together they fill the cores, and sums do not depend on the number of threads."""
    wanted = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")}
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _begin(begin: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    end_with_parent()
    # An interrupt is the parent's to handle; workers would only add their own complaints.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if begin is not None:
        begin(*arguments)


def end_with_parent() -> None:
    """End this process, a worker or a command that another one began, when the one that began it does."""
    parent = multiprocessing.parent_process()
    above = os.getppid() if parent is None else parent.pid
    threading.Thread(target=_watch, args=(parent and parent.sentinel, above), daemon=True).start()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != above:
        os._exit(1)  # it died before anybody watched


def _watch(sentinel: int | None, above: int | None) -> None:
    if sentinel is not None:
        wait([sentinel])
    while sentinel is None and os.getppid() == above:
        time.sleep(0.5)
    os._exit(1)
