"""STEP files (ISO 10303-21) become triangles, by Open CASCADE in the package cascadio, an optional extra."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from testfield.errors import TestfieldError

STEP = (".step", ".stp")
DEVIATION_MM = 0.05
"""By how much the middle of a triangle may stand off from its curved surface."""
TURN_RAD = 0.1
"""And by how much neighbouring triangles on one may face otherwise."""
SECONDS = 600
CODE = (
    "import sys, cascadio; source, target, length, angle = sys.argv[1:]; "
    "glb = cascadio.load(open(source, 'rb').read(), 'step', tol_linear=float(length), tol_angular=float(angle)); "
    "open(target, 'wb').write(glb)"
)
"""Runs in a process of its own: Open CASCADE writes to the terminal, and a damaged file may end it."""


def check_step(begins: bytes, path: Path, where: str) -> None:
    """Raise `TestfieldError` where a file does not begin as a STEP file, or where the extra is not installed."""
    if b"ISO-10303-21" not in begins[:1000]:
        raise TestfieldError(
            f"value '{path}': this is no STEP file: it does not begin with ISO-10303-21", where, "export it again"
        )
    if importlib.util.find_spec("cascadio") is None:
        raise TestfieldError(
            f"value '{path}': STEP files are read by a package that is not installed",
            where,
            "pip install 'testfield[step]', or export the body as STL, OBJ, PLY or GLB",
        )


def states_unit(path: Path) -> bool:
    """Whether a STEP file says in which unit of length it is."""
    return b"LENGTH_UNIT" in path.read_bytes()


def as_glb(path: Path, where: str) -> bytes:
    """The triangles of all bodies of a STEP file as GLB, in metres, whatever units the file's parts have: curved faces
    are followed to `DEVIATION_MM`. Raises `TestfieldError` where it cannot be read, or takes ten minutes."""
    with TemporaryDirectory(prefix="testfield-") as folder:
        glb = Path(folder) / "body.glb"
        command = [sys.executable, "-c", CODE, str(path), str(glb), str(DEVIATION_MM), str(TURN_RAD)]
        try:
            done = subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
        except subprocess.TimeoutExpired as error:
            raise TestfieldError(
                f"value '{path}': making triangles of it takes more than {SECONDS} s",
                where,
                "leave out small parts, or export it as STL",
            ) from error
        if done.returncode or not glb.is_file() or not glb.stat().st_size:
            raise TestfieldError(
                f"value '{path}': not a readable STEP file (damaged, cut short or without bodies)",
                where,
                "export it again, as AP203, AP214 or AP242",
            )
        return glb.read_bytes()
