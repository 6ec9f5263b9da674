"""A folder has one writer, its files are whole, and what the ledger did not write is somebody else's."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from testfield.errors import TestfieldError
from testfield.store.atomic import part_path, sweep, whole
from testfield.store.ledger import Ledger
from testfield.store.lock import LOCK, only_writer
from testfield.store.processes import running, started, this_process


def write(text: str):
    return lambda path: path.write_text(text)


def holding(folder: Path) -> subprocess.Popen:
    """Another process that holds a folder until it is ended."""
    code = f"""
import time
from pathlib import Path
from testfield.store.lock import only_writer
with only_writer(Path({str(folder)!r})):
    print("held", flush=True)
    time.sleep(60)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline() == b"held\n"
    return process


def test_a_second_writer_is_told_who_is_the_first(tmp_path: Path) -> None:
    first = holding(tmp_path)
    try:
        with pytest.raises(TestfieldError, match=str(first.pid)), only_writer(tmp_path):
            raise AssertionError("two writers")
    finally:
        first.kill()
        first.wait()
    with only_writer(tmp_path):  # the first was killed, and could not give the folder back
        assert (tmp_path / LOCK).is_file()
    assert not list(tmp_path.iterdir())


def test_a_lock_is_stale_when_its_holders_number_belongs_to_another_process(tmp_path: Path) -> None:
    me = this_process()
    for holder in (
        {"pid": me.pid, "host": me.host, "started": "another boot/1", "command": "x"},
        {"pid": 2**22 + 1, "host": me.host, "started": me.started, "command": "x"},
    ):
        (tmp_path / LOCK).write_text(json.dumps(holder))
        with only_writer(tmp_path):
            assert json.loads((tmp_path / LOCK).read_text())["started"] == me.started


def test_a_holder_on_another_machine_is_believed(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text(json.dumps({"pid": 1, "host": "elsewhere", "started": "", "command": "x"}))
    with pytest.raises(TestfieldError, match="elsewhere"), only_writer(tmp_path):
        raise AssertionError("two writers")


def test_a_lock_whose_writer_was_killed_before_it_wrote_its_name_is_stale(tmp_path: Path) -> None:
    (tmp_path / LOCK).touch()
    with only_writer(tmp_path):
        assert (tmp_path / LOCK).stat().st_size > 0


def test_of_many_that_take_over_a_dead_lock_one_at_a_time_holds_it(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text(
        json.dumps({"pid": 2**22 + 1, "host": this_process().host, "started": "x"} | {"command": ""})
    )
    code = f"""
import os, time
from pathlib import Path
from testfield.errors import TestfieldError
from testfield.store.lock import only_writer
folder = Path({str(tmp_path)!r})
done = 0
until = time.monotonic() + 10
while done < 20 and time.monotonic() < until:
    try:
        with only_writer(folder):
            os.close(os.open(folder / "inside", os.O_CREAT | os.O_EXCL))
            os.unlink(folder / "inside")
            done += 1
    except TestfieldError:
        pass
assert done == 20
"""
    processes = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert [process.wait() for process in processes] == [0, 0, 0]


def test_a_zombie_is_no_running_process() -> None:
    child = subprocess.Popen([sys.executable, "-c", "pass"])
    while started(child.pid):
        time.sleep(0.02)
    assert child.returncode is None  # nobody has waited for it
    child.wait()
    assert not running(child.pid) and running(os.getpid())


def test_parts_of_a_living_process_stay_and_those_of_dead_ones_go(tmp_path: Path) -> None:
    mine = part_path(tmp_path / "frames/a.png")
    mine.parent.mkdir()
    mine.touch()
    dead = mine.with_name(f".a.part{2**22 + 1}.png")
    other_machines = mine.with_name(f".a.part{2**22 + 1}-0000abcd.png")
    for part in (dead, other_machines):
        part.touch()
    sweep(tmp_path)
    assert mine.exists() and not dead.exists() and other_machines.exists()


def test_a_file_is_whole_or_absent(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with pytest.raises(RuntimeError), whole(path) as part:
        part.write_text("half")
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_a_kill_between_placing_and_entering_leaves_the_file_the_ledgers_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger = Ledger(tmp_path)
    ledger.make("a.txt", "1", write("first"))
    moved = Path.replace

    def killed(self: Path, target: Path) -> Path:
        moved(self, target)
        if Path(target).name == "a.txt":
            raise KeyboardInterrupt
        return Path(target)

    for text in ("second", "third"):
        monkeypatch.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            Ledger(tmp_path).make("a.txt", text, write(text))
        monkeypatch.setattr(Path, "replace", moved)
        assert not Ledger(tmp_path).foreign("a.txt")
    assert Ledger(tmp_path).make("a.txt", "4", write("fourth"))
    assert (tmp_path / "a.txt").read_text() == "fourth"


def test_somebody_elses_file_is_never_written_over_unless_the_bytes_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("mine")
    ledger = Ledger(tmp_path)
    with pytest.raises(TestfieldError, match=r"a\.txt"):
        ledger.make("a.txt", "1", write("theirs"))
    assert (tmp_path / "a.txt").read_text() == "mine"
    assert ledger.make("a.txt", "1", write("mine")) and Ledger(tmp_path).fresh("a.txt", "1")


def test_nothing_is_written_through_a_link_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()
    (tmp_path / "run").mkdir()
    (tmp_path / "run/frames").symlink_to(tmp_path / "outside")
    with pytest.raises(TestfieldError, match="frames"):
        Ledger(tmp_path / "run").make("frames/a.txt", "1", write("a"))
    assert not list((tmp_path / "outside").iterdir())


@pytest.mark.parametrize(
    "text", ["", "[]", '{"notes": 1}', '{"files": {"a": {"key": 1}}}', '{"notes": {"time_s": {"a": NaN}}}', "[" * 5000]
)
def test_a_damaged_ledger_knows_nothing(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text)
    ledger = Ledger(tmp_path)
    assert not ledger.files and not ledger.notes
    ledger.save()


def _children(of: int) -> list[int]:
    said = subprocess.run(["ps", "-o", "pid=", "--sid", str(of)], capture_output=True, text=True)
    return [int(pid) for pid in said.stdout.split()]


@pytest.mark.skipif(sys.platform != "linux", reason="asks for a session's processes")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_no_process_of_a_pool_outlives_its_command(number: int, tmp_path: Path) -> None:
    code = """
import time
from testfield.store.pool import process_pool
if __name__ == "__main__":
    with process_pool(2) as pool:
        list(pool.map(time.sleep, [0, 0]))
        later = [pool.submit(time.sleep, 60) for _ in range(2)]
        print("begun", flush=True)
        [one.result() for one in later]
"""
    (tmp_path / "pool.py").write_text(code)
    command = [sys.executable, str(tmp_path / "pool.py")]

    def heard() -> None:
        """What started the tests may ignore a hang-up, and its children inherit that."""
        for one in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(one, signal.SIG_DFL)

    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True, preexec_fn=heard
    )
    assert process.stdout is not None and process.stdout.readline() == b"begun\n"
    assert len(_children(process.pid)) >= 4  # itself, two workers, their resource tracker
    process.send_signal(number)
    assert process.wait(30) == -number  # the signal ended it, not the end of its work
    until = time.monotonic() + 2
    while _children(process.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not _children(process.pid)


def test_a_worker_that_is_killed_ends_the_command_in_a_sentence() -> None:
    from testfield.store.pool import process_pool

    with pytest.raises(TestfieldError, match="ended from outside"), process_pool(1) as pool:
        pool.submit(os.kill, pool.submit(os.getpid).result(), signal.SIGKILL).result()
