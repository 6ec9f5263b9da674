"""Test the mutants of a session of cosmic-ray: `mutate.py SESSION JOBS`, what `cosmic-ray exec` does, ten times faster.

Each mutant has a copy of the source and a process of its own, forked from one that has read the large libraries, and
meets only the tests that run what it changes (`narrow.py`).
"""

import contextlib
import difflib
import os
import shutil
import signal
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

import cosmic_ray.plugins
from cosmic_ray.mutating import mutate_code
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkItem, WorkResult

sys.path.insert(0, str(Path(__file__).parent))

from narrow import OPTIONS, chosen, statement
from run import GREEN, LIBRARIES, RED

LIMIT_S = 400
"""Of a mutant that does not end."""
KILLED = (RED, 2, 4, -signal.SIGALRM, -signal.SIGSEGV, -signal.SIGABRT)
"""A test fails; tests, or what they share, cannot be imported; without end; or the interpreter itself breaks."""


def main(session: str, jobs: int) -> None:
    """Test all mutants that were not tested yet, `jobs` at a time."""
    for name in LIBRARIES:
        with contextlib.suppress(ImportError):
            import_module(name)
    with use_db(session, WorkDB.Mode.open) as database:
        waiting, running = list(database.pending_work_items), {}
        while waiting or running:
            while waiting and len(running) < jobs:
                item = waiting.pop()
                running[_begin(item.mutations[0])] = (item, time.perf_counter())
            pid, status = os.wait()
            item, begin = running.pop(pid)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)  # whatever a test has left behind
            shutil.rmtree(_folder(pid), ignore_errors=True)
            _keep(database, item, os.waitstatus_to_exitcode(status), time.perf_counter() - begin)


def _keep(database: WorkDB, item: WorkItem, ended: int, seconds: float) -> None:
    """Keep and print what became of a mutant, from how its tests ended."""
    one = item.mutations[0]
    if ended not in (*KILLED, GREEN):
        raise RuntimeError(f"the tests of {one} ended with {ended}")
    said = TestOutcome.SURVIVED if ended == GREEN else TestOutcome.KILLED
    text, mutant = _sound_and_mutant(one)
    diff = "\n".join(difflib.unified_diff(text.split("\n"), mutant.split("\n"), lineterm=""))
    database.set_result(item.job_id, WorkResult(WorkerOutcome.NORMAL, f"ended with {ended}", said, diff))
    place = f"{one.module_path}:{one.start_pos[0]}"
    print(f"{said.value:<9}{seconds:6.1f} s  {place:<50} {one.operator_name}", flush=True)


def _folder(pid: int) -> Path:
    return Path(tempfile.gettempdir()) / f"mutant-{pid}"


def _sound_and_mutant(one: MutationSpec) -> tuple[str, str]:
    text = Path(one.module_path).read_text(encoding="utf-8")
    mutant = mutate_code(text, cosmic_ray.plugins.get_operator(one.operator_name)(**one.operator_args), one.occurrence)
    if mutant is None:
        raise LookupError(f"{one.operator_name} does not apply to {one.module_path}")
    return text, mutant


def _begin(one: MutationSpec) -> int:
    """The process that tests a mutant."""
    pid = os.fork()
    if pid:
        return pid
    try:
        os.setpgid(0, 0)
        signal.alarm(LIMIT_S)  # ends the process, whatever it does
        os._exit(_test(one, _folder(os.getpid())))
    except BaseException:
        import traceback

        traceback.print_exc()
        os._exit(99)


def _test(one: MutationSpec, folder: Path) -> int:
    """Exit status of the tests of a mutant, none of which is green."""
    text, mutant = _sound_and_mutant(one)
    tests = chosen(str(one.module_path), statement(text, one.start_pos[0], one.end_pos[0]))
    if not tests:
        return GREEN
    source = folder / "src"
    shutil.copytree("src", source)
    (folder / one.module_path).write_text(mutant, encoding="utf-8")
    for path in (folder / one.module_path).parent.glob(f"__pycache__/{Path(one.module_path).stem}.*"):
        path.unlink()
    sys.path.insert(0, str(source))
    os.environ["PYTHONPATH"] = str(source)  # for processes that tests start
    # To a file, since a test may look at what is written.
    out = os.open(folder / "said", os.O_WRONLY | os.O_CREAT)
    os.dup2(out, 1)
    os.dup2(out, 2)
    import pytest

    status = int(pytest.main([*OPTIONS, f"--basetemp={folder / 'pytest'}", *tests]))
    package = sys.modules.get("testfield")
    if package is not None and not Path(str(package.__file__)).is_relative_to(source):
        return 98  # another source was tested
    return status


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
