"""Where cameras stand, as values: what the builder's `stations` takes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel

from testfield.scene.station_parts import (
    StationArc,
    StationGrid,
    StationPose,
    StationRandom,
    StationRing,
    StationSingle,
)

Point = Sequence[float]


@dataclass(frozen=True)
class Stations:
    """Stations by a `generator` of scene files, with its fields."""

    generator: str
    model: type[BaseModel]
    fields: dict[str, Any] = field(default_factory=dict)


def station(position_mm: Point, look_at_mm: Point, **fields: Any) -> Stations:
    """One station; `name`, `roll_deg`, `camera` or `rig` may be given."""
    return Stations("single", StationSingle, {"position_mm": position_mm, "look_at_mm": look_at_mm, **fields})


def pose(name: str, position_mm: Point, rotation_deg: Point, **fields: Any) -> Stations:
    """One station whose exterior orientation is known by numbers."""
    return Stations(
        "pose", StationPose, {"name": name, "position_mm": position_mm, "rotation_deg": rotation_deg, **fields}
    )


def arc(count: int, radius_mm: float, height_mm: float, look_at_mm: Point, **fields: Any) -> Stations:
    """Stations on a horizontal arc around a point; `azimuth_deg`, `roll_deg` may be given."""
    given = {"count": count, "radius_mm": radius_mm, "height_mm": height_mm, "look_at_mm": look_at_mm}
    return Stations("arc", StationArc, {**given, **fields})


def ring(count: int, radius_mm: float, centre_mm: Point, look_at_mm: Point, **fields: Any) -> Stations:
    """Stations on a full circle; `axis`, `roll_deg` may be given."""
    given = {"count": count, "radius_mm": radius_mm, "centre_mm": centre_mm, "look_at_mm": look_at_mm}
    return Stations("ring", StationRing, {**given, **fields})


def grid(counts: Sequence[int], low_mm: Point, high_mm: Point, look_at_mm: Point, **fields: Any) -> Stations:
    """Stations on a regular lattice."""
    given = {"counts": counts, "low_mm": low_mm, "high_mm": high_mm, "look_at_mm": look_at_mm}
    return Stations("grid", StationGrid, {**given, **fields})


def scattered(count: int, low_mm: Point, high_mm: Point, look_at_mm: Point, **fields: Any) -> Stations:
    """Stations at random places of a box; `seed` may be given."""
    given = {"count": count, "low_mm": low_mm, "high_mm": high_mm, "look_at_mm": look_at_mm}
    return Stations("random", StationRandom, {**given, **fields})
