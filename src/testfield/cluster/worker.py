"""Processes of this machine that serve a scheduler, and find it again when it has been away."""

import asyncio
import os
import sys
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

from testfield.cluster.extra import needed, silence
from testfield.errors import TestfieldError

CONNECT_S = 2.0
CHILDREN = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "DASK_LOGGING__DISTRIBUTED": "critical",
}
"""What processes inherit. Together they fill the cores, and sums do not depend on the number of threads; Dask speaks of
every connection, and what matters of it the parent says in a sentence."""


def serve(address: str, processes: int, memory_gb: float | None, scratch: Path | None, patience_s: float) -> None:
    """Serve a scheduler until it has been away for `patience_s`; processes that are ended from outside are begun again.

    Raises `TestfieldError` where it could never be reached.
    """
    os.environ.update(CHILDREN)
    needed("distributed")
    silence()
    asyncio.run(_serve(address, processes, memory_gb, scratch, patience_s))


async def _serve(
    address: str, processes: int, memory_gb: float | None, scratch: Path | None, patience_s: float
) -> None:
    seen, last = False, time.monotonic()
    while True:
        if await _reachable(address):
            try:
                seen = await _stay(address, processes, memory_gb, scratch) or seen
                last = time.monotonic()
            except (OSError, TimeoutError, RuntimeError):
                pass  # it has gone while processes began
        if time.monotonic() - last > patience_s:
            if not seen:
                raise TestfieldError(
                    "no scheduler answers there", address, "start one with `dask scheduler`, or check host and port"
                )
            _say(f"{address} has gone")
            return
        await asyncio.sleep(0.5)


async def _reachable(address: str) -> bool:
    distributed = needed("distributed")
    try:
        certificates = distributed.Security().get_connection_args("worker")  # as Dask's configuration names them
        comm = await distributed.comm.connect(address, timeout=CONNECT_S, **certificates)
    except (OSError, TimeoutError):
        return False
    except ValueError as error:
        raise TestfieldError(f"this is no address ({error})", address, "give tcp://host:port") from error
    comm.abort()
    return True


async def _stay(address: str, processes: int, memory_gb: float | None, scratch: Path | None) -> bool:
    """Begin processes, and wait until the scheduler sends them away or has gone."""
    nanny: Any = needed("distributed").Nanny
    # Dask has them give freed memory back at once, and arrays are asked for anew: a third of the time of a calibration.
    needed("dask").config.set({"distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None})
    limit = "auto" if memory_gb is None else f"{memory_gb:g}GB"
    async with AsyncExitStack() as stack:
        begun = [
            nanny(
                address,
                nthreads=1,
                memory_limit=limit,
                local_directory=None if scratch is None else str(scratch),
                death_timeout=10 * CONNECT_S,
            )
            for _ in range(processes)
        ]
        for one in await asyncio.gather(*begun):
            stack.push_async_callback(one.close, timeout=2)
        _say(f"{processes} processes serve {address}" if processes > 1 else f"one process serves {address}")
        await asyncio.gather(*(one.finished() for one in begun))
    return True


def _say(what: str) -> None:
    print(f"worker: {what}", file=sys.stderr, flush=True)
