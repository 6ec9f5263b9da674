"""A table of cases is done: kept, resumable, in as many processes as asked for, on this machine or on many.

Cases of the same scene share a run's folder, and with it every stage that one of them has made; they are done by one
process, one after the other, so that nothing is made twice; only draws of noise, which leave the folder as it is, are
given to several. What a case found is kept in a file of its own, under the
digest of the case and of the code it was measured with: after a kill, the next call does what is missing.
"""

import shutil
import time
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from testfield.chain.progress import bar
from testfield.chain.run import Run, begin
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.evaluate.cost import say_cost
from testfield.evaluate.failures import FAILURE
from testfield.evaluate.kept_rows import Found, KeptRows, Reader
from testfield.evaluate.keys import case_key, file_digests
from testfield.evaluate.travel import packed, scratch_of, unpacked
from testfield.store.atomic import whole
from testfield.store.digests import digest
from testfield.store.objects import Objects
from testfield.store.text import write_text
from testfield.store.work import Pool, each

BATCHES = 16
"""So many batches of cases without a scene go to each process of a cluster, so that all end at about the same time."""
LARGEST_BATCH = 50
"""Cases in a batch at most: what the scheduler is asked for each must be little beside the work."""


def execute(
    cases: list[Case],
    folder: Path,
    jobs: int = 1,
    title: str = "cases",
    so_far: bool = False,
    pool: Pool | None = None,
) -> pd.DataFrame:
    """All cases' rows, in the order of the cases, labels first; written to `folder`/results.parquet too.

    They are done by `jobs` processes of this machine, or by a `pool` whose workers see the same folder (a client of
    Dask is one), or the pool's own `store`, where it has one. With `so_far` nothing is done any more: the rows are
    those of the cases that are finished.

    A case that fails with a `TestfieldError`, or on a singular matrix, gives one row that says why under `failure`; it
    is tried again by the next call. Any other error ends the work, with all finished cases kept. Raises
    `TestfieldError` where a case occurs twice.
    """
    at = _Place.of(folder, pool)
    keys = [case_key(case) for case in cases]
    kept = list(at.kept.read_all(keys))
    if so_far:
        there = [k for k, found in enumerate(kept) if found is not None]
        cases, keys, kept = [cases[k] for k in there], [keys[k] for k in there], [kept[k] for k in there]
    repeated = len(keys) - len(set(keys))
    if repeated:
        raise TestfieldError(f"{repeated} case(s) occur twice", str(folder), "give each case labels of its own")
    missing = [k for k, found in enumerate(kept) if found is None]
    with Reader(at.kept) as reader:
        failed = _do(missing, cases, keys, kept, at, jobs, title, pool, reader) if missing else {}
        kept = [
            reader.take(key) if found is None and key not in failed else found
            for key, found in zip(keys, kept, strict=True)
        ]
    tables = []
    for case, key, found in zip(cases, keys, kept, strict=True):
        if key in failed:
            rows = pd.DataFrame([{FAILURE: failed[key]}])
        else:
            if found is None:
                raise TestfieldError(
                    "the rows of a finished case have gone", f"{at.kept.place.where}/{at.kept.file(key)}", "go on"
                )
            rows = found.rows
        own = {name: value for name, value in case.labels.items() if name not in rows}
        tables.append(pd.concat([pd.DataFrame(own, index=rows.index), rows], axis=1))
    table = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    with whole(folder / "results.parquet") as path:
        table.to_parquet(path, index=False)
    return table


def finished(cases: list[Case], folder: Path, pool: Pool | None = None) -> list[Case]:
    """Those of the cases whose rows are kept in a folder, or in a pool's own store."""
    kept = _Place.of(folder, pool).kept
    found = kept.read_all([case_key(case) for case in cases])
    return [case for case, rows in zip(cases, found, strict=True) if rows is not None]


@dataclass(frozen=True)
class _Place:
    """Where cases are done: runs below `folder` (None: each process has a folder of its own, because nobody else sees
    the parent's), rows in `kept`; `away` from this process' own children, where code may differ and work may be given
    twice."""

    folder: Path | None
    kept: KeptRows
    away: bool

    @staticmethod
    def of(folder: Path, pool: Pool | None) -> "_Place":
        folder = folder.resolve()  # others work elsewhere
        store = getattr(pool, "store", None) or Objects(str(folder))
        shared = folder if getattr(pool, "store", None) is None else store.folder
        return _Place(shared, KeptRows(store), hasattr(pool, "processes"))


def run_name(case: Case) -> str | None:
    """The name of the run's folder that a case shares with all others that see the same images: how a scene is
    measured does not count."""
    if case.scene is None:
        return None
    files = file_digests(case)
    seen = {name: part for name, part in case.scene.items() if name != "measure"}
    return digest(seen, *([files] if files else []))[:16]


def do_case(case: Case, folder: Path) -> list[dict[str, Any]]:
    """The rows of one case, its scene laid out below `folder`."""
    module, _, name = case.work.partition(":")
    return getattr(import_module(module), name)(case, None if case.scene is None else run_of(case, folder))


def _do(
    missing: list[int],
    cases: list[Case],
    keys: list[str],
    found: list[Found | None],
    at: _Place,
    jobs: int,
    title: str,
    pool: Pool | None,
    reader: Reader,
) -> dict[str, str]:
    """Do those cases that are missing and keep their rows; why cases failed, by key. A `reader` hears of each."""
    there = at.kept.list()
    for key in (keys[k] for k in missing if at.kept.file(keys[k]).rpartition("/")[2] in there):
        at.kept.remove(key)  # what is there cannot be read
    failed: dict[str, str] = {}
    processes = getattr(pool, "processes", lambda: jobs)()
    say_cost(title, cases, found, processes)
    total, before = sum(case.weight for case in cases), sum(cases[k].weight for k in range(len(cases)) if found[k])
    todo = [cases[k] for k in missing]
    # Draws of one scene go to several processes only where all of them see its folder.
    apart = processes if at.folder is not None and (pool is None or at.away) else 1
    with bar(title, total, "cases" if total == len(cases) else "units", before) as move:
        for groups in _phases(todo, apart):
            groups = _batched(groups, todo, processes) if at.away else groups
            order = [k for group in groups for k in group]
            place = {k: number for number, k in enumerate(order)}
            of = [missing[k] for k in order]

            def moved(number: int, of: list[int] = of) -> None:
                move(cases[of[number]].weight)
                if at.away:  # this process has nothing else to do
                    reader.ask(keys[of[number]])

            reasons = each(
                partial(_try, at=at),
                [(_sent(cases[k], at), keys[k]) for k in of],
                jobs,
                pool=pool,
                groups=[[place[k] for k in group] for group in groups],
                # A group may work for an hour, so what it has finished is seen from the files it leaves.
                kept=lambda number, of=of: at.kept.seen(keys[of[number]]),  # type: ignore[misc]
                moved=moved,
            )
            failed |= {keys[k]: reason for k, reason in zip(of, reasons, strict=True) if reason}
    return failed


def _sent(case: Case, at: _Place) -> Case:
    """A case as other processes get it."""
    if at.folder is None:
        return packed(case, at.kept.place)
    return case if case.folder is None else replace(case, folder=case.folder.resolve())


def _batched(groups: list[list[int]], todo: list[Case], processes: int) -> list[list[int]]:
    """Groups of cases by number, those of cases that share nothing, because they have no scene, put together."""
    alone = [k for group in groups for k in group if todo[k].scene is None]
    size = min(max(len(alone) // (BATCHES * max(processes, 1)), 1), LARGEST_BATCH)
    batches = [alone[k : k + size] for k in range(0, len(alone), size)]
    return [group for group in groups if todo[group[0]].scene is not None] + batches


def _phases(todo: list[Case], jobs: int) -> list[list[list[int]]]:
    """Groups of cases by number, one phase after the other; a process does the cases of a group in their order.

    A group is what shares a run's folder, so that nothing is made twice. Where that leaves processes without work, the
    first draw of noise of each scene comes first, and makes what all share; then each further draw is a group.
    """
    groups: dict[str, list[int]] = {}
    for k, case in enumerate(todo):
        groups.setdefault(run_name(case) or f"case {k}", []).append(k)
    if len(groups) >= jobs:
        return [list(groups.values())]
    opening, draws = [], []
    for group in groups.values():
        seeds = dict.fromkeys(todo[k].noise_seed for k in group if todo[k].noise_seed is not None)
        first = {None, next(iter(seeds), None)}
        opening.append([k for k in group if todo[k].noise_seed in first])
        draws += [[k for k in group if todo[k].noise_seed == seed] for seed in seeds if seed not in first]
    return [opening, draws] if draws else [opening]


def run_of(case: Case, folder: Path) -> Run:
    """The run of a case's scene, laid out below `folder`. The last one is kept in memory, for the next case has most
    often the same."""
    global _last
    place = folder / "runs" / str(run_name(case))
    key = digest(case.scene, place)
    if _last is not None and _last[0] == key and (place / "scene.toml").is_file():
        return _last[1]
    for name, source in case.files.items():
        if not (place / name).is_file():
            with whole(place / name) as path:
                shutil.copyfile(source, path)
    with whole(place / "case.toml") as path:
        write_text(path, tomli_w.dumps(case.scene or {}))
    run, _ = begin(place / "case.toml", place, None, 1)
    _last = key, run
    return run


_last: tuple[str, Run] | None = None


def _try(item: tuple[Case, str], at: _Place) -> str | None:
    """Do a case and keep its rows under its key; why it failed, or None. Raises `TestfieldError` where this process
    would measure it with other code than its parent's."""
    case, key = item
    if at.away and at.kept.there(key):
        return None  # by a process that was lost before it could tell
    folder = at.folder
    if folder is None:
        folder = scratch_of(run_name(case))
        case = unpacked(case, at.kept.place, folder)
    if at.away and case_key(case) != key:
        raise TestfieldError(
            f"this worker has other code than the program for '{case.work}' or an algorithm it uses",
            "",
            "install the same versions of the program, its packages and your own there",
        )
    begun = time.perf_counter()
    try:
        rows = do_case(case, folder)
    except TestfieldError as error:
        return error.sentence()
    except np.linalg.LinAlgError as error:
        return f"linear algebra gave up: {error}"
    at.kept.write(key, rows, time.perf_counter() - begun)
    return None
