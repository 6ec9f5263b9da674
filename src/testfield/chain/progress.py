"""Progress on standard error: a bar on a terminal, plain lines elsewhere, so that a log is never silent for long."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

EVERY_S = 15.0
"""No longer than this without a line."""
LEAST_S = 1.0
"""No two lines about one thing are closer, but for the last."""
SILENT_S = 1.0
"""What takes less, because there is nothing to do, is not spoken of."""
SHARE = 0.1
"""The part of the whole after which there is another line."""


@contextmanager
def bar(title: str, total: float, unit: str, before: float = 0.0) -> Iterator[Callable[[float], None]]:
    """A bar that is moved by calling what this yields with the amount done since the last call. What was done `before`
    says nothing of how fast it goes now."""
    if sys.stderr.isatty():
        yield from _bar(title, total, unit, before)
    else:
        yield from _Lines(title, total, unit, before).run()


@contextmanager
def step(title: str) -> Iterator[None]:
    """What is one step and may take long: where it does, and nobody looks at a terminal, lines say that it goes on."""
    if sys.stderr.isatty():
        yield
        return
    for _ in _Lines(title, 0, "").run():
        yield


def say(title: str, what: str) -> None:
    """One line about a piece of work, before it begins."""
    print(f"{title}: {what}", file=sys.stderr, flush=True)


def _bar(title: str, total: float, unit: str, before: float) -> Iterator[Callable[[float], None]]:
    from tqdm import tqdm

    layout = "{desc:<12}{percentage:3.0f}% |{bar:30}| {n:.0f}/{total:.0f} {unit}  {elapsed}<{remaining}"
    with tqdm(
        total=total, desc=title, unit=unit, leave=True, bar_format=layout, mininterval=0.2, initial=before
    ) as meter:

        def move(amount: float) -> None:
            # Fractions of a unit do not add up to exactly one.
            meter.update(min(amount, total - meter.n))

        yield move


class _Lines:
    """Plain lines: at the beginning, after every tenth or 15 s, at the end. A total of 0 is one step."""

    def __init__(self, title: str, total: float, unit: str, before: float = 0.0):
        self.title, self.total, self.unit = title, total, unit
        self.done, self.said, self.before = before, before, before  # amounts
        self.begun = time.monotonic()
        self.last: float | None = None
        """When the last line was; none yet."""
        self.ended = threading.Event()
        self.lock = threading.Lock()

    def run(self) -> Iterator[Callable[[float], None]]:
        """Yield what is called with the amount done; a thread speaks where nothing is done for long."""
        watch = threading.Thread(target=self._watch, daemon=True)
        watch.start()
        try:
            yield self.move
            self._finish()
        finally:
            self.ended.set()
            watch.join()

    def move(self, amount: float) -> None:
        """Enter what was done since the last call."""
        with self.lock:
            self.done = min(self.done + amount, self.total)
            share = (self.done - self.said) / self.total if self.total else 0.0
            quiet = 0.0 if self.last is None else time.monotonic() - self.last
            if self.done < self.total and ((share >= SHARE and quiet >= LEAST_S) or quiet >= EVERY_S):
                self.say(self._so_far())

    def say(self, what: str) -> None:
        """One line."""
        self.last, self.said = time.monotonic(), self.done
        say(self.title, what)

    def _watch(self) -> None:
        if self.ended.wait(SILENT_S):
            return
        with self.lock:
            self.say(self._so_far() if self.total else "begun")
        while not self.ended.wait(max((self.last or 0.0) + EVERY_S - time.monotonic(), 0.1)):
            with self.lock:
                if time.monotonic() - (self.last or 0.0) >= EVERY_S:
                    self.say(self._so_far())

    def _so_far(self) -> str:
        gone = time.monotonic() - self.begun
        if not self.total:
            return f"{spoken_s(gone)} so far"
        now = self.done - self.before
        rest = (
            f", about {spoken_s(gone * (self.total - self.done) / now)} to go" if now else f", {spoken_s(gone)} so far"
        )
        return f"{self.done:.0f} of {self.total:.0f} {self.unit} ({100 * self.done / self.total:.0f} %){rest}"

    def _finish(self) -> None:
        gone = time.monotonic() - self.begun
        if self.last is not None:
            amount = f"{self.done:.0f} of {self.total:.0f} {self.unit}" if self.total else "done"
            self.say(f"{amount} in {spoken_s(gone)}")


def spoken_s(seconds: float) -> str:
    """A time as people say it: 8 s, 3 min, 2.5 h."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
