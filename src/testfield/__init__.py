"""A rendered test field for large-scale vision metrology: images with exact truth, the real chain, scored.

`import testfield as tf`, then `tf.run("quick")`. The names in `__all__` are stable and imported when asked for;
`__init__.pyi` tells type checkers and editors of them.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

from testfield.version import __version__

__all__ = [
    "Measured",
    "Recipe",
    "RunResult",
    "Scene",
    "Score",
    "Stations",
    "TestfieldError",
    "__version__",
    "arc",
    "grid",
    "load_scene",
    "measure",
    "open_run",
    "pose",
    "register",
    "ring",
    "run",
    "scattered",
    "score",
    "station",
]


class _Face(ModuleType):
    """This package. The rooms `measure` and `score` are called as functions of the face are: importing a room does not
    put it in the function's place. `from testfield.measure.recipe import Recipe` reaches a room as ever."""

    def __getattr__(self, name: str) -> Any:
        if name not in __all__:
            raise AttributeError(f"module 'testfield' has no attribute '{name}'")
        value = getattr(import_module("testfield.api"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *__all__})


sys.modules[__name__].__class__ = _Face
