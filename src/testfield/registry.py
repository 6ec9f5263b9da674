"""What is chosen by name, found through Python entry points: algorithms, lens models, kinds of boards.

A user adds one in their own package: decorate a function with `@register("centroids", "mine")` and name its
module in the entry-point group `testfield.centroids`. Nothing here imports an algorithm before it is asked for.
"""

from collections.abc import Callable
from functools import cache, lru_cache
from importlib.metadata import entry_points
from typing import Any, TypeVar

from testfield.errors import TestfieldError, nearest

KINDS = {
    "centroids": "centroid",
    "calibrators": "calibrator",
    "reconstructors": "reconstructor",
    "lenses": "lens model",
    "boards": "kind of board",
}
"""The kinds of things that have names, and what one of them is called.

A lens model is registered as a function without arguments that gives a `camera.lens.LensModel`, a kind of board as
one that gives a `targets.board_pattern.BoardKind`.
"""

ALGORITHMS = ("centroids", "calibrators", "reconstructors")
"""Those kinds that measure, in the order of the pipeline."""

F = TypeVar("F", bound=Callable)
_registered: dict[str, dict[str, Callable]] = {kind: {} for kind in KINDS}
_known: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}


def register(kind: str, name: str, **known: Any) -> Callable[[F], F]:
    """Decorator that enters a function under `name` in the list of `kind` (one of `KINDS`).

    What is `known` of it by keyword, others ask for with `known_of`: reconstructors tell their `method`.
    Raises `TestfieldError` where there is no such kind.
    """
    if kind not in KINDS:
        raise TestfieldError(f"nothing of kind '{kind}' can be registered", do=nearest(kind, list(KINDS)))

    def enter(function: F) -> F:
        _registered[kind][name] = function
        _known[kind][name] = known
        return function

    return enter


def names(kind: str) -> list[str]:
    """The names known of a kind, sorted: registered in this process, or announced by an entry point."""
    return sorted({point.name for point in _points(kind)} | set(_registered[kind]))


@lru_cache
def announced() -> dict[str, frozenset[str]]:
    """The modules, of any package, that announce something of any kind, by its name."""
    found: dict[str, set[str]] = {}
    for point in (point for kind in KINDS for point in _points(kind)):
        found.setdefault(point.name, set()).add(point.module)
    return {name: frozenset(modules) for name, modules in found.items()}


def module_of(kind: str, name: str) -> str:
    """Name of the module in which something is defined."""
    return find(kind, name).__module__


def find(kind: str, name: str) -> Callable:
    """The function registered under `name`, imported on demand.

    Raises `TestfieldError` where no such name is known; the message lists those that are.
    """
    if name not in _registered[kind]:
        for point in _points(kind):
            if point.name == name:
                point.load()
    if name not in _registered[kind]:
        raise TestfieldError(f"no {KINDS[kind]} is called '{name}'", do=f"choose one of {', '.join(names(kind))}")
    return _registered[kind][name]


def known_of(kind: str, name: str, what: str) -> Any:
    """What something told of itself under `what` when it was registered, None where it told nothing."""
    find(kind, name)
    return _known[kind][name].get(what)


@cache
def _points(kind: str) -> tuple[Any, ...]:
    return tuple(entry_points(group=f"testfield.{kind}"))
