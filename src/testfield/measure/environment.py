"""Virtual environments that recipes name: made once by pip and kept in the user's cache, so that releases can meet."""

import contextlib
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from testfield.errors import TestfieldError
from testfield.measure.keeper import end, keeper
from testfield.store.cache import users_cache
from testfield.store.digests import digest
from testfield.store.text import read_text, write_text

MOST_TIME_S = 3600.0
"""After which an installation is given up."""
WORDS = 300
"""Characters of pip's own words that are repeated."""
SHEET = "environment.json"
"""What an environment that is whole says of itself: nothing else in the cache is used."""
OF_THE_CALLER = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP")
"""Variables by which the caller's packages would be found in the place of the environment's."""


def environment_of(packages: tuple[str, ...], where: str = "environment.packages") -> dict[str, str]:
    """The packages of an environment as they are installed, version by name; the environment is made where there is
    none.

    Raises `TestfieldError` with pip's own last words where it cannot be made.
    """
    for package in packages:
        if not package.strip() or package.startswith("-"):
            raise TestfieldError(f"'{package}' is no package", where, "write it as pip takes it, as numpy==2.1.0")
    folder = folder_of(packages)
    if (folder / SHEET).is_file():
        return _installed(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _alone(folder.with_suffix(".lock")):
        if not (folder / SHEET).is_file():
            print(f"environment: {', '.join(packages)}", file=sys.stderr)
            shutil.rmtree(folder, ignore_errors=True)
            try:
                _make(folder, packages, where)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
    return _installed(folder)


def python_of(packages: tuple[str, ...]) -> Path:
    """The interpreter of an environment, which is made where there is none. Raises as `environment_of`."""
    environment_of(packages)
    return _python(folder_of(packages))


def variables_of(packages: tuple[str, ...]) -> dict[str, str] | None:
    """The variables that a program of an environment gets; None, those of the caller, where it has none."""
    return {name: value for name, value in os.environ.items() if name not in OF_THE_CALLER} if packages else None


def folder_of(packages: tuple[str, ...]) -> Path:
    """Where an environment is kept: under the digest of its packages and of the Python that it is made with."""
    made_with = (sys.implementation.name, platform.python_version(), platform.system(), platform.machine())
    return users_cache() / "environments" / digest(sorted(packages), made_with)[:24]


def _python(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _installed(folder: Path) -> dict[str, str]:
    found: dict[str, str] = json.loads(read_text(folder / SHEET))["installed"]
    return found


def _make(folder: Path, packages: tuple[str, ...], where: str) -> None:
    _run([sys.executable, "-m", "venv", str(folder)], packages, where, folder)
    pip = [str(_python(folder)), "-m", "pip", "--disable-pip-version-check", "--no-input"]
    _run([*pip, "install", "--quiet", "--prefer-binary", "--", *packages], packages, where, folder)
    listed = json.loads(_run([*pip, "list", "--format", "json"], packages, where, folder))
    installed = {one["name"]: one["version"] for one in listed if one["name"] not in ("pip", "setuptools")}
    about = {"packages": list(packages), "python": platform.python_version(), "installed": installed}
    write_text(folder / SHEET, json.dumps(about, indent=1))


def _run(command: list[str], packages: tuple[str, ...], where: str, folder: Path) -> str:
    """What a step prints. Raises `TestfieldError` with its last words where it fails. Where this process is itself
    ended meanwhile, the step is too, and the environment's `folder` is removed."""
    with keeper(folder) as keep:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
            env=variables_of(packages),
        )
        try:
            keep(process.pid)
            out, said = process.communicate(timeout=MOST_TIME_S)
        except subprocess.TimeoutExpired as error:
            raise TestfieldError(
                f"{', '.join(packages)} cannot be installed within {MOST_TIME_S:g} s",
                where,
                "name releases with wheels",
            ) from error
        finally:
            end(process)
    if process.returncode:
        lines = [" ".join(line.split()) for line in (said or out).splitlines() if line.strip()]
        words = "".join(letter if letter.isprintable() else "?" for letter in " / ".join(lines[-2:]))[-WORDS:]
        raise TestfieldError(
            f"{', '.join(packages)} cannot be installed: '{words}'", where, "name releases that the index has"
        )
    return out


@contextlib.contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """One process at a time makes an environment; the others wait for it, and find it made."""
    with lock.open("w") as file:
        if os.name != "nt":
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield
