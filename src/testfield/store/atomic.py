"""Files that are whole or absent."""

import hashlib
import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testfield.store.processes import running

HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
"""This machine, as names of parts have it: in a folder that many machines see, numbers of processes repeat."""


def part_path(path: Path) -> Path:
    """Where this process writes `path` before it is put in its place."""
    return path.with_name(f".{path.stem}.part{os.getpid()}-{HOST}{path.suffix}")


def settle(part: Path) -> None:
    """See that a part's bytes are on the disk."""
    with part.open("rb+") as file:
        os.fsync(file.fileno())


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`; on success it takes the place of `path` at once, on failure it is removed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = part_path(path)
    try:
        yield part
        settle(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Remove the parts that processes of this machine which are gone left in a folder and below. Those of a living
    process stay, and those of other machines: of them nothing is known."""
    for part in list(folder.rglob(".*.part[0-9]*")):
        found = re.search(r"\.part(\d+)(?:-([0-9a-f]{8}))?", part.name)
        if found and found[2] in (None, HOST) and not running(int(found[1])):
            part.unlink(missing_ok=True)
