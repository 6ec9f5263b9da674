"""Bayer mosaics as one grey image: each kind of pixel brought to the same response, none interpolated.

Edges stay where they are and every pixel's noise stays its own; what is coloured keeps a chequered pattern.
"""

import numpy as np

ORDERS = ("RGGB", "BGGR", "GRBG", "GBRG")
"""Colours of the two pixels at the image's top left, then of the two below them."""
PLACES = ((0, 0), (0, 1), (1, 0), (1, 1))


def balanced(raw_dn: np.ndarray, black_dn: float = 0.0) -> tuple[np.ndarray, tuple[float, ...]]:
    """The mosaic (h, w) float32 with all four kinds of pixels alike, and the four factors their light was given.

    The factors are the ratios of the brightest quarter's means, so a scene that is grey on the whole comes out grey.
    """
    h, w = (size // 2 * 2 for size in raw_dn.shape)
    out = np.asarray(raw_dn, np.float32).copy()
    if min(h, w) < 2:
        return out, (1.0, 1.0, 1.0, 1.0)
    kinds = [out[r:h:2, c:w:2] - np.float32(black_dn) for r, c in PLACES]
    mean = np.mean(kinds, axis=0)
    bright = mean >= np.percentile(mean, 75)
    gains = []
    for (r, c), kind in zip(PLACES, kinds, strict=True):
        gain = float(mean[bright].sum(dtype=np.float64) / max(kind[bright].sum(dtype=np.float64), 1e-6))
        gain = gain if 0.05 < gain < 20 else 1.0
        out[r::2, c::2] = (out[r::2, c::2] - np.float32(black_dn)) * np.float32(gain) + np.float32(black_dn)
        gains.append(gain)
    return out, tuple(gains)
