"""What is chosen by name, found through Python entry points: algorithms, lens models, kinds of boards.

A user adds one: decorate a function with `@register("centroids", "mine")`, and either name its module in the
entry-point group `testfield.centroids` of a package of one's own, or have the file loaded (`load_file`). Nothing here
imports an algorithm before it is asked for.
"""

import hashlib
import multiprocessing
import os
import sys
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, TypeVar

from testfield.errors import TestfieldError, nearest

KINDS = {
    "detectors": "detector",
    "finders": "finder",
    "centroids": "centroid",
    "decoders": "decoder",
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

LOADED = "TESTFIELD_LOADED"
"""The variable by which the processes that this one begins learn which files it has loaded. No command reads it."""

F = TypeVar("F", bound=Callable)
_registered: dict[str, dict[str, Callable]] = {kind: {} for kind in KINDS}
_known: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}
_loading: list[tuple[Path, frozenset[str]]] = []
"""Of each file that is being loaded, the last one innermost: its folder, and what had been imported before."""


def register(kind: str, name: str, **known: Any) -> Callable[[F], F]:
    """Decorator that enters a function under `name` in the list of `kind` (one of `KINDS`).

    What is `known` of it by keyword, others ask for with `known_of`: reconstructors tell their `method`.
    Raises `TestfieldError` where there is no such kind.
    """
    if kind not in KINDS:
        raise TestfieldError(f"nothing of kind '{kind}' can be registered", do=nearest(kind, list(KINDS)))

    def enter(function: F) -> F:
        if not callable(function):
            raise TestfieldError(f"{KINDS[kind]} '{name}' is a {type(function).__name__}", do="register a function")
        beside = _file_beside(function.__module__)
        if beside is not None:
            function.__module__ = _name_of(beside)
        _refuse_another(kind, name, function.__module__)
        announced.cache_clear()
        _registered[kind][name] = function
        _known[kind][name] = known
        return function

    return enter


def names(kind: str) -> list[str]:
    """The names known of a kind, sorted: registered in this process, or announced by an entry point."""
    _inherit()
    return sorted({point.name for point in _points(kind)} | set(_registered[kind]))


@lru_cache
def announced() -> dict[str, frozenset[str]]:
    """The modules, of any package, that announce something of any kind, or have registered it, by its name."""
    _inherit()
    found: dict[str, set[str]] = {}
    for point in (point for kind in KINDS for point in _points(kind)):
        found.setdefault(point.name, set()).add(point.module)
    for entered in _registered.values():
        for name, function in entered.items():
            if not function.__module__.startswith("testfield."):
                found.setdefault(name, set()).add(function.__module__)
    return {name: frozenset(modules) for name, modules in found.items()}


def module_of(kind: str, name: str) -> str:
    """Name of the module in which something is defined."""
    return find(kind, name).__module__


def find(kind: str, name: str) -> Callable:
    """The function registered under `name`, imported on demand.

    Raises `TestfieldError` where no such name is known; the message lists those that are. Raises it too where the
    package that announces the name cannot be imported.
    """
    _inherit()
    if name not in _registered[kind]:
        for point in _points(kind):
            if point.name == name:
                _import(kind, point)
    if name not in _registered[kind]:
        raise TestfieldError(f"no {KINDS[kind]} is called '{name}'", do=f"choose one of {', '.join(names(kind))}")
    return _registered[kind][name]


def known_of(kind: str, name: str, what: str) -> Any:
    """What something told of itself under `what` when it was registered, None where it told nothing."""
    find(kind, name)
    return _known[kind][name].get(what)


def load_file(path: Path) -> None:
    """Import a Python file of a user's own, whose decorated functions are known from then on; once a process.

    Processes that this one begins load it too. While it is loaded it can import modules beside it, which are its own:
    another file's module of the same name is another one. Raises `TestfieldError` where there is no such file, or it
    raises anything.
    """
    path = path.resolve()
    name = _name_of(path)
    if name in sys.modules:
        return
    spec = spec_from_file_location(name, path) if path.suffix == ".py" and path.is_file() else None
    if spec is None or spec.loader is None:
        raise TestfieldError("there is no such Python file", str(path), "name a file that ends in .py")
    module = module_from_spec(spec)
    sys.modules[name] = module
    _loading.append((path.parent, frozenset(sys.modules)))
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, (KeyboardInterrupt, TestfieldError)):
            raise
        raise TestfieldError(f"it cannot be imported ({said_of(error)})", str(path), "mend it") from error
    finally:
        sys.path.remove(str(path.parent))
        _set_aside()
        _loading.pop()
    files = [file for file in os.environ.get(LOADED, "").split(os.pathsep) if file]
    os.environ[LOADED] = os.pathsep.join(dict.fromkeys([*files, str(path)]))


def said_of(error: BaseException) -> str:
    """What an error of somebody else's code says, on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


def _name_of(path: Path) -> str:
    """The name of a loaded file as a module, which no other file has."""
    return f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"


def _file_beside(module: str) -> Path | None:
    """The file of a module that the file being loaded has imported from beside it; None of any other module."""
    first = module.partition(".")[0]
    if not _loading or first in _loading[-1][1]:
        return None
    folder, found = _loading[-1][0], sys.modules.get(module)
    file = getattr(found, "__file__", None) or next(iter(getattr(found, "__path__", ())), None)
    if file is None or not Path(file).is_relative_to(folder):
        return None
    # Of a package that lies deeper, as in a virtual environment in this folder, the first part has another name.
    return Path(file) if Path(file).relative_to(folder).parts[0].partition(".")[0] == first else None


def _set_aside() -> None:
    """Give the modules from beside the loaded file names that no other file's have: the next one may import its own."""
    found = {module: _file_beside(module) for module in list(sys.modules)}
    for module, file in found.items():
        if file is not None:
            sys.modules[_name_of(file)] = sys.modules.pop(module)


@cache
def _inherit() -> None:
    """Load what the process loaded that began this one; a process that nobody began loads nothing by itself."""
    if multiprocessing.parent_process() is not None:
        for file in os.environ.get(LOADED, "").split(os.pathsep):
            if file:
                load_file(Path(file))


def _import(kind: str, point: Any) -> None:
    try:
        point.load()
    except Exception as error:  # whatever somebody else's package raises
        package = point.module.partition(".")[0]
        if package.startswith("testfield"):
            raise
        raise TestfieldError(
            f"{KINDS[kind]} '{point.name}' cannot be imported from {point.module} ({said_of(error)})",
            f"package {point.dist.name if point.dist else package}",
            "mend the package, or take it away",
        ) from error


def _refuse_another(kind: str, name: str, module: str) -> None:
    """A name belongs to whoever has it: a recipe that names `gls` means the same everywhere."""
    there = {point.module for point in _points(kind) if point.name == name}
    if name in _registered[kind]:
        there.add(_registered[kind][name].__module__)
    others = sorted(other for other in there if other.partition(".")[0] != module.partition(".")[0])
    if others:
        raise TestfieldError(
            f"a {KINDS[kind]} called '{name}' is there already, in {others[0]}", module, "give yours another name"
        )


@cache
def _points(kind: str) -> tuple[Any, ...]:
    return tuple(entry_points(group=f"testfield.{kind}"))
