"""A program of somebody's own ends with the command that started it, however that ends, and leaves nothing behind."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from testfield.measure.aside import clocks
from testfield.measure.outside import Program
from testfield.measure.programs import run_program

STARTS = """
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from testfield.measure.outside import Program
from testfield.measure.programs import run_program

here = Path(sys.argv[1])
with TemporaryDirectory(dir=here, prefix="work-") as folder:
    program = Program("sh hangs.sh", here, 60.0)
    run_program(program, {}, Path(folder), "here")
"""
HANGS = "sleep 60 & echo $$ $! > ids.part; mv ids.part ids; wait\n"


def _lives(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def _within(seconds: float, asked) -> bool:  # type: ignore[no-untyped-def]
    until = time.monotonic() + seconds
    while not asked() and time.monotonic() < until:
        time.sleep(0.02)
    return bool(asked())


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_a_program_and_its_folder_do_not_outlive_the_process_that_started_it(number: int, tmp_path: Path) -> None:
    (tmp_path / "hangs.sh").write_text(HANGS)

    def heard() -> None:
        """What started the tests may ignore a hang-up, and its children inherit that."""
        for one in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(one, signal.SIG_DFL)

    command = [sys.executable, "-c", STARTS, str(tmp_path)]
    process = subprocess.Popen(command, start_new_session=True, preexec_fn=heard)
    pids: list[int] = []
    try:
        assert _within(60, (tmp_path / "ids").exists)
        pids = [int(word) for word in (tmp_path / "ids").read_text().split()]
        assert len(pids) == 2 and all(_lives(pid) for pid in pids) and list(tmp_path.glob("work-*"))
        process.send_signal(number)
        assert process.wait(30) == -number
        assert _within(5, lambda: not any(_lives(pid) for pid in pids))
        assert _within(5, lambda: not list(tmp_path.glob("work-*")))
    finally:
        process.kill()
        for pid in filter(_lives, pids):
            os.kill(pid, signal.SIGKILL)


def test_a_program_that_ended_keeps_what_it_wrote(tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    run_program(Program("touch {csv}", tmp_path), {"csv": work / "centres.csv"}, work, "here")
    assert (work / "centres.csv").is_file()


def test_a_file_that_is_renamed_while_its_size_is_asked_spoils_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "work"
    work.mkdir()
    part = work / "centres.csv.part"
    part.write_text("x_px,y_px\n")
    is_file, moved = Path.is_file, []

    def and_moved(path: Path) -> bool:
        """What the program does between two questions of ours."""
        there = is_file(path)
        if path == part and there:
            moved.append(path.rename(work / "centres.csv"))
        return there

    monkeypatch.setattr(Path, "is_file", and_moved)
    run_program(Program("sleep 0.2", tmp_path), {}, work, "here")
    assert moved and is_file(work / "centres.csv")


INSTALLS = """
import sys
from pathlib import Path
from testfield.measure.environment import _run

here = Path(sys.argv[1])
(here / "environment").mkdir()
_run(["sh", str(here / "hangs.sh")], ("mine",), "here", here / "environment")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_an_installation_ends_with_the_command_that_began_it_and_leaves_nothing_half_made(
    number: int, tmp_path: Path
) -> None:
    (tmp_path / "hangs.sh").write_text(f"cd {tmp_path}\n{HANGS}")
    process = subprocess.Popen([sys.executable, "-c", INSTALLS, str(tmp_path)], start_new_session=True)
    try:
        assert _within(60, (tmp_path / "ids").exists)
        pids = [int(word) for word in (tmp_path / "ids").read_text().split()]
        assert all(_lives(pid) for pid in pids)
        process.send_signal(number)
        assert _within(10, lambda: not any(_lives(pid) for pid in pids))
        assert _within(10, lambda: not (tmp_path / "environment").exists())
    finally:
        process.kill()
        process.wait()


def test_what_a_program_works_is_told_with_its_stage(tmp_path: Path) -> None:
    (tmp_path / "works.py").write_text("import time\nwhile time.process_time() < 0.3:\n    pass\n")
    begun = clocks()["cpu"]
    run_program(Program(f"{sys.executable} works.py", tmp_path, 60.0), {}, tmp_path, "here")
    assert clocks()["cpu"] - begun > 0.25
