"""What workers of a cluster do when they are given something. Workers need only the package."""

import os
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from testfield.cluster.program import differences, host
from testfield.errors import TestfieldError
from testfield.registry import load_file
from testfield.store.disk import spoken
from testfield.store.objects import Objects
from testfield.store.work import stop_when

SAME = "install the same versions there as here"


def ready(wanted: Mapping[str, str], place: Objects, token: str) -> TestfieldError | None:
    """What keeps this worker from working for a parent: another program, or a place for results that it does not see
    (a file called `token` lies in it) or may not write."""
    if said := differences(wanted):
        return TestfieldError(f"its program is another one: {said}", host(), SAME)
    try:
        if not place.there(token):
            return TestfieldError(
                f"it does not see {place.where}", host(), "name a place that all machines see with --store"
            )
        place.check()
    except TestfieldError as error:
        return TestfieldError(error.what, f"{host()}, {error.where}", error.do)
    except OSError as error:
        return _spoken(error)
    return None


def do(wanted: Mapping[str, str], loaded: tuple[str, ...], function: Callable, *arguments: Any) -> Any:
    """Call a function for a parent, after the parent's own files of algorithms are loaded.

    Raises `TestfieldError` where this worker's program is another one, or the file system says no.
    """
    if said := differences(wanted):
        raise TestfieldError(f"its program is another one: {said}", host(), SAME)
    _settle()
    for file in loaded:
        load_file(Path(file))
    return told(function, *arguments)


def told(function: Callable, *arguments: Any) -> Any:
    """Call a function. Raises `TestfieldError`, which names this worker, where the file system says no."""
    try:
        return function(*arguments)
    except OSError as error:
        raise _spoken(error) from error


def _spoken(error: OSError) -> TestfieldError:
    said = spoken(error)
    return TestfieldError(said.what, f"{host()}, {said.where}", said.do)


@cache
def _settle() -> None:
    from distributed import get_worker

    os.environ["TQDM_DISABLE"] = "1"
    tempfile.tempdir = get_worker().local_directory  # emptied by Dask also after a kill

    def cancelled() -> bool:
        worker = get_worker()
        task = worker.state.tasks.get(worker.get_current_task())
        return task is None or task.state not in ("executing", "long-running")

    stop_when(cancelled)
