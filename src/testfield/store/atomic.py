"""Files that are whole or absent."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testfield.store.processes import running


def part_path(path: Path) -> Path:
    """Where this process writes `path` before it is put in its place."""
    return path.with_name(f".{path.stem}.part{os.getpid()}{path.suffix}")


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
    """Remove the parts that processes which are gone left in a folder and below. Those of a living process stay."""
    for part in list(folder.rglob(".*.part[0-9]*")):
        number = re.search(r"\.part(\d+)", part.name)
        if number and not running(int(number[1])):
            part.unlink(missing_ok=True)
