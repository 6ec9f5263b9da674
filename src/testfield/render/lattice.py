"""Smooth light of all pixels from rays through a few: between them it is straight, or each pixel gets its own.

That no edge passes is known beforehand (`edges.py`); how much the light bows between nodes, they tell themselves. The
direct light has kinks where its own nodes are, and a penumbra is steep: there every pixel gets a ray.
"""

from collections.abc import Callable

import cv2
import numpy as np

from testfield.store.compiled import compiled

STEP_PX = 4
BOW = 2e-5
"""Second difference from node to node, as a part of the light there. Between nodes the light is off by an eighth of it
where it bows evenly, by a half at a kink: 1e-5 at most, little more than what float32 makes of a ray's way."""


def smooth_pixels(seen: Callable[[np.ndarray, np.ndarray], np.ndarray], crossed: np.ndarray) -> np.ndarray:
    """(rows, columns) float32 radiance in the middles of pixels, 0 where an edge has `crossed` them.

    `seen` tells the radiance (k,) at rows and columns (k,) of this image.
    """
    values = np.zeros(crossed.shape, np.float32)
    rows, columns = (np.arange(0, size, STEP_PX) for size in crossed.shape)
    own = ~crossed
    free = ~_any_within(crossed)[: len(rows) - 1, : len(columns) - 1]
    if free.any() and len(rows) > 2 and len(columns) > 2:
        nodes = seen(np.repeat(rows, len(columns)), np.tile(columns, len(rows))).reshape(len(rows), len(columns))
        even = _even(nodes) & free
        _between(values, nodes, even, STEP_PX)
        covered = np.repeat(np.repeat(even, STEP_PX, axis=0), STEP_PX, axis=1)
        own[: covered.shape[0], : covered.shape[1]] &= ~covered
    row, column = np.nonzero(own)
    values[row, column] = seen(row, column)
    return values


def _any_within(crossed: np.ndarray) -> np.ndarray:
    """Whether of the squares between nodes, their own rows and columns with them, any pixel is crossed."""
    kernel = np.ones((STEP_PX + 1, STEP_PX + 1), np.uint8)
    around = cv2.dilate(crossed.view(np.uint8), kernel, anchor=(0, 0))
    return np.asarray(around[::STEP_PX, ::STEP_PX] > 0)


def _even(nodes: np.ndarray) -> np.ndarray:
    """Of the squares between nodes (m, n), whether the light is even at all four corners: (m - 1, n - 1)."""
    even = np.zeros(nodes.shape, bool)
    down, along = (np.abs(np.diff(nodes, 2, axis=k)) for k in (0, 1))
    even[1:-1, 1:-1] = np.maximum(down[:, 1:-1], along[1:-1]) <= BOW * nodes[1:-1, 1:-1]
    both = even[1:] & even[:-1]
    return np.asarray(both[:, 1:] & both[:, :-1])


@compiled
def _between(values: np.ndarray, nodes: np.ndarray, even: np.ndarray, step: int) -> None:
    """Fill the even squares with what is straight between their corners."""
    part = np.arange(step).astype(np.float32) / np.float32(step)
    for i in range(even.shape[0]):
        for j in range(even.shape[1]):
            if not even[i, j]:
                continue
            for a in range(step):
                left = nodes[i, j] + part[a] * (nodes[i + 1, j] - nodes[i, j])
                right = nodes[i, j + 1] + part[a] * (nodes[i + 1, j + 1] - nodes[i, j + 1])
                for b in range(step):
                    values[i * step + a, j * step + b] = left + part[b] * (right - left)
