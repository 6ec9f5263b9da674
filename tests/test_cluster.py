"""Cases on many machines: what is lost is done again, what is finished is not, and the table is that of one process."""

import math
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from on_a_cluster import cases, counted, environment, wait_for

import testfield
from testfield.chain import progress
from testfield.cli.main import main
from testfield.cluster.at_work import do, told
from testfield.cluster.batch_file import BatchFile
from testfield.cluster.here import Cluster
from testfield.cluster.opened import opened
from testfield.cluster.program import program
from testfield.errors import TestfieldError, faults_in
from testfield.evaluate import execute as module
from testfield.evaluate.case import Case
from testfield.evaluate.cost import expected_s
from testfield.evaluate.execute import case_key, execute
from testfield.evaluate.kept_rows import Found
from testfield.store.processes import running
from testfield.store.work import Lost, as_done


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler without workers."""
    with Cluster(tmp_path_factory.mktemp("cluster"), environment()) as made:
        made.scheduler()
        yield made


def _workers(pool) -> int:
    return sum(pool.client.nthreads().values())


def test_a_worker_and_the_scheduler_are_killed_and_the_table_is_the_serial_one(
    cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    count, log = 40, tmp_path / "log"
    for name in "ab":
        cluster.worker(name)
    kills = iter([(8, "a"), (20, "scheduler")])
    following = next(kills)
    with opened(cluster.address, None, tmp_path / "many") as pool:
        wait_for(lambda: _workers(pool) == 2)
        submit = pool.submit

        def between(*arguments):  # a kill while work is under way
            nonlocal following
            if following and len(counted(log, "done")) >= following[0]:
                cluster.kill(following[1])
                if following[1] == "scheduler":
                    cluster.scheduler()
                following = next(kills, None)
            return submit(*arguments)

        pool.submit = between
        many = execute(cases(count, log, 0.05), tmp_path / "many", pool=pool)
    assert following is None
    begun, finished = counted(log, "begun"), counted(log, "done")
    # A case is done a moment before its result stands; the worker that is killed may be in that moment.
    assert set(finished) == set(range(count)) and sum(finished.values()) <= count + 1
    assert sum(begun.values()) <= count + 2  # each kill may have met a case at work
    assert f"{count} of {count} cases" in capsys.readouterr().err
    log.unlink()
    execute(cases(count, log, 0.05), tmp_path / "one", pool=None)
    assert (tmp_path / "many/results.parquet").read_bytes() == (tmp_path / "one/results.parquet").read_bytes()
    assert len(many) == 60
    # The worker that was not killed has found the scheduler again; the next call has nothing to do.
    log.unlink()
    with opened(cluster.address, None, tmp_path / "many") as pool:
        again = execute(cases(count, log, 0.05), tmp_path / "many", pool=pool)
    assert not counted(log, "begun") and again.equals(many)
    cluster.kill("b")


def test_a_worker_of_another_version_is_refused(cluster: Cluster, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(Path(testfield.__file__).parent, other / "testfield", ignore=shutil.ignore_patterns("shipped"))
    version = other / "testfield/version.py"
    version.write_text(version.read_text().replace('"0.', '"99.'))
    cluster.worker("other", PYTHONPATH=str(other))
    with pytest.raises(TestfieldError, match=r"testfield 99.* instead of 0.*install") as said:  # noqa: SIM117
        with opened(cluster.address, None, tmp_path / "out"):
            pass
    assert "worker" in said.value.where and not list((tmp_path / "out").iterdir())
    cluster.kill("other")


def test_a_worker_with_other_code_of_an_algorithm_measures_nothing(tmp_path: Path) -> None:
    one = cases(1, tmp_path / "log", 0)[0]
    at = module._Place(tmp_path, module.KeptRows(module.Objects(str(tmp_path))), away=True)
    with pytest.raises(TestfieldError, match="other code"):
        module._try((one, "0" * 64), at)
    assert not (tmp_path / "log").exists() and not (tmp_path / "cases").exists()
    assert module._try((one, case_key(one)), at) is None and (tmp_path / "log").exists()


def test_a_program_that_differs_in_anything_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in program():
        with pytest.raises(TestfieldError, match=name.replace("-", ".")):
            do({**program(), name: "another"}, (), int, "3")


# ------------------------------------------------------------------ a pool that loses work
class Loses:
    """A pool whose first answers are lost."""

    def __init__(self, lost: list[Lost]) -> None:
        self.lost, self.given, self.most = lost, 0, 0

    def at_once(self) -> int:
        return 2

    def submit(self, function, /, *arguments):
        self.given += 1
        return Answer(function, arguments, self.lost.pop(0) if self.lost else None)


class Answer:
    def __init__(self, function, arguments, lost: Lost | None) -> None:
        self.function, self.arguments, self.lost = function, arguments, lost

    def done(self) -> bool:
        return True

    def add_done_callback(self, call) -> None:
        call(self)

    def result(self):
        if self.lost:
            raise self.lost
        return self.function(*self.arguments)


def test_what_a_pool_lost_is_given_again_and_told_once() -> None:
    pool, told = Loses([Lost("it has gone")] * 5), []
    found = dict(as_done(abs, [-1, -2, -3], pool=pool, moved=told.append))
    assert found == {0: 1, 1: 2, 2: 3} and sorted(told) == [0, 1, 2] and pool.given == 8


def test_work_that_ends_every_process_ends_in_a_sentence_unless_it_gets_on() -> None:
    died = Lost("they were ended", blamed=True)
    with pytest.raises(TestfieldError, match="ended 3 times"):
        list(as_done(abs, [-1, -2], pool=Loses([died] * 3), groups=[[0, 1]]))
    kept = iter([False, False, True, False, True, True, True, True])
    assert len(list(as_done(abs, [-1, -2], pool=Loses([died] * 3), groups=[[0, 1]], kept=lambda _: next(kept)))) == 2


# ------------------------------------------------------------------ object storage
class Elsewhere(Loses):
    """A pool whose workers share no folder with this process."""

    def __init__(self, store) -> None:
        super().__init__([])
        self.store = store

    def processes(self) -> int:
        return 3


def test_finished_cases_stand_in_object_storage_and_nothing_else_is_shared(tmp_path: Path) -> None:
    store = module.Objects(f"local://{tmp_path}/bucket")  # not a folder to the program
    log, count = tmp_path / "log", 100
    here = execute(cases(count, log, 0), tmp_path / "here")
    pool = Elsewhere(store)
    there = execute(cases(count, log, 0), tmp_path / "there", pool=pool)
    assert there.equals(here) and pool.given == 50  # batches of two for three processes
    assert len(store.names("cases")) == count and not (tmp_path / "there/cases").exists()
    log.unlink()
    execute(cases(count, log, 0), tmp_path / "another", pool=Elsewhere(store))
    assert not log.exists()


class NoBucket:
    """What s3fs does where a bucket is missing: a write finds no place, and making folders would make the bucket."""

    protocol = ("s3", "s3a")

    def pipe_file(self, path: str, content: bytes) -> None:
        raise FileNotFoundError("The specified bucket does not exist")


def test_a_misspelt_bucket_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.Objects, "_reached", (NoBucket(), "buckte/place"))
    with pytest.raises(TestfieldError, match="no such bucket") as said:
        module.Objects("s3://buckte/place").check()
    assert said.value.where == "s3://buckte/place"


def test_files_that_a_scene_names_go_through_object_storage(tmp_path: Path) -> None:
    (tmp_path / "hull.obj").write_text("v 0 0 0\n")
    scene = {"name": "a", "meshes": [{"name": "hull", "file": "hull.obj"}]}
    one = Case({}, "x:y", scene=scene, folder=tmp_path)
    store = module.Objects(f"local://{tmp_path}/bucket")
    sent = module.packed(one, store)
    (tmp_path / "hull.obj").unlink()
    here = module.unpacked(sent, store, tmp_path / "worker")
    assert [path.read_text() for path in here.files.values()] == ["v 0 0 0\n"]
    (tmp_path / "hull.obj").write_text("v 0 0 0\n")
    assert module.case_key(here) == module.case_key(one) and module.run_name(here) == module.run_name(one)


# ------------------------------------------------------------------ what is said before and meanwhile
def test_the_time_that_is_left_is_told_from_what_finished_cases_took() -> None:
    known = [Case({"n": k}, weight=k + 1) for k in range(4)]
    found = [Found(pd.DataFrame(), 10.0), Found(pd.DataFrame(), 26.0), None, None]
    assert expected_s(known, found, 2) == pytest.approx(36 / 3 * 7 / 2)
    assert math.isnan(expected_s(known, [None] * 4, 2))


def test_what_was_done_before_says_nothing_of_how_fast_it_goes_now(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = progress._Lines("cases", 1000, "cases", before=900)
    monkeypatch.setattr(progress.time, "monotonic", lambda: lines.begun + 60)
    lines.done += 1
    assert "about 99 min to go" in lines._so_far()


# ------------------------------------------------------------------ a cluster's file
def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "slurm.toml"
    path.write_text(text)
    return path


def test_a_job_script_asks_for_what_the_file_says(tmp_path: Path) -> None:
    text = """
        jobs = 20
        processes = 4
        memory_gb = 16
        time = "1-02:00:00"
        queue = "long"
        account = "metrology"
        python = "/opt/env/bin/python"
        before = ["module load llvm"]
        directives = ["--constraint=avx2"]
        scratch = "/scratch"
    """
    with BatchFile.load(_file(tmp_path, text)).cluster(scheduler_options={"dashboard_address": ":0"}) as made:
        script = made.job_script()
    asked = [line.removeprefix("#SBATCH ") for line in script.splitlines() if line.startswith("#SBATCH")]
    assert {"-J testfield", "-p long", "-A metrology", "--cpus-per-task=4", "--mem=15G", "-t 1-02:00:00"} <= set(asked)
    assert "--constraint=avx2" in asked and "module load llvm" in script
    line = script.strip().splitlines()[-1]
    assert line.startswith("/opt/env/bin/python -m distributed.cli.dask_worker tcp://")
    assert "--nworkers 4" in line and "--nthreads 1" in line
    assert "--local-directory /scratch" in line and f"--lifetime {26 * 3600 - 120}s" in line


SBATCH = """#!/bin/bash
script=$(mktemp --tmpdir="$(dirname "$0")"); cp "$1" "$script"
setsid bash "$script" >/dev/null 2>&1 &
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/bash
kill -9 -- -"$1"
"""


@pytest.mark.slow
def test_jobs_of_a_batch_system_do_cases_and_end_with_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands that stand for Slurm's: they run job scripts on this machine, and end them."""
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    around = environment()
    monkeypatch.setenv("PATH", f"{tmp_path}:{around['PATH']}")
    path = f"export PYTHONPATH={around['PYTHONPATH']}"
    file = _file(tmp_path, f'jobs = 2\nmemory_gb = 2\ninterface = "lo"\nbefore = ["{path}"]\n')
    log = tmp_path / "log"
    with opened(str(file), None, tmp_path / "many") as pool:
        wait_for(lambda: _workers(pool) == 2)
        many = execute(cases(40, log, 0.05), tmp_path / "many", pool=pool)
        jobs = {int(line.split()[2]) for line in log.read_text().splitlines()}
    assert max(counted(log, "begun").values()) == 1 and len(jobs) == 2
    assert many.equals(execute(cases(40, log, 0.05), tmp_path / "one"))
    wait_for(lambda: not any(running(pid) for pid in jobs))


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("jobs = 3", "memory_gb"),
        ("jobs = 0\nmemory_gb = 4", "jobs"),
        ('jobs = 3\nmemory_gb = "4"', "memory_gb"),
        ("jobs = 3\nmemory_gb = nan", "memory_gb"),
        ('jobs = 3\nmemory_gb = 4\ntime = "an hour"', "time"),
        ('jobs = 3\nmemory_gb = 4\nqeue = "long"', "qeue"),
        ('jobs = 3\nmemory_gb = 4\nsystem = "slrum"', "system"),
        ('jobs = 3\nmemory_gb = 4\nbefore = ["a\\nb"]', "before"),
        ("jobs = ", "TOML"),
    ],
)
def test_a_malformed_file_is_refused_with_its_field(tmp_path: Path, text: str, field: str) -> None:
    path = _file(tmp_path, text)
    with pytest.raises(TestfieldError) as said:
        BatchFile.load(path)
    assert len(faults_in(said.value)) == 1 and field in said.value.sentence() and str(path) in said.value.where


# ------------------------------------------------------------------ what bad input gets
def _refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(list(words)) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said and said.count("testfield: ") == 1
    return said.splitlines()[-1]


def test_a_cluster_that_cannot_be_reached_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = ["study", "wls", "--quick", "--out", str(tmp_path / "out"), "--cluster"]
    assert "no scheduler answers" in _refused(capsys, *study, "tcp://127.0.0.1:1")
    assert "no address" in _refused(capsys, *study, "localhost")
    assert "no such cluster's file" in _refused(capsys, *study, str(tmp_path / "slurm.toml"))
    assert "--cluster" in _refused(capsys, *study[:-1], "--store", "s3://bucket/place")
    assert "no scheduler answers" in _refused(capsys, "worker", "tcp://127.0.0.1:1", "--patience", "0")


def test_a_scheduler_without_workers_is_told(cluster: Cluster, tmp_path: Path) -> None:
    with pytest.raises(TestfieldError, match=r"no workers.*testfield worker"):  # noqa: SIM117
        with opened(cluster.address, None, tmp_path, patience_s=0.1):
            pass


def test_a_store_that_refuses_writes_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    refuses = module.Objects(str(tmp_path / "file/below"))
    with pytest.raises(OSError):
        refuses.check()

    def full() -> None:
        raise OSError(28, "No space left on device", "cases/x.parquet")

    with pytest.raises(TestfieldError, match="disk is full") as said:
        told(full)
    assert "worker" in said.value.where


def test_without_the_extra_a_sentence_names_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    for words in (["worker", "tcp://h:1"], ["study", "wls", "--out", str(tmp_path / "o"), "--cluster", "tcp://h:1"]):
        assert "testfield[cluster]" in _refused(capsys, *words)
