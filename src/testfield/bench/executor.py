"""What the executor and Dask cost beside a bare loop over the same work, and what a second worker gains.

Work that sleeps takes the same time however busy the machine is, so what is longer is overhead; work that computes
shows what two workers gain where nothing but processors is the limit, and wants a machine of two idle cores.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from testfield.bench.claims import world_rows
from testfield.chain.run import Run
from testfield.cluster.here import Cluster
from testfield.cluster.opened import opened
from testfield.evaluate.case import Case
from testfield.evaluate.execute import do_case, execute
from testfield.scene.shipped import find_scene
from testfield.store.text import read_text

FIGURES = 100
"""Columns of a row, as many as a scorecard has."""
WORKS = ("sleep", "compute")


def asleep(case: Case, _: Run | None) -> list[dict[str, Any]]:
    """A row of figures after some time."""
    time.sleep(case.options["seconds"])
    return [{f"figure_{k}": case.labels["n"] + k / 7 for k in range(FIGURES)}]


def computed(case: Case, _: Run | None) -> list[dict[str, Any]]:
    """A drawn world of a small scene, measured: no images, so nothing but arithmetic."""
    return world_rows(Case({"world": case.labels["n"]}, options=case.options), None)


def bench_executor(work: str, count: int, seconds: float, tell: Callable[[str], None]) -> dict[str, Any]:
    """Wall time (s) of `count` cases as a bare loop, by the executor in this process, and by one and two workers."""
    source = find_scene(Path("quick"))
    options: dict[str, Any] = {"text": read_text(source), "source": str(source.resolve())}
    name = "computed" if work == "compute" else "asleep"
    if work == "sleep":
        options = {"seconds": seconds}
    cases = [Case({"n": k}, f"{__name__}:{name}", options=options) for k in range(count)]
    warm = [Case({"n": -1 - k}, f"{__name__}:{name}", options=options) for k in range(8)]
    with tempfile.TemporaryDirectory() as below, Cluster(Path(below)) as cluster:
        folder = Path(below)
        do_case(warm[0], folder)
        begun, used = time.perf_counter(), time.process_time()
        for case in cases:
            do_case(case, folder)
        figures: dict[str, Any] = {"work": work, "cases": count, "bare_s": time.perf_counter() - begun}
        figures["bare_processor_s"] = time.process_time() - used
        tell(f"bare loop {figures['bare_s']:.2f} s")
        execute(warm[:1], folder / "warm")
        figures |= _timed("executor", lambda: execute(cases, folder / "here"))
        cluster.scheduler()
        for number in (1, 2):
            cluster.worker(f"worker{number}")
            with opened(cluster.address, None, folder / f"by{number}") as pool:
                while sum(pool.client.nthreads().values()) < number:
                    time.sleep(0.1)
                execute(warm, folder / f"warm{number}", pool=pool)  # workers import, and look at the code
                pool.counted_again()
                asked, place = pool, folder / f"by{number}"
                figures |= _timed(f"workers_{number}", lambda pool=asked, at=place: execute(cases, at, pool=pool))  # type: ignore[misc]
            tell(f"{number} worker(s) {figures[f'workers_{number}_s']:.2f} s")
    per_case = 1000 / count
    return figures | {
        "load": os.getloadavg()[0],
        "executor_overhead": figures["executor_s"] / figures["bare_s"] - 1,
        "executor_ms_per_case": (figures["executor_s"] - figures["bare_s"]) * per_case,
        "dask_overhead": figures["workers_1_s"] / figures["bare_s"] - 1,
        "dask_ms_per_case": (figures["workers_1_s"] - figures["bare_s"]) * per_case,
        "two_over_one": figures["workers_1_s"] / figures["workers_2_s"],
    }


def lines(figures: dict[str, Any]) -> Iterator[str]:
    """The figures of `bench_executor`, a line each."""
    for name, what in (("executor", "executor in one process"), ("dask", "Dask, one worker")):
        over, each = figures[f"{name}_overhead"], figures[f"{name}_ms_per_case"]
        yield f"{what:<26}{100 * over:6.1f} % over a bare loop, {each:6.1f} ms a case"
    yield f"{'two workers':<26}{figures['two_over_one']:6.2f} times one"


def _timed(name: str, act: Callable[[], Any]) -> dict[str, float]:
    begun, used = time.perf_counter(), time.process_time()
    act()
    return {f"{name}_s": time.perf_counter() - begun, f"{name}_parent_processor_s": time.process_time() - used}
