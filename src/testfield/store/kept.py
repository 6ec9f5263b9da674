"""Files of a ledger that several processes make: workers write parts, the process that keeps the ledger places them."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from testfield.store.atomic import part_path
from testfield.store.ledger import Ledger
from testfield.store.work import Pool, as_done


def make_each(
    ledger: Ledger,
    files: Sequence[tuple[str, str]],
    write: Callable[[int, Path], None],
    jobs: int = 1,
    moved: Callable[[int], None] = lambda _: None,
    pool: Pool | None = None,
) -> int:
    """Have `write` make each file, given its number, that is not fresh; returns how many were made.

    `files` are names in the ledger's folder and keys. Each is entered as soon as it is made, so a worker that is killed
    or an interrupt loses only the files at hand. `moved` hears the number of each file, also of a fresh one. With
    several `jobs`, or a `pool` whose workers see the ledger's folder, the function goes to other processes, so it is
    one of a module. Raises as `Ledger.place` does.
    """
    missing = []
    for number, (name, key) in enumerate(files):
        if ledger.fresh(name, key):
            moved(number)
        else:
            missing.append(number)
    folder = ledger.folder if pool is None else ledger.folder.resolve()
    targets = [(number, folder / files[number][0]) for number in missing]
    for k, part in as_done(partial(_write_part, write), targets, jobs, pool=pool):
        name, key = files[missing[k]]
        try:
            ledger.place({name: part}, key)
        finally:
            part.unlink(missing_ok=True)
        moved(missing[k])
    return len(missing)


def _write_part(write: Callable[[int, Path], None], wanted: tuple[int, Path]) -> Path:
    number, target = wanted
    part = part_path(target)
    part.parent.mkdir(parents=True, exist_ok=True)
    try:
        write(number, part)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return part
