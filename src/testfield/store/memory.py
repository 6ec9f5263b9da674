"""The most memory that a piece of work takes, beyond what its process had before."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
SELF = PROC / "self"
RESET_PEAK = "5"
"""What Linux' proc(5), clear_refs, takes to set the peak of a process' resident memory back to what it is."""


@dataclass(eq=False)
class Peak:
    """`mb` of 10^6 bytes; not a number where this system does not tell. `program_mb` of the largest program within."""

    mb: float = float("nan")
    program_mb: float = 0.0


_open: list[Peak] = []


@contextmanager
def peak_memory() -> Iterator[Peak]:
    """Set `mb` of what is given, at the end of the block, to the most resident memory within it, less what there was at
    its beginning, and the most of the largest program that `look_at` saw within it."""
    peak = Peak()
    before = _reset()
    _open.append(peak)
    try:
        yield peak
    finally:
        _open.remove(peak)
        if before is not None and (most := _status_mb("VmHWM")) is not None:
            peak.mb = max(most - before, 0.0) + peak.program_mb


def look_at(process: int) -> None:
    """Count a program that runs, by its number, and whatever it has started, with the blocks that are open.

    What the system says of a program that has ended (`ru_maxrss`) is no use: it is never less than what its parent had
    when it began. So we look while it runs, and what it takes after the last look is not seen.
    """
    if _open:
        most = _program_mb(str(process))
        for peak in _open:
            peak.program_mb = max(peak.program_mb, most)


def _program_mb(process: str) -> float:
    """The most that any one of a program and its descendants has had."""
    try:
        children = (PROC / process / "task" / process / "children").read_text().split()
    except OSError:
        children = []
    return max([_status_mb("VmHWM", PROC / process) or 0.0, *map(_program_mb, children)])


def _reset() -> float | None:
    try:
        (SELF / "clear_refs").write_text(RESET_PEAK)
    except OSError:
        return None
    return _status_mb("VmRSS")


def _status_mb(name: str, process: Path = SELF) -> float | None:
    try:
        lines = (process / "status").read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(found[0]) * 1024 / 1e6 if found else None
