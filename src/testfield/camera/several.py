"""What is true of one camera, asked of rows that belong to several."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from testfield.camera.interior import Interior


def by_camera(function: Callable[..., Any], interiors: Sequence[Interior], camera: np.ndarray, *rows: Any) -> Any:
    """`function(interior, *rows)` of the rows of each camera, its results put together in the order of the rows.

    `camera` (n,) is the index of each row's camera; `rows` are arrays or poses of length n. The function returns an
    array of length n.
    """
    if len(interiors) == 1:
        return function(interiors[0], *rows)
    found: np.ndarray | None = None
    for k in np.unique(camera):
        here = np.flatnonzero(camera == k)
        own = np.asarray(function(interiors[k], *(values[here] for values in rows)))
        if found is None:
            found = np.zeros((len(camera), *own.shape[1:]), own.dtype)
        found[here] = own
    return function(interiors[0], *rows) if found is None else found
