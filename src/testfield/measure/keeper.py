"""Ends what a command began, whatever way that command itself ends, even by SIGKILL."""

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

KEEPER = """
read -r group && { read -r ended && exit; kill -KILL "-$group"; }
rm -rf -- "$1"
"""
"""A shell that reads a program's group, and then nothing but the end of the pipe where we ended before the program."""


@contextlib.contextmanager
def keeper(work: Path) -> Iterator[Callable[[int], None]]:
    """What is told of a program's group ends it, and removes `work`, if this process ends within the block.

    The kernel's own signal at a parent's death reaches the program alone, and not what it started.
    """
    keeper = subprocess.Popen(
        ["/bin/sh", "-c", KEEPER, "keeper", str(work.absolute())],
        bufsize=0,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        cwd="/",
    )
    assert keeper.stdin is not None
    pipe = keeper.stdin

    def keep(group: int) -> None:
        with contextlib.suppress(BrokenPipeError):  # somebody ended it
            pipe.write(f"{group}\n".encode())

    try:
        yield keep
    finally:
        keeper.communicate(b"ended\nended\n")  # once more where no program began


def end(process: subprocess.Popen) -> None:
    """End whatever of a process' group still runs."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
