"""What differs from pixel to pixel and stays the same from frame to frame."""

from functools import lru_cache
from typing import Literal

import numpy as np

from testfield.seeds import Plane

BayerOrder = Literal["RGGB", "BGGR", "GRBG", "GBRG"]


@lru_cache(maxsize=2)
def gain_pattern(shape: tuple[int, int], prnu: float, seed: int) -> np.ndarray:
    """Each pixel's response to light relative to the mean: (h, w), white, mean 1, standard deviation `prnu`.

    EMVA 1288 release 4.0 linear, photo response nonuniformity. No pixel's response is negative. Each pixel has its own:
    a sensor of more rows or columns has the same where the two overlap. Kept, since every frame asks for it: read only.
    """
    return _kept(np.maximum(1 + prnu * Plane(seed, "sensor/prnu").normals(range(shape[0]), shape[1]), 0))


@lru_cache(maxsize=2)
def offset_pattern_e(shape: tuple[int, int], dsnu_e: float, seed: int) -> np.ndarray:
    """Each pixel's dark offset from the mean in electrons: (h, w), white, mean 0, standard deviation `dsnu_e`.

    EMVA 1288 release 4.0 linear, dark signal nonuniformity. As `gain_pattern`, each pixel's own and read only.
    """
    return _kept(dsnu_e * Plane(seed, "sensor/dsnu").normals(range(shape[0]), shape[1]))


def _kept(pattern: np.ndarray) -> np.ndarray:
    single = pattern.astype(np.float32)  # 6e-8 of a response or an offset is nothing, and half the memory
    single.flags.writeable = False
    return single


def filter_pattern(shape: tuple[int, int], order: BayerOrder, response: tuple[float, float, float]) -> np.ndarray:
    """Relative response (h, w) of the colour filter over each pixel.

    `order` names the two pixels at the image's top left and then the two below them; `response` is that of the red,
    the green and the blue filter.
    """
    block = np.array([response["RGB".index(colour)] for colour in order]).reshape(2, 2)
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return block[rows % 2, columns % 2]
