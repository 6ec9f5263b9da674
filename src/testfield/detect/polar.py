"""Values of an image about spots, in units of what the light would make of a spot there."""

from functools import partial

import numpy as np

from testfield.detect.by_place import by_place
from testfield.detect.sampling import WINDOW_PX, sampled
from testfield.store.compiled import compiled

LEAST_CONTRAST = 0.25
"""The least contrast that is believed of the light somewhere, in units of that at the centre."""


def values_at(image: np.ndarray, xy_px: np.ndarray, half_axes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n, k) bilinear values of an image (h, w) at places (k, 2) in the half-axes (n, 2, 2) of spots at `xy_px` (n, 2);
    NaN outside the image."""
    return by_place(partial(_values, np.ascontiguousarray(image, np.float32), places), xy_px, half_axes)


@compiled
def _values(image: np.ndarray, places: np.ndarray, xy: np.ndarray, axes: np.ndarray) -> np.ndarray:
    values, window = np.empty((len(xy), len(places)), np.float32), np.empty((WINDOW_PX, WINDOW_PX), np.float32)
    for i in range(len(xy)):
        sampled(image, xy[i], axes[i], places, window, values[i])
    return values


@compiled
def in_contrasts(values: np.ndarray, places: np.ndarray, ground: np.ndarray, contrast: np.ndarray) -> None:
    """Make levels of values (n, k) at places (k, 2): 0 as dark as the ground, 1 as bright as the spot would be there.
    `ground` and `contrast` are planes (n, 3): at the centre, and the slopes a half-axis."""
    for i in range(len(values)):
        out, g, c = values[i], ground[i], contrast[i]
        for k in range(len(places)):
            x, y = places[k, 0], places[k, 1]
            here = max(c[0] + c[1] * x + c[2] * y, LEAST_CONTRAST * c[0])
            out[k] = (out[k] - (g[0] + g[1] * x + g[2] * y)) / here
