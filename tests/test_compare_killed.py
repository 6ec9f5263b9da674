"""A comparison that is killed goes on from there: nothing finished is done again, and the tables are the same bytes."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from conftest import TINY

WORDS = ("--centroids", "star,template", "--draws", "2", "--until", "detect")
TIMED = ("recipes", "results")
"""Tables that say how long things took: alike but for that."""
MOST_S = 300.0


def command(out: Path, jobs: int) -> list[str]:
    words = [*WORDS, "--jobs", str(jobs), "--out", str(out)]
    return [sys.executable, "-m", "testfield", "compare", str(TINY), *words]


def run(out: Path, jobs: int) -> None:
    done = subprocess.run(command(out, jobs), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def tables(out: Path) -> dict[str, bytes]:
    """Bytes of all tables that say nothing of time, and of the others' remaining columns."""
    found = {path.name: path.read_bytes() for path in out.glob("*.csv") if path.stem not in (*TIMED, "cases")}
    found |= {path.name: path.read_bytes() for path in out.glob("*.parquet") if path.stem not in TIMED}
    for name in TIMED:
        table = pd.read_parquet(out / f"{name}.parquet")
        kept = [key for key in table if not key.startswith(("time_", "cpu_", "memory_"))]
        found[name] = table[kept].to_json().encode()
    return found


def finished(out: Path) -> dict[Path, int]:
    """Finished cases and rendered views, and when each was written."""
    paths = [*out.glob("cases/*.parquet"), *out.glob("runs/*/radiance/*.exr")]
    return {path: path.stat().st_mtime_ns for path in paths if not path.name.startswith(".")}


def kept_cases(out: Path) -> int:
    """How many cases stand; a part of a file is none yet."""
    return sum(path.parent.name == "cases" for path in finished(out))


def killed(out: Path, jobs: int, after_s: float = 0.0) -> dict[Path, int]:
    """What was finished when the command was killed with all that it had begun: after a time, or, where none is given,
    once a case is done."""
    process = subprocess.Popen(
        command(out, jobs), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    begun, cases = time.monotonic(), kept_cases(out)
    while process.poll() is None and time.monotonic() - begun < (after_s or MOST_S):
        if not after_s and kept_cases(out) > cases:
            break
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return finished(out)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """The folder of a comparison that nobody disturbs, and the s it took."""
    out, begun = tmp_path_factory.mktemp("undisturbed"), time.monotonic()
    run(out, 1)
    return out, time.monotonic() - begun


@pytest.mark.slow
def test_a_killed_comparison_goes_on_to_the_same_tables(undisturbed: tuple[Path, float], tmp_path: Path) -> None:
    there = killed(tmp_path, 1)
    assert any("cases" in str(path) for path in there) and any("radiance" in str(path) for path in there)
    run(tmp_path, 1)
    whole = finished(tmp_path)
    assert there.items() <= whole.items() and len(whole) > len(there)  # nothing finished was written again
    assert tables(tmp_path) == tables(undisturbed[0])
    assert not list(tmp_path.rglob(".*.part*"))


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_killed_again_and_again_at_random_moments_it_comes_to_the_same_end(
    number: int, undisturbed: tuple[Path, float], tmp_path: Path
) -> None:
    rng, before = random.Random(number), dict[Path, int]()
    for _ in range(4):
        there = killed(tmp_path, 1 + number % 2, rng.uniform(0.5, undisturbed[1]))
        assert before.items() <= there.items()
        before = there
    run(tmp_path, 1 + number % 2)
    assert before.items() <= finished(tmp_path).items()
    assert tables(tmp_path) == tables(undisturbed[0])
    every = {path: path.read_bytes() for path in tmp_path.glob("*.*") if path.suffix in (".csv", ".parquet", ".tex")}
    run(tmp_path, 1)  # times are kept with the cases: whole files are the same
    assert {path: path.read_bytes() for path in every} == every
