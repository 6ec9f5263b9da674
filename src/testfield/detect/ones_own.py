"""What a finder or a decoder of somebody's own gives, checked and made what detection goes on with."""

from typing import Any

import numpy as np

from testfield.detect.decode import UNREADABLE
from testfield.detect.find import MOST_BLOBS, Blobs
from testfield.errors import TestfieldError


def blobs_of(found: Any) -> Blobs:
    """Rough places of a finder: centres (n, 2) in px and second moments (n, 2, 2) in px^2, nothing else.

    What is not finite, or has no size, is left out. Raises `TestfieldError` for other shapes.
    """
    try:
        xy, moments = (np.asarray(part, float) for part in found)
    except (TypeError, ValueError) as error:
        raise _no("a finder gives centres (n, 2) and second moments (n, 2, 2)", f"{type(found).__name__}") from error
    if xy.ndim != 2 or xy.shape[1] != 2 or moments.shape != (len(xy), 2, 2):
        raise _no("a finder gives centres (n, 2) and second moments (n, 2, 2)", f"{xy.shape} and {moments.shape}")
    good = np.isfinite(xy).all(axis=1) & np.isfinite(moments).all(axis=(1, 2))
    good[good] &= np.linalg.eigvalsh(moments[good]).min(axis=1, initial=np.inf) > 0
    keep = np.flatnonzero(good)[:MOST_BLOBS]
    return Blobs(xy[keep], moments[keep], np.zeros(len(keep), bool), int(good.sum()) - len(keep))


def numbers_of(found: Any, n: int) -> np.ndarray:
    """Numbers (n,) of a decoder: of a ring code, 0 of a plain dot, below 0 where a ring cannot be read.

    Raises `TestfieldError` for anything else.
    """
    numbers = np.asarray(found)
    if numbers.shape != (n,) or numbers.dtype.kind not in "iu":
        raise _no(f"a decoder gives {n} whole numbers", f"{numbers.dtype} of shape {numbers.shape}")
    return np.where(numbers < 0, UNREADABLE, numbers).astype(int)


def _no(wanted: str, got: str) -> TestfieldError:
    return TestfieldError(f"{wanted}, and this one gave {got}", "recipe", "return that")
