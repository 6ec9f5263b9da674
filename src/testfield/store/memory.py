"""The most memory that a piece of work takes, beyond what its process had before."""

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

SELF = Path("/proc/self")
RESET_PEAK = "5"
"""What Linux' proc(5), clear_refs, takes to set the peak of a process' resident memory back to what it is."""


@dataclass
class Peak:
    """`mb` of 10^6 bytes; not a number where this system does not tell."""

    mb: float = float("nan")


@contextmanager
def peak_memory() -> Iterator[Peak]:
    """Set `mb` of what is given, at the end of the block, to the most resident memory within it, less what there was at
    its beginning. Programs that the block starts and waits for count with their own, where they are the largest yet."""
    peak, children = Peak(), _children_mb()
    before = _reset()
    try:
        yield peak
    finally:
        if before is not None and (most := _status_mb("VmHWM")) is not None:
            more = _children_mb()
            peak.mb = max(most - before, 0.0) + (more if more > children else 0.0)


def _reset() -> float | None:
    try:
        (SELF / "clear_refs").write_text(RESET_PEAK)
    except OSError:
        return None
    return _status_mb("VmRSS")


def _status_mb(name: str) -> float | None:
    try:
        lines = (SELF / "status").read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(found[0]) * 1024 / 1e6 if found else None


def _children_mb() -> float:
    size = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return size / 1e6 if sys.platform == "darwin" else size * 1024 / 1e6
