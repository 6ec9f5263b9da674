"""Templates: short scenes of common jobs that run as they are, to begin one's own with."""

import re
import tomllib
from functools import partial
from pathlib import Path

from testfield.author.bodies import BODIES
from testfield.errors import TestfieldError, gather, nearest
from testfield.store.atomic import whole
from testfield.store.text import read_text, write_text

FOLDER = Path(__file__).with_name("templates")
EXPECTED = "# Expected: "


def templates() -> dict[str, Path]:
    """Names and files of the templates, sorted."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def described(path: Path) -> tuple[str, str]:
    """What a template is for, and what accuracy it states."""
    text = read_text(path)
    lines = text.splitlines()
    expected = next(line.removeprefix(EXPECTED) for line in lines if line.startswith(EXPECTED))
    return lines[0].removeprefix("# "), expected


def write_template(template: str, name: str, folder: Path, force: bool = False) -> list[Path]:
    """Write NAME.toml as a template has it, and the meshes that it names; the paths written.

    Raises `TestfieldError` where there is no such template, the name is none of a scene, there is no such folder or,
    without `force`, a file exists.
    """
    known = templates()
    if template not in known:
        raise TestfieldError("no such template", template, nearest(template, known))
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", name) or len(name) > 80:
        raise TestfieldError(f"value '{name}' is no scene's name", "NAME", "give letters, digits, '_', '-' and '.'")
    if not folder.is_dir():
        raise TestfieldError("no such folder", str(folder), "make it first")
    text = re.sub(r'(?m)^name = ".*"$', f'name = "{name}"', read_text(known[template]), count=1)
    meshes = [str(mesh["file"]) for mesh in tomllib.loads(text).get("meshes", [])]
    scene = folder / f"{name}.toml"
    if not force:
        gather(*(partial(_absent, path) for path in (scene, *(folder / mesh for mesh in meshes))))
    for mesh in meshes:
        with whole(folder / mesh) as part:
            BODIES[mesh]().export(part, file_type="stl")
    write_text(scene, text)
    return [scene, *(folder / mesh for mesh in meshes)]


def _absent(path: Path) -> None:
    if path.exists():
        raise TestfieldError("this file exists", str(path), "give another name or folder, or --force")
