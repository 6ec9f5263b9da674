"""Feed mutated inputs to the program, each in a process of its own that is watched."""

import json
import os
import resource
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any

import cases
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from own import measure_with

BATCH = 25
CPU_S, MEMORY_MB = 20, 2000
ROOM_BYTES = 8 << 30
"""Address space beyond which a process is stopped before the machine suffers; what counts is memory in use."""


def feed(count: int, folder: Path, sound: Path, only: str = "") -> list[dict[str, Any]]:
    """Results of `count` inputs for readers with `only` in their names, those kept in `folder`/inputs.jsonl not done
    again."""
    import testfield.chain.stages
    import testfield.cli.main  # everything is imported once, before the forks
    import testfield.evaluate.comparison_cases
    import testfield.measure.recipe_file
    import testfield.report.page
    import testfield.uncertainty.statement  # noqa: F401

    kept = folder / "inputs.jsonl"
    done = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    batches = {(row["reader"], row["batch"]) for row in done if row.get("last")}
    done = [row for row in done if (row["reader"], row["batch"]) in batches]
    names = [name for name in cases.READERS if only in name]
    rounds = -(-count // (len(names) * BATCH))
    for number in range(rounds):
        for name in names:
            size = min(BATCH, -(-count // len(names)) - number * BATCH)
            if size < 1 or (name, number) in batches:
                continue
            rows = _batch(name, number, size, folder, sound)
            if not rows:
                continue
            rows[-1]["last"] = True
            with kept.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)
            done += rows
    return done


def _batch(name: str, number: int, size: int, folder: Path, sound: Path) -> list[dict[str, Any]]:
    reader, rows = cases.READERS[name], []
    original = cases.sound(reader, sound)

    @seed(number)
    @settings(
        max_examples=size,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def each(data: st.DataObject) -> None:
        content = reader.change(data.draw, original)
        rows.append({"reader": name, "batch": number} | _one(reader, content, folder, sound))

    each()
    return rows[:size]


def _one(reader: cases.Reader, content: bytes, folder: Path, sound: Path) -> dict[str, Any]:
    place = folder / "input"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(sound, place, copy_function=os.link)  # the program replaces files and never writes into one
    for gone in reader.without:
        (place / gone).unlink()
    target = place / reader.file
    target.unlink()
    target.write_bytes(content)
    said = folder / "said.txt"
    begun = time.monotonic()
    pid = os.fork()
    if not pid:
        _child([part.format(place) for part in reader.command], said)
    _, status, used = os.wait4(pid, 0)
    code, text = os.waitstatus_to_exitcode(status), said.read_text(errors="replace")
    wrong = _wrong(code, text, used)
    if wrong:
        keep = folder / "failures" / f"{reader.file.replace('/', '_')}-{os.urandom(4).hex()}"
        keep.mkdir(parents=True)
        (keep / "input").write_bytes(content)
        (keep / "said.txt").write_text(" ".join(reader.command) + "\n" + text)
        wrong = f"{wrong} ({keep.name})"
    return {"status": code, "wrong": wrong, "s": round(time.monotonic() - begun, 2)}


def _wrong(code: int, text: str, used: resource.struct_rusage) -> str:
    if used.ru_utime + used.ru_stime > CPU_S or code == -signal.SIGXCPU:
        return f"longer than {CPU_S} s"
    if used.ru_maxrss > MEMORY_MB * 1024:
        return f"{used.ru_maxrss // 1024} MB"
    if code not in (0, 1, 2) or "Traceback" in text:
        return f"status {code}: {(text.strip().splitlines() or [''])[-1][:120]}"
    if code == 2 and sum(line.startswith("testfield: ") for line in text.splitlines()) != 1:
        return "not one sentence"
    return ""


def _child(command: list[str], said: Path) -> None:
    code = 70
    try:
        with said.open("w") as file:
            os.dup2(file.fileno(), 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (ROOM_BYTES, ROOM_BYTES))
        from testfield.cli.main import main

        code = measure_with(command[1:]) if command[0] == cases.MEASURE else main(command)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
