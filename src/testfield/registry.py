"""Algorithms by name: centroids, calibrators, reconstructors, found through Python entry points.

A user adds one in their own package: decorate a function with `@register("centroids", "mine")` and name its
module in the entry-point group `testfield.centroids`. Nothing here imports an algorithm before it is asked for.
"""

from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import entry_points
from typing import TypeVar

from testfield.errors import TestfieldError

STAGES = ("centroids", "calibrators", "reconstructors")

F = TypeVar("F", bound=Callable)
_registered: dict[str, dict[str, Callable]] = {stage: {} for stage in STAGES}


def register(stage: str, name: str) -> Callable[[F], F]:
    """Decorator that enters a function under `name` in the list of `stage` (one of `STAGES`)."""

    def enter(function: F) -> F:
        _registered[stage][name] = function
        return function

    return enter


def names(stage: str) -> list[str]:
    """The names known in a stage, sorted: registered in this process, or announced by an entry point."""
    announced = {point.name for point in entry_points(group=f"testfield.{stage}")}
    return sorted(announced | set(_registered[stage]))


@lru_cache
def announced() -> dict[str, frozenset[str]]:
    """The modules, of any package, that announce an algorithm of any stage, by the algorithm's name."""
    found: dict[str, set[str]] = {}
    for point in (point for stage in STAGES for point in entry_points(group=f"testfield.{stage}")):
        found.setdefault(point.name, set()).add(point.module)
    return {name: frozenset(modules) for name, modules in found.items()}


def module_of(stage: str, name: str) -> str:
    """Name of the module in which an algorithm is defined."""
    return find(stage, name).__module__


def find(stage: str, name: str) -> Callable:
    """The function registered under `name`, imported on demand.

    Raises `TestfieldError` where no such name is known; the message lists those that are.
    """
    if name not in _registered[stage]:
        for point in entry_points(group=f"testfield.{stage}"):
            if point.name == name:
                point.load()
    if name not in _registered[stage]:
        raise TestfieldError(f"no {stage[:-1]} is called '{name}'", do=f"choose one of {', '.join(names(stage))}")
    return _registered[stage][name]
