"""A study's table of cases: plain data that say which scene, which changes, which seed, which methods."""

from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError
from testfield.store.toml import parse_toml, read_toml


@dataclass(frozen=True)
class Case:
    """One case.

    `labels` name it and are the first columns of its rows; `work` is the "module:function" that measures it, given the
    case and its run; `scene` is a scene file as a plain table (None: the work needs none) and `options` are what the
    work is told besides (methods, subsets, exposures). `weight` is the work in units of the study's own, for progress.
    """

    labels: dict[str, Any]
    work: str
    scene: dict[str, Any] | None = None
    options: dict[str, Any] = field(default_factory=dict)
    weight: float = 1.0


def scene_table(path: Path) -> dict[str, Any]:
    """A scene file as a plain table."""
    return parse_toml(read_toml(path, "scene file"), str(path))


def changed(scene: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A copy of a scene with some values set, each named by its path: `sensor.read_noise_e`, `boards.0.bend_mm`.

    Tables on the way are made where they are missing. Raises `TestfieldError` where a path leads through a value or
    past the end of a list.
    """
    copy = deepcopy(scene)
    for path, value in changes.items():
        place: Any = copy
        *way, last = path.split(".")
        try:
            for step in way:
                place = place[int(step)] if isinstance(place, list) else place.setdefault(step, {})
            place[int(last) if isinstance(place, list) else last] = deepcopy(value)
        except (TypeError, ValueError, IndexError, AttributeError) as error:
            raise TestfieldError("the scene has no such place", path, "name tables and places of lists") from error
    return copy
