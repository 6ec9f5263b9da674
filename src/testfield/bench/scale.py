"""What becomes of a table of 100,000 cases on 1,000 workers: unit costs measured here, the rest simulated.

Measured, in processor time: a case's key, a task at the scheduler and at the parent (with many idle workers in one
process), their heartbeats, reading rows, listing names. Simulated, event by event: parent and scheduler do one thing
at a time, a worker does its batch. Storage is counted in requests; how long it takes to answer is an assumption.
"""

import heapq
import math
import os
import pickle
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.bench.executor import FIGURES
from testfield.cluster.dask_pool import AHEAD
from testfield.cluster.here import Cluster
from testfield.cluster.opened import opened
from testfield.evaluate.case import case
from testfield.evaluate.execute import BATCHES, LARGEST_BATCH, case_key
from testfield.evaluate.kept_rows import AT_ONCE, LIST_SHARE, KeptRows
from testfield.scene.shipped import find_scene
from testfield.seeds import generator
from testfield.store.objects import Objects
from testfield.store.work import LOOK_S, as_done

ANSWER_S = 0.03
"""Object storage answers a request in about this time (assumed)."""
NAMES = 1000
"""Names in an answer to a listing (of S3's ListObjectsV2)."""
SCATTER = 0.5
"""Standard deviation of the logarithm of the time that a case takes."""
TASKS = 2000
IS_IT_THERE = 3
"""Requests by which s3fs finds that an object is not there (counted at a server of moto's)."""


@dataclass(frozen=True)
class Costs:
    """Processor time (s) of: a case's `key`; a task at the `scheduler` and at the `parent`; `heartbeats` of one worker
    at the scheduler in a second, if there are `idle` of them; rows of a case when they are `read` into the table; a
    name that is `listed` in a folder. `alone` and `together` are the sizes of a case on its way, in bytes: by itself,
    and in a batch of one scene."""

    key: float
    scheduler: float
    parent: float
    heartbeats: float
    read: float
    listed: float
    alone: float
    together: float
    idle: int


def measured(tell: Callable[[str], None], workers: int = 100) -> Costs:
    """Unit costs on this machine."""
    scene = case(find_scene(Path("quick")))
    cases = [replace(scene, labels={"n": k}, noise_seed=k) for k in range(200)]
    case_key(cases[0])
    key = _each(lambda k: case_key(cases[k]), len(cases))
    alone = len(pickle.dumps(cases[0]))
    together = len(pickle.dumps(cases[:LARGEST_BATCH])) / LARGEST_BATCH
    tell(f"a key takes {1e3 * key:.2f} ms")
    with tempfile.TemporaryDirectory() as below:
        read, listed = _of_rows(Path(below))
        tell(f"rows of a case are read in {1e3 * read:.1f} ms")
        scheduler, parent, heartbeats = _of_tasks(Path(below), workers)
        tell(f"a task takes {1e3 * scheduler:.2f} ms of the scheduler, {1e3 * parent:.2f} ms of the parent")
    return Costs(key, scheduler, parent, heartbeats, read, listed, alone, together, workers)


def _each(do: Callable[[int], Any], count: int) -> float:
    begun = time.process_time()
    for k in range(count):
        do(k)
    return (time.process_time() - begun) / count


def _of_rows(folder: Path) -> tuple[float, float]:
    kept = KeptRows(Objects(str(folder / "rows")))
    for k in range(100):
        kept.write(f"{k:032d}", [{f"figure_{n}": k + n / 7 for n in range(FIGURES)}], 1.0)

    def row(k: int) -> pd.DataFrame:
        found = kept.read(f"{k:032d}")
        assert found is not None
        return pd.concat([pd.DataFrame({"n": k}, index=found.rows.index), found.rows], axis=1)

    read = _each(row, 100)
    many = folder / "many/cases"
    many.mkdir(parents=True)
    for k in range(10_000):
        (many / f"{k:032d}.parquet").touch()
    listed = _each(lambda _: Objects(str(folder / "many")).names("cases"), 3) / 10_000
    return read, listed


def _of_tasks(folder: Path, workers: int) -> tuple[float, float, float]:
    with Cluster(folder, os.environ | {"DASK_LOGGING__DISTRIBUTED": "critical"}) as cluster:
        cluster.scheduler()
        cluster.begin("workers", ["testfield.bench.idle_workers", cluster.address, str(workers)])
        with opened(cluster.address, None, folder) as pool:
            while sum(pool.client.nthreads().values()) < workers:
                time.sleep(0.2)
            pool.counted_again()
            scheduler = cluster.processes["scheduler"].pid
            before, begun = _processor_s(scheduler), time.monotonic()
            time.sleep(8)
            idle = (_processor_s(scheduler) - before) / (time.monotonic() - begun)
            before, begun, used = _processor_s(scheduler), time.monotonic(), time.process_time()
            for _ in as_done(abs, range(TASKS), pool=pool):
                pass
            parent = (time.process_time() - used) / TASKS
            busy = _processor_s(scheduler) - before - idle * (time.monotonic() - begun)
    return busy / TASKS, parent, idle / workers


def _processor_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def simulated(costs: Costs, count: int, workers: int, seconds: float, batch: int, ahead: int) -> dict[str, float]:
    """A table's time (s) from the first task to the last, parts of it that workers, scheduler and parent were busy, and
    the most tasks that the scheduler held."""
    took = generator(1, "scale").lognormal(math.log(seconds) - SCATTER**2 / 2, SCATTER, count)
    tasks = np.add.reduceat(took, np.arange(0, count, batch))
    events: list[tuple[float, int]] = []  # when a worker is done with a task
    free, waiting, following = workers, 0, 0
    scheduler = parent = at = 0.0
    most = given = 0
    while following < len(tasks) or events or waiting:
        while following < len(tasks) and given < ahead * workers:  # the parent gives what it may
            parent = max(parent, at) + costs.parent / 2
            scheduler = max(scheduler, parent) + costs.scheduler / 2
            given, waiting, following = given + 1, waiting + 1, following + 1
            most = max(most, given)
            if free:
                _begin(events, scheduler, tasks[following - waiting], following - waiting)
                free, waiting = free - 1, waiting - 1
        at, _ = heapq.heappop(events)
        scheduler = max(scheduler, at) + costs.scheduler / 2
        parent = max(parent, scheduler) + costs.parent / 2
        given, free = given - 1, free + 1
        if waiting:  # one that waits at the scheduler, or at the worker already
            _begin(events, scheduler, tasks[following - waiting], following - waiting)
            free, waiting = free - 1, waiting - 1
    whole = max(at, scheduler, parent)
    number = len(tasks)
    return {
        "tasks": number,
        "whole_s": whole,
        "workers_busy": float(took.sum()) / (workers * whole),
        "scheduler_busy": costs.scheduler * number / whole + heartbeats(costs, workers),
        "parent_busy": costs.parent * number / whole,
        "most_held": most,
        "held_mb": most * (costs.alone + (batch - 1) * costs.together) / 1e6,
    }


def heartbeats(costs: Costs, workers: int) -> float:
    """The part of its time that the scheduler hears heartbeats, which are rarer the more workers there are."""
    from distributed.scheduler import heartbeat_interval

    rate = workers / heartbeat_interval(workers)
    return costs.heartbeats * costs.idle * rate / (costs.idle / heartbeat_interval(costs.idle))


def _begin(events: list[tuple[float, int]], at: float, took: float, number: int) -> None:
    heapq.heappush(events, (at + float(took), number))


def requests(costs: Costs, count: int, whole_s: float) -> dict[str, float]:
    """Requests that object storage gets for a table, as built, and where each case were asked for every time."""
    pages = math.ceil(count / NAMES)
    looks = whole_s / max(LOOK_S, pages * ANSWER_S / LIST_SHARE)
    return {
        "looked_for_by_workers": IS_IT_THERE * count,
        "written": count,
        "read": count,
        "listed": (3 + looks) * pages,
        "one_by_one": count * (1 + whole_s / LOOK_S),
        "most_in_a_second": count * (IS_IT_THERE + 2) / whole_s + pages / max(pages * ANSWER_S, 1),
    }


def bench_scale(count: int, workers: int, seconds: float, tell: Callable[[str], None]) -> dict[str, Any]:
    """Costs, what the simulation says as built and without each measure, and what is left to one process."""
    costs = measured(tell)
    batch = min(max(count // (BATCHES * workers), 1), LARGEST_BATCH)
    ways = {
        "as built": (batch, AHEAD),
        "a task for each case": (1, AHEAD),
        "all given at once": (1, math.ceil(count / workers)),
        "one given at a time": (batch, 1),
    }
    runs = {name: simulated(costs, count, workers, seconds, *how) for name, how in ways.items()}
    whole = runs["as built"]["whole_s"]
    return {
        "cases": count,
        "workers": workers,
        "seconds": seconds,
        "batch": batch,
        "costs": vars(costs),
        "runs": runs,
        "requests": requests(costs, count, whole),
        "before_s": costs.key * count,
        "reading_s": costs.read * count,
        "reading_busy": costs.read * count / whole,
        "answers_busy": count * ANSWER_S / AT_ONCE / whole,
        "full_at_seconds": {
            "scheduler, as built": workers * costs.scheduler / batch,
            "scheduler, a task for each case": workers * costs.scheduler,
            "parent, reading rows": workers * costs.read,
            "parent, waiting for storage": workers * ANSWER_S / AT_ONCE,
        },
    }
