"""Marks on a plane: what is printed, as a structure of arrays."""

from dataclasses import dataclass

import numpy as np

RING_INNER, RING_OUTER, QUIET = 2.0, 3.0, 3.9
"""Radii of the ring's edges and of the quiet zone, in dot radii (METHODS section 8)."""


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
