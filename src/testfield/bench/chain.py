"""The whole chain from nothing, and beside it the chain of another checkout: stage by stage, in turns."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError

OURS, THEIRS = "here", "other"


def bench_chain(scene: Path, other: Path | None, times: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Run a scene from nothing `times` times, in a folder of its own each time, and with the source of checkout
    `other` in turns; medians in seconds, of processors' time too, and the peak memory of the largest process in GB.

    `ratio` is the median of the pairs' quotients, here over there. Raises `TestfieldError` where `other` is no
    checkout, or a run fails.
    """
    trees = {OURS: Path(__file__).resolve().parents[2]} | ({} if other is None else {THEIRS: _source(other)})
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in trees}
    for k in range(times):
        for name, source in trees.items() if k % 2 == 0 else reversed(trees.items()):
            tell(f"{scene.stem}, {name}, {k + 1} of {times}")
            runs[name].append(_run(scene, source))
    sides = {name: _median(own) for name, own in runs.items()}
    found: dict[str, Any] = {"scene": scene.stem, "times": times, **sides}
    if other is not None:
        pairs = [a["wall_s"] / b["wall_s"] for a, b in zip(runs[OURS], runs[THEIRS], strict=True)]
        found["ratio"] = float(np.median(pairs))
        here, there = (sides[name]["stages_s"] for name in (OURS, THEIRS))
        found["stage_ratios"] = {name: here[name] / there[name] for name in here if there.get(name, 0) > 0}
    return found


def _source(checkout: Path) -> Path:
    source = checkout / "src"
    if not (source / "testfield" / "__main__.py").is_file():
        raise TestfieldError(
            "no checkout of testfield, which has src/testfield",
            f"--against {checkout}",
            "give the folder of one, made for example by `git worktree add ../before COMMIT`",
        )
    return source.resolve()


def _run(scene: Path, source: Path) -> dict[str, Any]:
    """One run by the source of a checkout, in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="testfield-chain-") as folder:
        command = [sys.executable, "-m", "testfield", "run", str(scene.resolve()), "--out", f"{folder}/run"]
        start = time.perf_counter()
        with Path(folder, "said").open("w+") as said:
            child = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=said, env=os.environ | {"PYTHONPATH": str(source)}
            )
            try:
                _, status, usage = os.wait4(child.pid, 0)
            except BaseException:
                child.kill()
                raise
            wall = time.perf_counter() - start
            card = Path(folder, "run", "scorecard.json")
            if os.waitstatus_to_exitcode(status) or not card.is_file():
                said.seek(0)
                words = said.read().strip().splitlines()
                raise TestfieldError(f"the run failed: {words[-1] if words else 'no word'}", str(scene))
        stages = json.loads(card.read_text())["time_s"]
        size = sum(file.stat().st_size for file in Path(folder, "run", "radiance").glob("*.exr"))
    return {
        "wall_s": wall,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "peak_memory_gb": usage.ru_maxrss * 1024 / 1e9,
        "radiance_gb": size / 1e9,
        "stages_s": stages,
    }


def _median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    plain = {key: float(np.median([run[key] for run in runs])) for key in runs[0] if key != "stages_s"}
    stages = {name: float(np.median([run["stages_s"][name] for run in runs])) for name in runs[0]["stages_s"]}
    return {**plain, "stages_s": stages}


def lines(figures: dict[str, Any]) -> Iterator[str]:
    """What `bench_chain` found as a table, with another checkout's times and their ratio where there is one."""
    here, there = figures[OURS], figures.get(THEIRS)
    beside = "" if there is None else f"{'other':>9}{'ratio':>8}"
    yield f"{figures['scene'] + ', from nothing':<30}{'here':>9}{beside}"
    whole = (("wall_s", "whole, s"), ("processor_s", "of the processors, s"), ("peak_memory_gb", "peak memory, GB"))
    rows = [(what, here[key], there and there[key]) for key, what in whole]
    rows += [(f"  {name}, s", s, there and there["stages_s"].get(name)) for name, s in here["stages_s"].items()]
    rows.append(("radiance on disk, GB", here["radiance_gb"], there and there["radiance_gb"]))
    for what, ours, theirs in rows:
        beside = f"{theirs:>9.2f}{ours / theirs:>8.2f}" if theirs else ""
        yield f"{what:<30}{ours:>9.2f}{beside}"
