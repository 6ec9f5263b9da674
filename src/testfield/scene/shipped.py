"""Scenes and field files that come along, found by name: `quick` is as good as a path to quick.toml.

In the repository `src/testfield/shipped` is a link to `scenes/`; an installed package holds copies.
"""

from pathlib import Path

from testfield.errors import TestfieldError, nearest

SHIPPED = (Path(__file__).parents[1] / "shipped").resolve()


def shipped_scenes() -> dict[str, Path]:
    """Names and paths of the scenes that come along, sorted."""
    return _files(SHIPPED)


def shipped_fields() -> dict[str, Path]:
    """Names and paths of the field files that come along, sorted."""
    return _files(SHIPPED / "fields")


def find_scene(name: Path | str) -> Path:
    """The scene file at a path or, where there is none, the scene of that name that comes along.

    Raises `TestfieldError` with the nearest name for a bare name that is neither.
    """
    return _find(Path(name), shipped_scenes(), "scene file", "`testfield list scenes` shows all")


def find_field(name: Path | str) -> Path:
    """The field file at a path or, where there is none, the one of that name that comes along. Raises as `find_scene`
    does."""
    return _find(Path(name), shipped_fields(), "field file", "")


def _files(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def _find(path: Path, shipped: dict[str, Path], what: str, more: str) -> Path:
    if path.is_file():
        return path
    name = path.name.removesuffix(".toml")
    bare = path == Path(path.name)
    if bare and name in shipped:
        return shipped[name]
    if path.exists():
        return path  # a folder, say; the reader of the file says so
    if name in shipped:
        raise TestfieldError(f"no such {what}", str(path), f"'{name}' alone names the one that comes along")
    if bare:
        advice = f"{nearest(name, shipped)} {more}".strip()
        raise TestfieldError(f"no such {what}, and none of that name comes along", str(path), advice)
    return path
