"""Files that are whole or absent, and the ledger of what each was made from."""

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError


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

    def enter(self, name: str, key: str, inputs: list[Path] | None = None) -> None:
        """Record a file that was just made, and the digests of the run's files it was made from."""
        made_from = {str(path.relative_to(self.folder)): file_digest(path) for path in inputs or []}
        self.files[name] = {"key": key, "sha256": file_digest(self.folder / name), "inputs": made_from}
        self.save()

    def keep_foreign(self, name: str) -> None:
        """Move a sound file that this run did not make out of the way, instead of writing over it."""
        path, entry = self.folder / name, self.files.get(name)
        if entry is None and path.is_file() and path.stat().st_size > 0:
            path.replace(path.with_name(f"{path.stem}-before{path.suffix}"))

    def note(self, **notes: Any) -> None:
        """Record facts about the run."""
        self.notes.update(notes)
        self.save()

    def save(self) -> None:
        """Write the ledger."""
        with whole(self.path) as path:
            path.write_text(json.dumps({"notes": self.notes, "files": dict(sorted(self.files.items()))}, indent=1))

    def make(self, name: str, key: str, write: Callable[[Path], None], inputs: list[Path] | None = None) -> bool:
        """Have `write` make the file unless it is fresh; returns whether it was made."""
        if self.fresh(name, key):
            return False
        with whole(self.folder / name) as path:
            write(path)
        self.enter(name, key, inputs)
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
