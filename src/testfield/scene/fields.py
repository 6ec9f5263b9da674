"""Types of a scene file's fields, and what all its parts are made of."""

import math
import re
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    model_validator,
)

from testfield.sensor.presets import presets
from testfield.targets.board_pattern import dictionary

PositiveFloat = Annotated[float, Field(ge=1e-9)]
"""Less is nothing, and would overflow where something is divided by it."""
Vector3 = tuple[float, float, float]
Pair = tuple[float, float]
Size = tuple[PositiveFloat, PositiveFloat]
Ink = Literal["matt", "gloss", "retro", "luminous"]
Count = Annotated[int, Field(ge=1, le=1000)]


def _filename(name: str) -> str:
    """Names of scenes and stations become names of files."""
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", name):
        raise ValueError("give letters, digits, '_', '-' and '.', not beginning with a dot")
    return name


Name = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_filename)]


def _printable(name: str) -> str:
    if not name.isprintable() or ":" in name:
        raise ValueError("give printable characters without ':'")
    return name


Label = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_printable)]
SHORTEST_DIRECTION = 1e-6


def _direction(vector: Vector3) -> Vector3:
    if not any(vector):
        raise ValueError("a direction must not have length zero")
    if math.hypot(*vector) < SHORTEST_DIRECTION:
        raise ValueError(f"a direction must have a length of {SHORTEST_DIRECTION:g} or more")
    return vector


Direction = Annotated[Vector3, AfterValidator(_direction)]


def _dictionary(name: str) -> str:
    dictionary(name)
    return name


Dictionary = Annotated[str, AfterValidator(_dictionary)]


def _preset(name: str) -> str:
    if name not in presets():
        raise ValueError(f"no such sensor; known are {', '.join(sorted(presets()))}")
    return name


PresetName = Annotated[str, AfterValidator(_preset)]


class Part(BaseModel):
    """A table of a scene file, which holds its fields and no others."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Box(Part):
    """Fields of a box."""

    low_mm: Vector3 = Field(description="Corner of the box.")
    high_mm: Vector3 = Field(description="Opposite corner.")

    @model_validator(mode="after")
    def _ordered(self) -> "Box":
        if any(a > b for a, b in zip(self.low_mm, self.high_mm, strict=True)):
            raise ValueError(f"low_mm {list(self.low_mm)} is not below high_mm {list(self.high_mm)}")
        return self
