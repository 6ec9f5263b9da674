"""A pool over a scheduler of Dask: groups of work go out a few at a time, and what is lost is given again.

Dask's scheduler keeps nothing: when it ends, so do all futures. So results stand in files, tasks return next to
nothing, and this pool only says `Lost` of what it lost. When the scheduler is back, the work goes on.
"""

import os
import time
import uuid
from asyncio import CancelledError as Cancelled
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any, TypeVar

from testfield.cluster.at_work import do, ready
from testfield.cluster.extra import needed
from testfield.cluster.program import program
from testfield.errors import TestfieldError
from testfield.registry import LOADED
from testfield.store.objects import Objects
from testfield.store.work import Lost

T = TypeVar("T")

AHEAD = 2
"""Groups given at a time for each process: one at work and one that waits, so the scheduler never holds more."""
COUNT_S = 5.0
"""How often it is asked how many processes there are."""
GONE = (OSError, TimeoutError, CancelledError, Cancelled)
"""What Dask raises where the scheduler has gone."""
CONNECT_S = 5.0
"""How long one attempt to reach a scheduler may take."""


class DaskPool:
    """Processes of a cluster, through a client of `distributed`.

    `connect` gives a new client, `store` is where results stand (None: in the folder of who asks, which all machines
    see), `patience_s` how long a scheduler or all workers may be away.
    """

    def __init__(self, connect: Callable[[], Any], store: Objects | None, patience_s: float, name: str):
        self.store, self.patience_s, self.name = store, patience_s, name
        self._connect = connect
        self._client: Any = None
        self._counted, self._count = -COUNT_S, 0
        self._loaded = tuple(file for file in os.environ.get(LOADED, "").split(os.pathsep) if file)
        self._number = 0
        self._reached = False
        """Whether the scheduler has ever answered: one that never did is most often another host or port."""

    @property
    def client(self) -> Any:
        """A client that is connected. Raises `TestfieldError` where the scheduler stays away."""
        until = time.monotonic() + (self.patience_s if self._reached else 0)
        while self._client is None or self._client.status != "running":
            if self._client is not None and self._client.status == "connecting" and time.monotonic() < until:
                time.sleep(0.1)
                continue
            self.close()
            try:
                self._client = self._connect()
            except (OSError, TimeoutError) as error:
                if time.monotonic() >= until:
                    raise TestfieldError(
                        "no scheduler answers there",
                        self.name,
                        "start one with `dask scheduler`, or check host and port; what is finished is kept",
                    ) from error
                time.sleep(0.5)
        self._reached = True
        return self._client

    def processes(self) -> int:
        """Processes that are there now, at least one."""
        now = time.monotonic()
        if now - self._counted >= COUNT_S:
            with suppress(*GONE):  # who submits will see
                self._count, self._counted = sum(self.client.nthreads().values()), now
        return max(self._count, 1)

    def counted_again(self) -> None:
        """Ask anew how many processes there are."""
        self._counted = -COUNT_S

    def at_once(self) -> int:
        """Groups that it is given at a time."""
        return AHEAD * self.processes()

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "_Future":
        """A future of the function's result, whose errors are `Lost` where the result is lost."""
        self._number += 1
        key = f"testfield-{self._number}-{uuid.uuid4().hex}"
        task = (do, dict(program()), self._loaded, function, *arguments)
        return self._asked(lambda client: _Future(client.submit(*task, key=key, pure=False)))

    def _asked(self, ask: Callable[[Any], T]) -> T:
        """What a scheduler answers, asked again where it goes meanwhile. Raises `TestfieldError` where it stays away,
        or is there and does not answer."""
        until = time.monotonic() + self.patience_s
        while True:
            client = self.client
            try:
                return ask(client)
            except (*GONE, ValueError) as error:  # a client that was closed meanwhile says ValueError
                if isinstance(error, ValueError) and client.status == "running":
                    raise
                if time.monotonic() >= until:
                    raise TestfieldError(
                        f"the scheduler does not answer ({error})", self.name, "what is finished is kept; try again"
                    ) from error
                time.sleep(0.2)

    def fetch(self, futures: Sequence["_Future"]) -> None:
        """Fetch results of all these at once: each alone would be a journey to another worker."""
        good = [one for one in futures if one.of.status == "finished"]
        if len(good) < 2:
            return
        with suppress(Exception):  # each is asked by itself then, and says what is wrong
            for one, result in zip(good, self.client.gather([one.of for one in good]), strict=True):
                one.fetched = (result,)

    def check(self, place: Objects) -> None:
        """Wait for a worker, and see that all have this program and write into the place where results stand.

        Raises `TestfieldError` where none comes, or one cannot.
        """
        self.wait()
        token = f".seen-{uuid.uuid4().hex}"
        place.write(token, b"")
        try:
            found = self._asked(lambda client: client.run(ready, dict(program()), place, token, on_error="return"))
        finally:
            place.remove(token)
        for address, said in found.items():
            if isinstance(said, OSError):
                continue  # it has gone; who comes in its place is asked with its first group
            if isinstance(said, ModuleNotFoundError):
                said = TestfieldError(f"it has no package '{said.name}'", f"worker {address}", "install it there")
            if isinstance(said, BaseException):
                raise said

    def wait(self) -> None:
        """Wait until there is a worker. Raises `TestfieldError` where there is none for as long as patience lasts."""
        until = time.monotonic() + self.patience_s
        while not self._asked(lambda client: client.nthreads()):
            if time.monotonic() >= until:
                raise TestfieldError(
                    "the scheduler has no workers", self.name, f"start one with `testfield worker {self.name}`"
                )
            time.sleep(0.2)

    @property
    def dashboard(self) -> str:
        """The address of the dashboard, empty where the scheduler has none."""
        info = self._asked(lambda client: client.scheduler_info(n_workers=0))
        return str(self.client.dashboard_link) if "dashboard" in info["services"] else ""

    def close(self) -> None:
        """Drop what has not begun; workers stop after the cases at hand."""
        client, self._client = self._client, None
        if client is not None:
            client.close(timeout=2)


class _Future:
    """A future of Dask that says `Lost` where there will be no result."""

    def __init__(self, of: Any):
        self.of = of
        self.fetched: tuple[Any] | None = None

    def done(self) -> bool:
        return bool(self.of.done())

    def add_done_callback(self, call: Callable[["_Future"], None]) -> None:
        self.of.add_done_callback(lambda _: call(self))

    def result(self) -> Any:
        """The result. Raises `Lost`, or what the function raised."""
        if self.fetched:
            return self.fetched[0]
        killed = needed("distributed").scheduler.KilledWorker
        try:
            return self.of.result(timeout=60)
        except killed as error:
            raise Lost("workers were ended from outside, perhaps for want of memory", blamed=True) from error
        except GONE as error:
            raise Lost("the scheduler has gone") from error
