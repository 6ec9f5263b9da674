"""Work for a cluster that tells what it did, and a parent that can be killed."""

import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from testfield.chain.run import Run
from testfield.cluster.here import Cluster
from testfield.evaluate.case import Case

HERE = Path(__file__).parent
WORK = f"{Path(__file__).stem}:told"


def told(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """Rows that are random by the case's number, after some time; a line in a file when they are begun and done."""
    number, log = case.labels["n"], Path(case.options["log"])
    _line(log, f"begun {number} {os.getpid()}")
    time.sleep(case.options["sleep_s"])
    rng = np.random.default_rng(number)
    rows = [{"value": rng.normal(), "word": "x" * (number % 3), "row": k} for k in range(1 + number % 2)]
    _line(log, f"done {number} {os.getpid()}")
    return rows


def _line(log: Path, text: str) -> None:
    with log.open("ab", buffering=0) as file:  # one write to a file opened for appending is whole
        file.write(f"{text}\n".encode())


def cases(count: int, log: Path, sleep_s: float) -> list[Case]:
    """Cases of `told`."""
    return [Case({"n": n}, WORK, options={"log": str(log), "sleep_s": sleep_s}) for n in range(count)]


def counted(log: Path, word: str) -> Counter[int]:
    """How often each case was begun or done."""
    lines = [line.split() for line in log.read_text().splitlines()] if log.exists() else []
    return Counter(int(line[1]) for line in lines if line[0] == word)


def environment(**more: str) -> dict[str, str]:
    """Of processes that find this file's work."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path} | more


def wait_for(condition: Callable[[], bool], seconds: float = 60) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)


def parent(cluster: Cluster, folder: Path, count: int, log: Path, sleep_s: float, **more: str) -> subprocess.Popen:
    """A process that has the cases done by a cluster, and can be killed."""
    command = (
        "import sys; from pathlib import Path; from on_a_cluster import *; "
        "from testfield.cluster.opened import opened; from testfield.evaluate.execute import execute; "
        "from testfield.errors import TestfieldError\n"
        f"folder = Path({str(folder)!r})\n"
        "try:\n"
        f"    with opened({cluster.address!r}, None, folder, 60) as pool:\n"
        f"        execute(cases({count}, Path({str(log)!r}), {sleep_s}), folder, pool=pool)\n"
        "except TestfieldError as error:\n"
        "    sys.exit(error.sentence())\n"
    )
    return subprocess.Popen([sys.executable, "-c", command], env=environment(**more), stderr=subprocess.PIPE, text=True)
