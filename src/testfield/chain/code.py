"""Which source a stage computes with: changed code is a changed input."""

import ast
import hashlib
import sys
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from testfield.store.text import read_text

PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "opencv-python-headless", "pyarrow", "OpenEXR", "trimesh", "embreex")
ROOT = Path(__file__).parents[1]


def package_version(name: str) -> str:
    """Version of an installed distribution."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"


@lru_cache
def code_digest(*modules: str, without: tuple[str, ...] = ()) -> str:
    """Digest of the source of some modules, of all that they import of this package, and of package versions.

    Packages named in `without` do not count, nor what only they import.

    A module of somebody else's package (an algorithm or a study of one's own) counts with all that it imports of that
    package and of this one. Files that lie beside a module of this package and are not Python, like the report's
    template, count with it; pages for people do not.
    """
    state = hashlib.sha256(repr([sys.version_info[:2], [package_version(name) for name in PACKAGES]]).encode())
    for path in sorted(sources(modules, without)):
        state.update(path.name.encode() + path.read_bytes())
    return state.hexdigest()


def sources(modules: tuple[str, ...], without: tuple[str, ...] = ()) -> set[Path]:
    """The files behind some modules and behind everything of this package that they import, but packages `without`."""
    found: set[Path] = set()
    queue = list(modules)
    while queue:
        name = queue.pop()
        path = None if name.startswith(without) else _file(name)
        if path is None or path in found:
            continue
        found.add(path)
        if ROOT in path.parents:
            found |= {
                other for other in path.parent.iterdir() if other.is_file() and other.suffix not in (".py", ".md")
            }
        known = {"testfield", name.split(".")[0]}
        queue += [other for other in imports(path) if other.split(".")[0] in known]
    return found


@cache
def imports(path: Path) -> frozenset[str]:
    """Full names of everything a file imports, wherever in it; `from a import b` gives both `a` and `a.b`."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(read_text(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level and ROOT in path.parents:  # relative to the file's own package
                package = path.relative_to(ROOT.parent).with_suffix("").parts[: -node.level]
                base = ".".join([*package, *([base] if base else [])])
            names.add(base)
            names |= {f"{base}.{alias.name}" for alias in node.names}
    return frozenset(names)


def _file(module: str) -> Path | None:
    parts = module.split(".")
    if parts[0] != "testfield":
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
