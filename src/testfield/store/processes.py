"""Processes of this machine: whether one still lives, also where its number has been given to another since."""

import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")


@dataclass(frozen=True)
class Process:
    """A process by its number, its machine, the moment it was started (as the machine writes it), and its command."""

    pid: int
    host: str
    started: str
    command: str

    @property
    def here(self) -> bool:
        """Whether it is, or was, a process of this machine."""
        return self.host == platform.node()

    @property
    def gone(self) -> bool:
        """Whether it has certainly ended. Of another machine's process nothing is certain."""
        return self.here and started(self.pid) != self.started


def this_process() -> Process:
    """This process."""
    return Process(os.getpid(), platform.node(), started(os.getpid()), " ".join(["testfield", *sys.argv[1:]]))


def running(pid: int) -> bool:
    """Whether a process of this number lives on this machine."""
    return started(pid) != ""


def started(pid: int) -> str:
    """When a process was started, in a form that no other process of the same number has; empty if none runs.

    On Linux that is the boot and the clock tick since then, elsewhere what `ps` prints. A process that has ended and
    only waits for its parent to take notice runs no more.
    """
    if (PROC / "self/stat").exists():
        try:
            # The command's name stands in brackets, and may hold brackets and blanks itself.
            fields = (PROC / str(pid) / "stat").read_bytes().rpartition(b")")[2].split()
        except OSError:
            return ""
        boot = (PROC / "sys/kernel/random/boot_id").read_bytes().decode().strip()
        return "" if fields[0] in (b"Z", b"X") else f"{boot}/{int(fields[19])}"
    said = subprocess.run(["ps", "-o", "lstart=", "-p", str(pid)], capture_output=True, check=False)
    return said.stdout.decode(errors="replace").strip()
