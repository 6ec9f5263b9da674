"""Marks on a plane: what is printed, as a structure of arrays."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RingRadii:
    """Radii of a ring code in dot radii: the ring's inner and outer edge, and the quiet zone's (METHODS section 8)."""

    inner: float
    outer: float

    @property
    def quiet(self) -> float:
        """Nothing else may be printed within this radius."""
        return self.outer + 0.9


RADII = {"1:2:3": RingRadii(2.0, 3.0), "1:2.5:4": RingRadii(2.5, 4.0)}
"""The shapes in use, by dot : ring's inner edge : ring's outer edge."""
USUAL = "1:2:3"


@dataclass(frozen=True)
class Marks:
    """Circular marks in the frame of the plane that carries them (x right, y up, z out of the front).

    `xy_mm` (n, 2) centres; `diameter_mm` (n,) of the central dot; `code` (n,) code number, 0 for a plain dot;
    `bits` number of segments of every ring in this set.
    """

    xy_mm: np.ndarray
    diameter_mm: np.ndarray
    code: np.ndarray
    bits: int = 14

    def __len__(self) -> int:
        return len(self.xy_mm)

    @staticmethod
    def join(parts: list["Marks"]) -> "Marks":
        """One set from several, in order."""
        bits = {part.bits for part in parts}
        if len(bits) > 1:
            raise ValueError(f"marks of one plane share one code length, got {sorted(bits)}")
        return Marks(
            np.concatenate([part.xy_mm for part in parts]).reshape(-1, 2),
            np.concatenate([part.diameter_mm for part in parts]),
            np.concatenate([part.code for part in parts]),
            bits.pop(),
        )
