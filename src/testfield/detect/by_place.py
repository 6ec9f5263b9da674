"""Many spots of one image, looked at in the order in which they lie there."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

THREADS, LEAST_FOR_THREADS = 2, 128
TILE_PX = 128
"""Height of the strips of the image that are gone through one behind the other, each from left to right."""


def by_place(act: Callable[..., np.ndarray], xy_px: np.ndarray, *of_each: np.ndarray) -> np.ndarray:
    """What `act(xy_px, *of_each)` says of n spots, n rows of each argument and of the answer.

    Neighbours are looked at one after the other: pixels that both need are then still in the processor's cache. Many
    are shared out among threads, which pays for acts that let go of the interpreter.
    """
    n = len(xy_px)
    order = np.lexsort((xy_px[:, 0], np.floor(xy_px[:, 1] / TILE_PX)))
    arguments = [np.ascontiguousarray(values[order], float) for values in (xy_px, *of_each)]
    if n < LEAST_FOR_THREADS:
        answers = [act(*arguments)]
    else:
        with ThreadPoolExecutor(THREADS) as pool:
            answers = list(pool.map(act, *(np.array_split(values, THREADS) for values in arguments)))
    answer = np.empty((n, *answers[0].shape[1:]), answers[0].dtype)
    answer[order] = np.concatenate(answers)
    return answer
