"""The one function that does all studies' cases: cached, resumable, in as many processes as asked for.

Cases of the same scene share a run's folder, and with it every stage that one of them has made; they are done by one
process, one after the other, so that nothing is made twice. What a case found is kept in a file of its own, under the
digest of the case and of the code it was measured with: after a kill, the next call does what is missing.
"""

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from importlib import import_module
from multiprocessing.synchronize import Event
from pathlib import Path
from time import sleep
from typing import Any, Protocol

import numpy as np
import pandas as pd
import tomli_w

from testfield.chain.code import code_digest, package_version
from testfield.chain.progress import bar
from testfield.chain.run import Run, begin
from testfield.errors import TestfieldError
from testfield.registry import own_modules
from testfield.store.atomic import whole
from testfield.store.digests import digest
from testfield.store.pool import SPAWN, process_pool
from testfield.store.text import write_text
from testfield.study.cases import Case

FAILURE = "failure"
"""The column that says why a case gave no figures."""


class Pool(Protocol):
    """Where work runs: of `concurrent.futures`, and of Dask's client, only this is used."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """A future of the function's result."""


def run_cases(
    cases: list[Case], folder: Path, jobs: int = 1, title: str = "cases", so_far: bool = False
) -> pd.DataFrame:
    """All cases' rows, in the order of the cases, labels first; written to `folder`/results.parquet too.

    With `so_far` nothing is done any more: the rows are those of the cases that are finished.

    A case that fails with a `TestfieldError`, or on a singular matrix, gives one row that says why under `failure`; it
    is tried again by the next call. Any other error ends the study, with all finished cases kept.
    """
    keys = [case_key(case) for case in cases]
    kept = [_kept(folder, key) for key in keys]
    if so_far:
        there = [k for k, rows in enumerate(kept) if rows is not None]
        cases, keys, kept = [cases[k] for k in there], [keys[k] for k in there], [kept[k] for k in there]
    repeated = len(keys) - len(set(keys))
    if repeated:
        raise TestfieldError(f"{repeated} case(s) occur twice", str(folder), "give each case labels of its own")
    todo: dict[str, list[int]] = {}
    for k, case in enumerate(cases):
        if kept[k] is None:
            _file(folder, keys[k]).unlink(missing_ok=True)  # what is there cannot be read
            todo.setdefault(run_name(case) or f"case {k}", []).append(k)
    failed: dict[int, str] = {}
    total = sum(case.weight for case in cases)
    missing = {k for places in todo.values() for k in places}
    with bar(title, total, "cases" if total == len(cases) else "units") as move:
        move(total - sum(cases[k].weight for k in missing))
        for k, reason in _done(list(todo.values()), cases, keys, folder, jobs):
            move(cases[k].weight)
            if reason:
                failed[k] = reason
    tables = []
    for k, case in enumerate(cases):
        found = pd.DataFrame([{FAILURE: failed[k]}]) if k in failed else kept[k]
        found = pd.read_parquet(_file(folder, keys[k])) if found is None else found
        own = {name: value for name, value in case.labels.items() if name not in found}
        tables.append(pd.concat([pd.DataFrame(own, index=found.index), found], axis=1))
    table = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    with whole(folder / "results.parquet") as path:
        table.to_parquet(path, index=False)
    return table


def finished(cases: list[Case], folder: Path) -> list[Case]:
    """Those of the cases whose rows are kept in a folder."""
    return [case for case in cases if _kept(folder, case_key(case)) is not None]


def case_key(case: Case) -> str:
    """Digest of all that a case's rows depend on.

    Algorithms found by name at run time count, whichever the case uses, and so does what renders. Pages and
    certificates do not: no row comes from them.
    """
    modules = (case.work.partition(":")[0], *own_modules())
    code = code_digest(*modules, without=("testfield.report", "testfield.certify"))
    device = os.environ.get("TESTFIELD_VARIANT", "") + os.environ.get("TESTFIELD_LLVM_TARGET", "")
    outside = (device, package_version("pycolmap"))
    return digest(case.labels, case.work, case.scene, case.options, code, outside)


def run_name(case: Case) -> str | None:
    """The name of the run's folder that a case shares with all others of its scene."""
    return None if case.scene is None else digest(case.scene)[:16]


def do_case(case: Case, folder: Path) -> list[dict[str, Any]]:
    """The rows of one case, its scene laid out below `folder`."""
    module, _, name = case.work.partition(":")
    return getattr(import_module(module), name)(case, None if case.scene is None else _run(case, folder))


def _run(case: Case, folder: Path) -> Run:
    place = folder / "runs" / str(run_name(case))
    with whole(place / "case.toml") as path:
        write_text(path, tomli_w.dumps(case.scene or {}))
    run, _ = begin(place / "case.toml", place, None, 1)
    return run


def _try(case: Case, key: str, folder: Path) -> str | None:
    """Do a case and keep its rows; why it failed, or None."""
    try:
        rows = do_case(case, folder)
    except TestfieldError as error:
        return error.sentence()
    except np.linalg.LinAlgError as error:
        return f"linear algebra gave up: {error}"
    with whole(_file(folder, key)) as path:
        pd.DataFrame(rows).to_parquet(path, index=False)
    return None


def _group(cases: list[Case], keys: list[str], folder: Path) -> dict[str, str | None]:
    """Do cases that share a run, in a process of the pool; by key, why each failed or None."""
    reasons: dict[str, str | None] = {}
    for case, key in zip(cases, keys, strict=True):
        if _end is not None and _end.is_set():
            sys.exit()  # nobody waits for the rest
        reasons[key] = _try(case, key, folder)
    return reasons


def _done(
    groups: list[list[int]], cases: list[Case], keys: list[str], folder: Path, jobs: int
) -> Iterator[tuple[int, str | None]]:
    """Cases by number as they are done, with the reason of one that failed.

    A group may work for an hour, so what it has finished is seen from the files it leaves.
    """
    if jobs <= 1 or len(groups) <= 1:
        for k in (k for places in groups for k in places):
            yield k, _try(cases[k], keys[k], folder)
        return
    with local_pool(jobs) as pool:
        left: dict[Future, list[int]] = {
            pool.submit(_group, [cases[k] for k in places], [keys[k] for k in places], folder): places
            for places in groups
        }
        while left:
            sleep(LOOK_S)
            for future in list(left):
                reasons = future.result() if future.done() else {}
                for k in [k for k in left[future] if keys[k] in reasons or _file(folder, keys[k]).is_file()]:
                    left[future].remove(k)
                    yield k, reasons.get(keys[k])
                if not left[future]:
                    del left[future]


@contextmanager
def local_pool(jobs: int) -> Iterator[Pool]:
    """Processes on this machine, one thread each; an interrupt is the parent's to handle: they finish their cases."""
    end = SPAWN.Event()
    with process_pool(jobs, _start, (end,)) as pool:
        try:
            yield pool
        except BaseException:
            end.set()
            raise


LOOK_S = 0.3


_end: Event | None = None
"""In a process of the pool: set when it is to stop after the case at hand."""


def _start(end: Event) -> None:
    global _end
    _end = end
    os.environ["TQDM_DISABLE"] = "1"


def _kept(folder: Path, key: str) -> pd.DataFrame | None:
    """The rows that are kept of a case, or None where there are none that can be read."""
    path = _file(folder, key)
    try:
        return pd.read_parquet(path) if path.is_file() else None
    except (OSError, ValueError):
        return None


def _file(folder: Path, key: str) -> Path:
    return folder / "cases" / f"{key[:32]}.parquet"
