"""Files that are whole or absent, and the ledger of what each was made from."""

import errno
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError

PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "opencv-python-headless")


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`; on success it takes the place of `path` at once, on failure it is removed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.part{os.getpid()}{path.suffix}")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def file_digest(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest(*things: Any) -> str:
    """SHA-256 of values: numbers, texts, arrays, dataclasses and containers of them."""
    state = hashlib.sha256()
    for thing in things:
        _feed(state, thing)
    return state.hexdigest()


def _feed(state: Any, thing: Any) -> None:
    if isinstance(thing, np.ndarray):
        state.update(f"{thing.dtype}{thing.shape}".encode())
        state.update(repr(thing.tolist()).encode() if thing.dtype == object else np.ascontiguousarray(thing).tobytes())
    elif is_dataclass(thing) and not isinstance(thing, type):
        state.update(type(thing).__name__.encode())
        for field in fields(thing):
            _feed(state, getattr(thing, field.name))
    elif isinstance(thing, (list, tuple)):
        state.update(f"{len(thing)}(".encode())
        for item in thing:
            _feed(state, item)
    elif isinstance(thing, dict):
        _feed(state, sorted(thing.items()))
    else:
        state.update(f"{type(thing).__name__}:{thing!r};".encode())


def code_digest(*rooms: str) -> str:
    """Digest of the source of some rooms and of the packages they compute with: changed code is a changed input."""
    state = hashlib.sha256(repr([sys.version_info[:2], [_version(name) for name in PACKAGES]]).encode())
    root = Path(__file__).parents[1]
    for room in rooms:
        for path in sorted((root / room).glob("*.py")):
            state.update(path.name.encode() + path.read_bytes())
    return state.hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"


class Ledger:
    """`run.json`: for each file of a run, the key of its inputs and the digest of its bytes; and notes on the run."""

    def __init__(self, folder: Path):
        self.folder, self.path = folder, folder / "run.json"
        try:
            data = json.loads(self.path.read_text())
            self.files: dict[str, dict] = dict(data["files"])
            self.notes: dict[str, Any] = dict(data["notes"])
        except (OSError, ValueError, KeyError, TypeError):
            # Absent or damaged: nothing is known to be good, so everything is made again.
            self.files, self.notes = {}, {}

    def fresh(self, name: str, key: str) -> bool:
        """Whether the file was made from these inputs and is undamaged."""
        entry, path = self.files.get(name), self.folder / name
        return bool(entry and entry["key"] == key and path.is_file() and file_digest(path) == entry["sha256"])

    def enter(self, name: str, key: str) -> None:
        """Record a file that was just made."""
        self.files[name] = {"key": key, "sha256": file_digest(self.folder / name)}
        self.save()

    def note(self, **notes: Any) -> None:
        """Record facts about the run."""
        self.notes.update(notes)
        self.save()

    def save(self) -> None:
        """Write the ledger."""
        with whole(self.path) as path:
            path.write_text(json.dumps({"notes": self.notes, "files": dict(sorted(self.files.items()))}, indent=1))

    def make(self, name: str, key: str, write: Callable[[Path], None]) -> bool:
        """Have `write` make the file unless it is fresh; returns whether it was made."""
        if self.fresh(name, key):
            return False
        with whole(self.folder / name) as path:
            write(path)
        self.enter(name, key)
        return True


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn a full disk or a folder that cannot be written into sentences."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise TestfieldError(
                "the disk is full", str(folder), "free some space; the same command continues from here"
            ) from error
        if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM, errno.ENOTDIR, errno.EEXIST):
            raise TestfieldError(
                f"cannot be written ({error.strerror})", str(folder), "choose another folder with --out"
            ) from error
        raise
