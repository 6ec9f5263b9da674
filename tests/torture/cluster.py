"""A worker, the scheduler or the parent of a cluster is ended at a random moment: the same table, nothing twice."""

import random
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from ends import _kept

sys.path.insert(0, str(Path(__file__).parents[1]))
from on_a_cluster import cases, counted, environment, parent, wait_for

from testfield.cluster.here import Cluster
from testfield.evaluate.execute import execute

WAYS = ("worker", "scheduler", "parent")
COUNT, SLEEP_S = 40, 0.2
LONGEST_S = 300.0
BEFORE = 5
"""One in so many ends comes while the parent begins, the others while cases are at work."""


def kills(count: int, folder: Path) -> list[dict[str, Any]]:
    """Results of `count` ends, those kept in `folder`/cluster_kills.jsonl not done again."""
    place = folder / "cluster"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    log = place / "log"
    with Cluster(place, environment()) as cluster:
        cluster.scheduler()
        cluster.worker("a")
        cluster.worker("b")
        execute(cases(COUNT, log, SLEEP_S), place / "one")
        wanted = (place / "one/results.parquet").read_bytes()
        parent(cluster, place / "first", COUNT, log, SLEEP_S).communicate()  # workers look at the code once

        def one(number: int) -> dict[str, Any]:
            rng, way, out = random.Random(number), WAYS[number % len(WAYS)], place / "many"
            shutil.rmtree(out, ignore_errors=True)
            log.unlink(missing_ok=True)
            running = parent(cluster, out, COUNT, log, SLEEP_S)
            if number % BEFORE:
                wait_for(log.exists, LONGEST_S)
            after = rng.uniform(0, COUNT * SLEEP_S / 2)
            time.sleep(after)
            done = len(counted(log, "done"))
            if way == "parent":
                running.kill()
            elif way == "scheduler":
                cluster.kill("scheduler")
                time.sleep(rng.uniform(0, 3))
                cluster.scheduler()
            else:
                name = rng.choice("ab")
                cluster.kill(name)
                cluster.worker(name)
            said = running.communicate(timeout=LONGEST_S)[1]
            wrong = ["a traceback"] if "Traceback" in said else []
            status = running.returncode
            if status:
                again = parent(cluster, out, COUNT, log, SLEEP_S)
                said = again.communicate(timeout=LONGEST_S)[1]
                wrong += [f"the next one ends with {again.returncode}: {said[-200:]}"] if again.returncode else []
            if not wrong and (out / "results.parquet").read_bytes() != wanted:
                wrong.append("another table")
            begun, finished = counted(log, "begun"), counted(log, "done")
            if sum(begun.values()) > COUNT + 2 or set(finished) != set(range(COUNT)):
                wrong.append(f"{sum(begun.values())} begun, {len(finished)} done of {COUNT}")
            row = {"way": way, "after_s": round(after, 2), "done_before": done, "status": status}
            return row | {"begun": sum(begun.values()), "wrong": "; ".join(wrong)}

        return _kept(count, folder / "cluster_kills.jsonl", one)
