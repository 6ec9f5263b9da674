"""A crash of somebody's own algorithm speaks like any other error; one of this project's own stays a traceback."""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testfield.errors import TestfieldError
from testfield.registry import KINDS, find

OWN_PACKAGES = ("testfield", "testfield_studies")


class Crashed(TestfieldError):
    """An error of somebody else's code or program, which a comparison counts as a crash."""

    kind = "crashed"


class TimedOut(TestfieldError):
    """A program that did not end, which a comparison counts as such."""

    kind = "timed out"


@contextmanager
def blamed(stage: str, name: str) -> Iterator[None]:
    """What an algorithm of somebody else's raises becomes a `Crashed` that names it, its file and line."""
    try:
        yield
    except TestfieldError:
        raise
    except Exception as error:
        function = find(stage, name)
        if function.__module__.split(".")[0] in OWN_PACKAGES:
            raise
        file = function.__code__.co_filename if hasattr(function, "__code__") else ""
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
        said = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        where = f"{Path(file).name}, line {lines[-1]}" if lines else f"{function.__module__}, {name}"
        raise Crashed(f"{KINDS[stage]} '{name}' crashed ({said})", where, "mend it") from error
