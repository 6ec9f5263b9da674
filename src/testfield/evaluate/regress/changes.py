"""Change points of a figure over checks, by ruptures.

ruptures (Truong, Oudre and Vayatis, Selective review of offline change point detection methods, Signal Processing 167,
2020) is kept, tested and BSD-licensed, and its PELT finds the best segmentation exactly. asv's own step detector, the
alternative, can only be had with asv.
"""

import numpy as np

LEAST = 2
"""Checks on either side of a change: one alone may be a disturbance."""
PENALTY = 3.0
"""Of a change, in units of variance times log(n): 2 would be BIC for a mean that shifts; its place is free, too."""
SMALLEST = 1e-3
"""Part of all that a figure varies by, below which its noise is not held to be: unchanged code has none at all."""


def change_points(values: np.ndarray) -> list[int]:
    """Places in values (n,) at which another mean begins; what is no number is passed over."""
    import ruptures

    values = np.asarray(values, float)
    there = np.flatnonzero(np.isfinite(values))
    known = values[there]
    spread = float(np.ptp(known)) if len(known) else 0.0
    if len(known) < 2 * LEAST or spread <= 1e-12 * np.abs(known).max():
        return []
    steps = np.abs(np.diff(known))
    noise = max(1.4826 * float(np.median(steps)) / np.sqrt(2), SMALLEST * spread)
    scaled = (known - known.mean()) / noise
    ends = ruptures.Pelt(model="l2", min_size=LEAST, jump=1).fit(scaled).predict(pen=PENALTY * np.log(len(known)))
    return [int(there[end]) for end in ends[:-1]]
