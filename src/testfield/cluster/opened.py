"""What `--cluster` names, opened: a pool over a scheduler that runs, or over jobs of a batch system."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

from testfield.cluster.batch_file import BatchFile
from testfield.cluster.dask_pool import CONNECT_S, DaskPool
from testfield.cluster.extra import needed, silence
from testfield.errors import TestfieldError
from testfield.store.objects import Objects

PATIENCE_S = 60.0
"""How long a scheduler that was named, or all of its workers, may be away."""
PROTOCOLS = ("tcp://", "tls://", "ucx://", "ws://", "wss://")


@contextmanager
def opened(where: str, store: str | None, folder: Path, patience_s: float = PATIENCE_S) -> Iterator[DaskPool]:
    """A pool over the cluster `where` (tcp://host:port, or a cluster's file), all of whose workers have this program
    and may write into `store`, by default `folder`.

    Raises `TestfieldError` where the cluster cannot be reached, has no workers, or others than these.
    """
    distributed = needed("distributed")
    silence()
    if where.startswith(PROTOCOLS):
        yield from _over(lambda: _client(distributed, where), where, store, folder, patience_s)
        return
    if not where.endswith(".toml"):
        raise TestfieldError(
            f"'{where}' is no address and no file", "--cluster", "give tcp://host:port, or a file like slurm.toml"
        )
    asked = BatchFile.load(Path(where))
    try:
        with catch_warnings():
            simplefilter("ignore", UserWarning)  # of a dashboard on another port than the usual one
            cluster = asked.cluster()
    except (OSError, ValueError, RuntimeError) as error:
        raise TestfieldError(f"no scheduler can be begun here ({error})", where, "mend it") from error
    with cluster:
        # Jobs whose time is over are replaced.
        cluster.adapt(minimum_jobs=asked.jobs, maximum_jobs=asked.jobs)
        yield from _over(
            lambda: _client(distributed, cluster), where, store or asked.store, folder, 60 * asked.patience_min
        )


def _over(connect: Any, where: str, store: str | None, folder: Path, patience_s: float) -> Iterator[DaskPool]:
    place = Objects(store) if store else None
    pool = DaskPool(connect, place, patience_s, where)
    try:
        pool.check(place or Objects(str(folder.resolve())))
        yield pool
    finally:
        pool.close()


def _client(distributed: Any, address: Any) -> Any:
    try:
        return distributed.Client(address, timeout=CONNECT_S, set_as_default=False, name="testfield")
    except ValueError as error:
        raise TestfieldError(f"this is no address ({error})", str(address), "give tcp://host:port") from error
