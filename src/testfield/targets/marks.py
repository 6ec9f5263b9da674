"""Marks on a plane: what is printed, as a structure of arrays."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import AfterValidator

LEAST_GAP, LEAST_RING, LARGEST = 0.4, 0.3, 8.0
"""In dot radii: a narrower gap between dot and ring is filled by the blur that photographs of small dots have, in a
narrower ring segments cannot be sampled; a wider target is no longer seen in one light."""


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
"""The shapes that are common, by dot : ring's inner edge : ring's outer edge; any other is named alike."""
USUAL = "1:2:3"


def ring_radii(shape: str) -> RingRadii:
    """The shape called `a:b:c`: radii or diameters of the dot and of the ring's inner and outer edge, in any unit.

    Raises `ValueError` that says what is wrong with it.
    """
    try:
        dot, inner, outer = (float(part) for part in shape.split(":"))
    except ValueError:
        raise ValueError(f"'{shape}' is no shape of a ring: write dot:inner edge:outer edge, as 1:2:3") from None
    if not (all(math.isfinite(value) for value in (dot, inner, outer)) and dot > 0):
        raise ValueError(f"'{shape}': the dot, the first of the three, must be larger than 0")
    inner, outer = round(inner / dot, 6), round(outer / dot, 6)
    if inner < 1 + LEAST_GAP:
        raise ValueError(f"'{shape}': the ring begins at {inner:g} dot radii; its gap needs {1 + LEAST_GAP:g} and more")
    if outer < inner + LEAST_RING - 1e-9:
        raise ValueError(
            f"'{shape}': the ring is {outer - inner:g} dot radii wide; its segments need {LEAST_RING:g} and more"
        )
    if outer > LARGEST:
        raise ValueError(f"'{shape}': the ring ends at {outer:g} dot radii, and {LARGEST:g} are the most")
    return RingRadii(inner, outer)


def shape_name(radii: RingRadii) -> str:
    """What a shape is called."""
    return f"1:{radii.inner:g}:{radii.outer:g}"


def _same_shape(shape: str) -> str:
    return shape_name(ring_radii(shape))


RingShape = Annotated[str, AfterValidator(_same_shape)]
"""The name of a shape in a person's file, brought to a dot of 1."""


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
