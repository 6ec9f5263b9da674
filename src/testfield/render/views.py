"""Fast images of several stations in turn, so that neither the device nor the processor waits for the other.

While rays are cast for one station, a thread beside follows the outlines that the next one sees, and blurs and keeps
the image of the one before. Dr.Jit is asked by one thread alone.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

import numpy as np

from testfield.camera.images import Radiance
from testfield.render.bounce import flash_bounce
from testfield.render.fast import outlined, traced
from testfield.render.irradiance import Irradiance
from testfield.render.stage import Stage

Kept = TypeVar("Kept")


def fast_views(
    stage: Stage,
    light: Irradiance,
    stations: Sequence[int],
    seeds: Sequence[int],
    cells: int,
    blur_shots: int,
    keep: Callable[[Radiance], Kept],
    progress: Callable[[float], None] = lambda _: None,
) -> Iterator[Kept]:
    """What `keep` makes of each station's image, one after the other; images as `render_fast` renders them.

    `seeds` are those of the flash's indirect light at each station; `progress` is told the part of an image done since
    the last call. `keep` is called by the thread beside. No more than two images are in memory.
    """
    world, size = stage.world, (stage.world.interior.height_px, stage.world.interior.width_px)
    outline = partial(outlined, world, light.direct, cells=cells, blur_shots=blur_shots)
    with _beside() as beside:
        coming = beside.submit(outline, stations[0])
        before: Future[Kept] | None = None
        for station, following, seed in zip(stations, [*stations[1:], None], seeds, strict=True):
            seen = coming.result()
            if following is not None:
                coming = beside.submit(outline, following)
            values = np.empty(size, np.float32)
            blurring: list[Future] = []
            for strip in traced(stage, light, station, seen, flash_bounce(world, station, seed)):
                if blurring:
                    blurring.pop().result()  # cells take room: no more than one strip of them waits
                blurring.append(beside.submit(strip.blur_into, values))
                progress(len(strip) / len(values))
            last = beside.submit(_finish, keep, world.station_name[station], values, blurring)
            if before is not None:
                yield before.result()
            before = last
        if before is not None:
            yield before.result()


def _finish(keep: Callable[[Radiance], Kept], name: str, values: np.ndarray, blurring: list[Future]) -> Kept:
    for blur in blurring:
        blur.result()  # has ended, for the thread does one thing after another; raises what it raised
    values[values < 0] = 0  # what rounding of the blur's sums leaves of black beside light
    return keep(Radiance(name, values))


@contextmanager
def _beside() -> Iterator[ThreadPoolExecutor]:
    """One thread, which drops what it has not begun where the block ends in an exception."""
    with ThreadPoolExecutor(1, "beside") as thread:
        try:
            yield thread
        except BaseException:
            thread.shutdown(wait=False, cancel_futures=True)
            raise
