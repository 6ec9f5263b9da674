"""What a case's rows depend on: its own data, the code of its work, and of the algorithms that it uses alone."""

import ast
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.registry import announced
from testfield.store.code import code_digest, package_version, sources
from testfield.store.digests import digest, file_digest
from testfield.store.text import read_text

NO_ROOMS = ("testfield.report", "testfield.certify")
"""Pages and certificates do not count: no row comes from them."""


def case_key(case: Case) -> str:
    """Digest of all that a case's rows depend on.

    Of the algorithms that are found by name at run time those count that the case or any code on its way names. A name
    that is put together at run time is not seen.
    """
    named = frozenset(_texts(case) & announced().keys())
    code = code_digest(*_modules(case.work.partition(":")[0], named), without=NO_ROOMS)
    device = os.environ.get("TESTFIELD_VARIANT", "") + os.environ.get("TESTFIELD_LLVM_TARGET", "")
    outside = (device, package_version("pycolmap"))
    measured = [case.noise_seed, case.recipe] if case.noise_seed is not None or case.recipe is not None else []
    files = file_digests(case)
    return digest(
        case.labels, case.work, case.scene, case.options, *measured, *([files] if files else []), code, outside
    )


def file_digests(case: Case) -> dict[str, str]:
    """Digests of what is in the files that a case's scene names, by their copies' names. Raises `TestfieldError` where
    one is missing."""
    for path in case.files.values():
        if not path.is_file():
            raise TestfieldError("no such file, and the scene names it", str(path), "check the path")
    return {name: file_digest(path) for name, path in sorted(case.files.items())}


@cache
def _modules(work: str, named: frozenset[str]) -> tuple[str, ...]:
    """The work's module, and those of all algorithms whose names are among `named`, or in the source of any of these
    modules and of what they import."""
    known = announced()
    modules = {work}
    while True:
        files = sources(tuple(sorted(modules)), NO_ROOMS)
        texts = named.union(*(_constants(path) for path in files if path.suffix == ".py"))
        more = modules | {module for name in known.keys() & texts for module in known[name]}
        if more == modules:
            return tuple(sorted(modules))
        modules = more


@cache
def _constants(path: Path) -> frozenset[str]:
    """All constant texts in a file's source but those by which an algorithm registers itself."""
    nodes = list(ast.walk(ast.parse(read_text(path))))
    entered = {argument for node in nodes if _registers(node) for argument in node.args}  # type: ignore[attr-defined]
    return frozenset(
        node.value
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in entered
    )


def _registers(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "register"


def _texts(value: Any) -> set[str]:
    """All texts in a value, in whatever it holds, and in the names of its entries."""
    if isinstance(value, str):
        return {value}
    if is_dataclass(value) and not isinstance(value, type):
        return _texts([getattr(value, one.name) for one in fields(value)])
    if isinstance(value, Mapping):
        return _texts([*value.keys(), *value.values()])
    if isinstance(value, (Sequence, set, frozenset)):
        return {text for one in value for text in _texts(one)}
    return set()
