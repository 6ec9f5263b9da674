"""A cluster of this machine alone, for benchmarks and tests: a scheduler and workers that can be killed."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from testfield.store.processes import running


@dataclass
class Cluster:
    """A scheduler and workers, each a process of its own with an `environment`. Logs are in `folder`."""

    folder: Path
    environment: dict[str, str] = field(default_factory=lambda: dict(os.environ))
    port: int = 0
    processes: dict[str, subprocess.Popen] = field(default_factory=dict)

    @property
    def address(self) -> str:
        """Where the scheduler is."""
        return f"tcp://127.0.0.1:{self.port}"

    def __enter__(self) -> "Cluster":
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        return self

    def __exit__(self, *_: object) -> None:
        for name in list(self.processes):
            self.kill(name)

    def scheduler(self) -> None:
        """Begin the scheduler, or begin it again at the same port."""
        words = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"]
        self.begin("scheduler", words)

    def worker(self, name: str, **more: str) -> None:
        """Begin a worker."""
        words = ["testfield", "worker", self.address, "--scratch", str(self.folder / name)]
        self.begin(name, words, **more)

    def kill(self, name: str) -> None:
        """End one and all that it has begun, as a power cut would."""
        process = self.processes.pop(name)
        for pid in [*children(process.pid), process.pid]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.wait()

    def begin(self, name: str, words: list[str], **more: str) -> None:
        """Begin a process: Python with a module and its arguments."""
        with (self.folder / f"{name}.log").open("ab") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", *words], env=self.environment | more, stdout=log, stderr=log, cwd=self.folder
            )


def children(pid: int) -> list[int]:
    """All processes below one, the youngest first."""
    found: list[int] = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_bytes().rpartition(b")")[2].split()[1])
        except OSError:
            continue
        if parent == pid and running(int(stat.parent.name)):
            below = int(stat.parent.name)
            found += [*children(below), below]
    return found
