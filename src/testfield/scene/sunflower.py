"""Points that share a disc equally."""

import numpy as np

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def sunflower(count: int) -> np.ndarray:
    """(count, 2) points of equal shares of the unit disc, as seeds lie in a sunflower (Vogel 1979)."""
    k = np.arange(count)
    turn = k * GOLDEN_ANGLE
    return np.sqrt((k[:, None] + 0.5) / count) * np.column_stack([np.cos(turn), np.sin(turn)])
