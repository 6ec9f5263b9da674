"""What differs from pixel to pixel and stays the same from frame to frame."""

from typing import Literal

import numpy as np

from testfield.seeds import generator

BayerOrder = Literal["RGGB", "BGGR", "GRBG", "GBRG"]


def gain_pattern(shape: tuple[int, int], prnu: float, seed: int) -> np.ndarray:
    """Each pixel's response to light relative to the mean: (h, w), white, mean 1, standard deviation `prnu`.

    EMVA 1288 release 4.0 linear, photo response nonuniformity. No pixel's response is negative.
    """
    return np.maximum(1 + prnu * generator(seed, "sensor/prnu").standard_normal(shape), 0)


def offset_pattern_e(shape: tuple[int, int], dsnu_e: float, seed: int) -> np.ndarray:
    """Each pixel's dark offset from the mean in electrons: (h, w), white, mean 0, standard deviation `dsnu_e`.

    EMVA 1288 release 4.0 linear, dark signal nonuniformity.
    """
    return dsnu_e * generator(seed, "sensor/dsnu").standard_normal(shape)


def filter_pattern(shape: tuple[int, int], order: BayerOrder, response: tuple[float, float, float]) -> np.ndarray:
    """Relative response (h, w) of the colour filter over each pixel.

    `order` names the two pixels at the image's top left and then the two below them; `response` is that of the red,
    the green and the blue filter.
    """
    block = np.array([response["RGB".index(colour)] for colour in order]).reshape(2, 2)
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return block[rows % 2, columns % 2]
