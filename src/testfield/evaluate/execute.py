"""A table of cases is done: kept, resumable, in as many processes as asked for.

Cases of the same scene share a run's folder, and with it every stage that one of them has made; they are done by one
process, one after the other, so that nothing is made twice; only draws of noise, which leave the folder as it is, are
given to several. What a case found is kept in a file of its own, under the
digest of the case and of the code it was measured with: after a kill, the next call does what is missing.
"""

import shutil
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
from testfield.evaluate.failures import FAILURE
from testfield.evaluate.keys import case_key, file_digests
from testfield.store.atomic import whole
from testfield.store.digests import digest
from testfield.store.text import write_text
from testfield.store.work import Pool, each


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
    Dask is one). With `so_far` nothing is done any more: the rows are those of the cases that are finished.

    A case that fails with a `TestfieldError`, or on a singular matrix, gives one row that says why under `failure`; it
    is tried again by the next call. Any other error ends the work, with all finished cases kept. Raises
    `TestfieldError` where a case occurs twice.
    """
    keys = [case_key(case) for case in cases]
    kept = [_kept(folder, key) for key in keys]
    if so_far:
        there = [k for k, rows in enumerate(kept) if rows is not None]
        cases, keys, kept = [cases[k] for k in there], [keys[k] for k in there], [kept[k] for k in there]
    repeated = len(keys) - len(set(keys))
    if repeated:
        raise TestfieldError(f"{repeated} case(s) occur twice", str(folder), "give each case labels of its own")
    missing = [k for k, rows in enumerate(kept) if rows is None]
    failed = _do([cases[k] for k in missing], [keys[k] for k in missing], cases, folder, jobs, title, pool)
    tables = []
    for case, key, found in zip(cases, keys, kept, strict=True):
        rows = pd.DataFrame([{FAILURE: failed[key]}]) if key in failed else found
        rows = pd.read_parquet(_file(folder, key)) if rows is None else rows
        own = {name: value for name, value in case.labels.items() if name not in rows}
        tables.append(pd.concat([pd.DataFrame(own, index=rows.index), rows], axis=1))
    table = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    with whole(folder / "results.parquet") as path:
        table.to_parquet(path, index=False)
    return table


def finished(cases: list[Case], folder: Path) -> list[Case]:
    """Those of the cases whose rows are kept in a folder."""
    return [case for case in cases if _kept(folder, case_key(case)) is not None]


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
    todo: list[Case], keys: list[str], all_cases: list[Case], folder: Path, jobs: int, title: str, pool: Pool | None
) -> dict[str, str]:
    """Do what is missing of all cases and keep its rows; why cases failed, by key."""
    for key in keys:
        _file(folder, key).unlink(missing_ok=True)  # what is there cannot be read
    failed: dict[str, str] = {}
    total = sum(case.weight for case in all_cases)
    with bar(title, total, "cases" if total == len(all_cases) else "units") as move:
        move(total - sum(case.weight for case in todo))
        for groups in _phases(todo, jobs if pool is None else 1):
            at = [k for group in groups for k in group]
            place = {k: number for number, k in enumerate(at)}
            reasons = each(
                partial(_try, folder=folder),
                [(todo[k], keys[k]) for k in at],
                jobs,
                pool=pool,
                groups=[[place[k] for k in group] for group in groups],
                # A group may work for an hour, so what it has finished is seen from the files it leaves.
                kept=lambda number, at=at: _file(folder, keys[at[number]]).is_file(),  # type: ignore[misc]
                moved=lambda number, at=at: move(todo[at[number]].weight),  # type: ignore[misc]
            )
            failed |= {keys[k]: reason for k, reason in zip(at, reasons, strict=True) if reason}
    return failed


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


def _try(item: tuple[Case, str], folder: Path) -> str | None:
    """Do a case and keep its rows under its key; why it failed, or None."""
    case, key = item
    try:
        rows = do_case(case, folder)
    except TestfieldError as error:
        return error.sentence()
    except np.linalg.LinAlgError as error:
        return f"linear algebra gave up: {error}"
    with whole(_file(folder, key)) as path:
        pd.DataFrame(rows).to_parquet(path, index=False)
    return None


def _kept(folder: Path, key: str) -> pd.DataFrame | None:
    """The rows that are kept of a case, or None where there are none that can be read."""
    path = _file(folder, key)
    try:
        return pd.read_parquet(path) if path.is_file() else None
    except (OSError, ValueError):
        return None


def _file(folder: Path, key: str) -> Path:
    return folder / "cases" / f"{key[:32]}.parquet"
