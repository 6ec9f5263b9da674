"""Many workers in one process, which do nothing that takes time: `python -m testfield.bench.idle_workers ADDRESS N`.

A scheduler is as busy with them as with workers on as many machines.
"""

import asyncio
import sys

AT_ONCE = 25


async def idle(address: str, count: int) -> None:
    """Serve a scheduler until it has gone."""
    from distributed import Worker

    workers: list[Worker] = []
    while len(workers) < count:
        begun = min(AT_ONCE, count - len(workers))
        workers += await asyncio.gather(
            *(Worker(address, nthreads=1, memory_limit=0, dashboard=False) for _ in range(begun))
        )
    await asyncio.gather(*(one.finished() for one in workers))


if __name__ == "__main__":
    asyncio.run(idle(sys.argv[1], int(sys.argv[2])))
