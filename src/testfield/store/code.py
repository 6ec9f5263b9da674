"""Which code a result was computed with: code that does something else is a changed input.

What counts of a Python file is what it does: its syntax tree without docstrings, without annotations and with imports
in one order. Annotations of what a class declares count, because dataclasses and pydantic read them. Comments and
layout are in no syntax tree.
"""

import ast
import hashlib
import sys
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from testfield.store.looked_at import LookedAt

PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "opencv-python-headless", "pyarrow", "OpenEXR", "trimesh", "embreex")
OWN = "testfield"
ROOT = Path(__file__).parents[1]

Function = TypeVar("Function", ast.FunctionDef, ast.AsyncFunctionDef)


@cache
def package_version(name: str) -> str:
    """Version of an installed distribution."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"


@lru_cache
def code_digest(*modules: str, without: tuple[str, ...] = ()) -> str:
    """Digest of what some modules do, and all that they import of this package, and of package versions.

    Packages named in `without` do not count, nor what only they import.

    A module of somebody else's package (an algorithm or a study of one's own) counts with all that it imports of that
    package and of this one. Files that lie beside a module of this package and are not Python, like the report's
    template, count with it byte by byte; pages for people do not.
    """
    state = hashlib.sha256(repr([sys.version_info[:2], [package_version(name) for name in PACKAGES]]).encode())
    for path in sorted(sources(modules, without)):
        content = path.read_bytes()
        does = _looked_at().at(content)[0].encode() if path.suffix == ".py" else content
        state.update(path.name.encode() + does)
    _looked_at().keep()
    return state.hexdigest()


@cache
def _looked_at() -> LookedAt:
    """Of every source a digest of what it does, and its imports."""
    return LookedAt(ROOT / "__pycache__" / "sources.json", Path(__file__).read_bytes(), _look)


def _look(source: bytes) -> list[Any]:
    return [hashlib.sha256(what_it_does(source).encode()).hexdigest(), _import_statements(source)]


def sources(modules: tuple[str, ...], without: tuple[str, ...] = ()) -> set[Path]:
    """The files behind some modules and behind everything of this package that they import, but packages `without`."""
    found: set[Path] = set()
    home: dict[Path, Path] = {}
    queue: list[str | Path] = list(modules)
    while queue:
        one = queue.pop()
        path = one if isinstance(one, Path) else None if one.startswith(without) else _file(one)
        if path is None or path in found:
            continue
        found.add(path)
        if ROOT in path.parents:
            found |= {
                other for other in path.parent.iterdir() if other.is_file() and other.suffix not in (".py", ".md")
            }
        known = {OWN, *([one.split(".")[0]] if isinstance(one, str) else [])}
        # A file of a user's own, that was loaded, imports from its own folder, whatever else has the same name.
        alone = ROOT not in path.parents and not (path.parent / "__init__.py").is_file()
        folder = home.get(path, path.parent if alone else None)
        for other in imports(path):
            first = other.split(".")[0]
            if folder and (beside := _beside(folder, first)):
                home |= dict.fromkeys(beside, folder)
                queue += beside
            elif first in known:
                queue.append(other)
    return found


def _beside(folder: Path, module: str) -> list[Path]:
    """The files of a module, or of a whole package, in a folder, in the order in which Python looks for them."""
    package, alone = folder / module, folder / f"{module}.py"
    if alone.is_file() and not (package / "__init__.py").is_file():
        return [alone]
    return sorted(path for path in package.rglob("*.py") if path.is_file()) if package.is_dir() else []


def what_it_does(source: bytes) -> str:
    """A Python source's syntax tree as text, without what changes no result.

    Where the source reads `__doc__`, its docstrings count too. Raises `SyntaxError` where it is no Python.
    """
    tree = ast.parse(source)
    reads_docstrings = any("__doc__" in (getattr(node, "id", ""), getattr(node, "attr", "")) for node in ast.walk(tree))
    return ast.dump(_WhatItDoes(reads_docstrings).visit(tree))


class _WhatItDoes(ast.NodeTransformer):
    """Takes docstrings, annotations of functions and the order of imports out of a syntax tree."""

    def __init__(self, keep_docstrings: bool) -> None:
        self.keep_docstrings = keep_docstrings
        self.in_class = False

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """A text that stands alone does nothing."""
        alone = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if alone and not self.keep_docstrings else self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        return self._function(node)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> ast.AST:
        return self._function(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        outside, self.in_class = self.in_class, True
        self.generic_visit(node)
        self.in_class = outside
        return node

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        """Annotations are read of what a class declares, and of no other variables."""
        self.generic_visit(node)
        if self.in_class:
            return node
        return None if node.value is None else ast.Assign(targets=[node.target], value=node.value)

    def visit_Module(self, node: ast.Module) -> ast.AST:
        self.generic_visit(node)
        node.body = _imports_in_order(node.body)
        return node

    def _function(self, node: Function) -> Function:
        outside, self.in_class = self.in_class, False
        node.returns = None
        self.generic_visit(node)
        self.in_class = outside
        return node


def _imports_in_order(statements: list[ast.stmt]) -> list[ast.stmt]:
    """Statements with every row of imports sorted, each with its names sorted."""
    ordered: list[ast.stmt] = []
    row: list[ast.stmt] = []
    for statement in statements:
        if isinstance(statement, (ast.Import, ast.ImportFrom)):
            statement.names.sort(key=ast.dump)
            row.append(statement)
        else:
            ordered += [*sorted(row, key=ast.dump), statement]
            row = []
    return ordered + sorted(row, key=ast.dump)


def imports(path: Path) -> frozenset[str]:
    """Full names of everything a file imports, wherever in it; `from a import b` gives both `a` and `a.b`."""
    names: set[str] = set()
    for level, base, imported in _looked_at().at(path.read_bytes())[1]:
        if level and ROOT in path.parents:  # relative to the file's own package
            package = path.relative_to(ROOT.parent).with_suffix("").parts[:-level]
            base = ".".join([*package, *([base] if base else [])])
        names |= {base, *(f"{base}.{name}" for name in imported)} if base else set(imported)
    return frozenset(names)


def _import_statements(source: bytes) -> list[tuple[int, str, list[str]]]:
    """Of every import in a source: how many packages up, from which module (empty for `import a`), and what."""
    found: list[tuple[int, str, list[str]]] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.append((0, "", [alias.name for alias in node.names]))
        elif isinstance(node, ast.ImportFrom):
            found.append((node.level, node.module or "", [alias.name for alias in node.names]))
    return found


def _file(module: str) -> Path | None:
    parts = module.split(".")
    if parts[0] != OWN:
        try:
            spec = find_spec(module)
        except ModuleNotFoundError:  # not a module, but a name in one
            return None
        return Path(spec.origin) if spec and spec.origin and Path(spec.origin).is_file() else None
    path = ROOT.joinpath(*parts[1:])
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None
