"""One folder, one writer: a lock file that names the process which holds it.

The file is made by exclusive creation, which network file systems honour where they ignore `flock`. A lock whose holder
has ended is taken over; that of a process on another machine is believed.
"""

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from testfield.errors import TestfieldError
from testfield.store.processes import Process, this_process

LOCK = ".testfield-lock"
WAIT_STEP_S = 0.2
"""How often one who waits looks whether the folder is free."""
WRITTEN_WITHIN_S = 2.0
"""How long after its creation a lock may still be without its holder's name; afterwards the holder was killed there."""


@contextmanager
def only_writer(folder: Path, wait_s: float = 0.0) -> Iterator[None]:
    """Nobody else writes into the folder, which is made where it is missing.

    Raises `TestfieldError` where another process does, and still does after so many seconds. In a process that
    holds the folder already, nothing changes.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    path, me = folder / LOCK, this_process()
    if _holder(path) == me:
        yield
        return
    _take(path, me, time.monotonic() + wait_s)
    try:
        yield
    finally:
        if _holder(path) == me:
            path.unlink(missing_ok=True)
        if made and not any(folder.iterdir()):
            folder.rmdir()  # nothing came of it


def _take(path: Path, me: Process, until: float) -> None:
    while not _create(path, me):
        content = _content(path)
        holder = _process(content)
        if holder is not None and not holder.gone:
            if time.monotonic() < until:
                time.sleep(WAIT_STEP_S)
                continue
            do = "wait until it has ended" if holder.here else f"wait until it has ended, or delete {path} if it has"
            raise TestfieldError(
                f"process {holder.pid} on {holder.host} ('{holder.command}') is writing here", str(path.parent), do
            )
        if content is not None:
            _retire(path, content)


def _create(path: Path, me: Process) -> bool:
    try:
        file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
    except FileExistsError:
        return False
    except FileNotFoundError:  # the folder was empty, and went with the one who had made it
        path.parent.mkdir(parents=True, exist_ok=True)
        return False
    try:
        os.write(file, json.dumps(asdict(me)).encode())
    except OSError:
        path.unlink()
        raise
    finally:
        os.close(file)
    return True


def _content(path: Path) -> bytes | None:
    """What a lock says, None if there is none any more; a lock that was just made has a moment to be written."""
    until = time.monotonic() + WRITTEN_WITHIN_S
    while True:
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        if _process(content) is not None or time.monotonic() > until:
            return content
        time.sleep(0.05)


def _process(content: bytes | None) -> Process | None:
    try:
        return Process(**json.loads(content or b""))
    except (ValueError, TypeError):
        return None


def _holder(path: Path) -> Process | None:
    try:
        return _process(path.read_bytes())
    except OSError:
        return None


def _retire(path: Path, content: bytes) -> None:
    """Take a dead lock away. Of several processes that try, one moves it; a lock that was new by then is put back."""
    aside = path.with_name(f"{LOCK}.part{os.getpid()}")
    try:
        path.rename(aside)
    except FileNotFoundError:
        return
    if aside.read_bytes() != content and not path.exists():
        aside.rename(path)
    aside.unlink(missing_ok=True)
