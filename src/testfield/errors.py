"""Errors that speak to a person: what is wrong, where, and what to do."""

import difflib
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")

DAMAGE = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    EOFError,
    ArithmeticError,
    RecursionError,
    MemoryError,
    OSError,
)
"""What reading a damaged file may raise."""


class TestfieldError(Exception):
    """Something a person can mend. The command line prints it in one line and exits with status 2; of `Faults` each
    has a line.

    Parameters
    ----------
    what : one sentence that names the value and what is wrong with it.
    where : the file, and the field in it, that the sentence is about.
    do : what to do about it, as an imperative.
    """

    __test__ = False  # the name begins with "Test", and pytest would collect it

    def __init__(self, what: str, where: str = "", do: str = ""):
        self.what, self.where, self.do = what, where, do
        super().__init__(self.sentence())

    def __reduce__(self) -> tuple:
        # Exceptions travel between processes by their arguments.
        return type(self), (self.what, self.where, self.do)

    def sentence(self) -> str:
        """The whole message on one line: `where: what; do`."""
        head = f"{self.where}: " if self.where else ""
        tail = f"; {self.do}" if self.do else ""
        return f"{head}{self.what}{tail}"


class Faults(TestfieldError):
    """Several things that are wrong with one thing at once. The first speaks for all where only one can."""

    def __init__(self, faults: Sequence[TestfieldError]):
        self.faults = tuple(faults)
        super().__init__(faults[0].what, faults[0].where, faults[0].do)

    def __reduce__(self) -> tuple:
        return type(self), (self.faults,)


def faults_in(error: TestfieldError) -> tuple[TestfieldError, ...]:
    """All that an error speaks of, one after the other."""
    return error.faults if isinstance(error, Faults) else (error,)


def gather(*checks: Callable[[], T]) -> list[T]:
    """What each of some checks returns. Raises `TestfieldError` with all that any of them raised."""
    found: list[T] = []
    faults: list[TestfieldError] = []
    for check in checks:
        try:
            found.append(check())
        except TestfieldError as error:
            faults += faults_in(error)
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    return found


def nearest(name: str, known: Iterable[str]) -> str:
    """What to do about a name that nobody knows: the nearest one that is known, or all of them."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=1)
    return f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(known)}"


def speaking(what: str) -> Callable[[Callable[Concatenate[Path, P], T]], Callable[Concatenate[Path, P], T]]:
    """Decorator of a function that reads a file: a damaged or foreign file becomes a `TestfieldError` that names it."""

    def wrap(load: Callable[Concatenate[Path, P], T]) -> Callable[Concatenate[Path, P], T]:
        @wraps(load)
        def speak(path: Path, *args: P.args, **kwargs: P.kwargs) -> T:
            try:
                return load(path, *args, **kwargs)
            except DAMAGE as error:
                # Arrow's and JSON's own errors are ValueErrors; Arrow's of damaged bytes are OSErrors without a number.
                if isinstance(error, OSError) and error.errno is not None:
                    raise
                reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
                raise TestfieldError(f"not a readable {what} file ({reason})", str(path), "make it again") from error

        return speak

    return wrap
