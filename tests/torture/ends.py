"""End a run at random moments, or run it twice at once, and ask for the same bytes afterwards."""

import contextlib
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ALIKE = (
    "scene.toml",
    "field.json",
    "radiance/*",
    "frames/*",
    "truth/*",
    "observations.parquet",
    "calibration.json",
    "points.parquet",
)
"""Files of a run that are the same bytes every time. The others say how long it took."""
WAYS = ("SIGKILL", "SIGTERM", "a worker", "quota")
GONE_WITHIN_S = 2.0


def command(scene: Path, folder: Path) -> list[str]:
    """The command that makes a run, in two processes."""
    return [sys.executable, "-m", "testfield", "run", str(scene), "--out", str(folder), "--jobs", "2"]


def digests(folder: Path) -> dict[str, str]:
    """Digests of what must be alike."""
    paths = sorted(path for pattern in ALIKE for path in folder.glob(pattern))
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def reference(scene: Path, folder: Path) -> tuple[dict[str, str], float]:
    """Digests of an undisturbed run, and its time in s; kept."""
    kept = folder / "reference.json"
    if not kept.exists():
        begun = time.monotonic()
        subprocess.run(command(scene, folder / "reference"), check=True, capture_output=True)
        kept.write_text(json.dumps([digests(folder / "reference"), time.monotonic() - begun]))
    whole, seconds = json.loads(kept.read_text())
    return whole, seconds


def kills(count: int, scene: Path, folder: Path) -> list[dict[str, Any]]:
    """Results of `count` ends, those kept in `folder`/kills.jsonl not done again."""
    whole, seconds = reference(scene, folder)

    def one(number: int) -> dict[str, Any]:
        rng, place = random.Random(number), folder / "killed"
        shutil.rmtree(place, ignore_errors=True)
        way, after = WAYS[number % len(WAYS)], rng.uniform(0, seconds)
        wrong = _end(way, after, rng, command(scene, place))
        again = subprocess.run(command(scene, place), capture_output=True, text=True, check=False)
        if again.returncode:
            wrong.append(f"the next run ends with {again.returncode}: {again.stderr.strip().splitlines()[-1:]}")
        elif digests(place) != whole:
            wrong.append("other bytes")
        if list(place.rglob(".*.part*")):
            wrong.append("parts are left")
        return {"way": way, "after_s": round(after, 2), "wrong": "; ".join(wrong)}

    return _kept(count, folder / "kills.jsonl", one)


def _end(way: str, after_s: float, rng: random.Random, words: list[str]) -> list[str]:
    """Begin a command and end it; what was wrong with its end."""
    most = rng.choice([1_000, 30_000, 300_000, 1_000_000, 3_000_000])

    def quota() -> None:
        if way == "quota":
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    process = subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=quota
    )
    if way != "quota":
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(after_s)
        others = [pid for pid in session(process.pid) if pid != process.pid and is_worker(pid)]
        target = process.pid if way != "a worker" else rng.choice(others) if others else 0
        if target:
            with contextlib.suppress(ProcessLookupError):  # it may have finished
                os.kill(target, signal.SIGTERM if way == "SIGTERM" else signal.SIGKILL)
    said = process.communicate()[1]
    wrong = []
    if way in ("quota", "a worker") and (process.returncode not in (0, 2) or "Traceback" in said):
        wrong.append(f"ends with {process.returncode}: {said.strip().splitlines()[-1:]}")
    until = time.monotonic() + GONE_WITHIN_S
    while session(process.pid) and time.monotonic() < until:
        time.sleep(0.05)
    if left := session(process.pid):
        wrong.append(f"{len(left)} processes are left")
        for pid in left:
            os.kill(pid, signal.SIGKILL)
    return wrong


def session(leader: int) -> list[int]:
    """Living processes of a session."""
    said = subprocess.run(["ps", "-o", "pid=,stat=", "--sid", str(leader)], capture_output=True, text=True, check=False)
    rows = [line.split() for line in said.stdout.splitlines()]
    return [int(pid) for pid, state in rows if not state.startswith("Z")]


def is_worker(pid: int) -> bool:
    """Whether a process does work for another. What Python begins to keep count of semaphores does none."""
    with contextlib.suppress(OSError):
        return b"resource_tracker" not in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def pairs(count: int, scene: Path, folder: Path) -> list[dict[str, Any]]:
    """Results of `count` times two runs at once in one folder, those kept in `folder`/pairs.jsonl not done again."""
    whole, seconds = reference(scene, folder)

    def one(number: int) -> dict[str, Any]:
        rng, place, wrong = random.Random(1000 + number), folder / "pair", []
        shutil.rmtree(place, ignore_errors=True)
        both = [subprocess.Popen(command(scene, place), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)]
        time.sleep(rng.choice([0.0, rng.uniform(0, seconds)]))
        both += [subprocess.Popen(command(scene, place), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)]
        said = [process.communicate()[1] for process in both]
        status = sorted(process.returncode for process in both)
        if status not in ([0, 0], [0, 2]) or any("Traceback" in text for text in said):
            wrong.append(f"they end with {status}: {[text.strip().splitlines()[-1:] for text in said]}")
        if digests(place) != whole:
            wrong.append("other bytes")
        return {"way": "two at once", "status": status, "wrong": "; ".join(wrong)}

    return _kept(count, folder / "pairs.jsonl", one)


def _kept(count: int, path: Path, one: Any) -> list[dict[str, Any]]:
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    for number in range(len(rows), count):
        rows.append(one(number))
        with path.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    return rows[:count]
