"""The ledger of a folder: what each file was made from, and whose it is."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from testfield.errors import TestfieldError
from testfield.store.atomic import part_path, settle, whole
from testfield.store.digests import file_digest
from testfield.store.sheets import FORMAT
from testfield.store.sound import looks_whole
from testfield.store.stamp import stamp
from testfield.store.text import read_text, write_text

Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Entry(BaseModel):
    """What is known of a file: the `key` of its inputs, the digest of its bytes, those of the run's files it was made
    from, and the digest of the `world` that it shows."""

    model_config = ConfigDict(extra="forbid")

    key: str
    sha256: Digest
    inputs: dict[str, Digest] = {}
    world: str = ""


class Making(BaseModel):
    """How an image was made, as `render.view.Making` says it."""

    mode: str
    samples: float = 0.0
    noise: float = 0.0
    over_target: float = 0.0


class Notes(BaseModel):
    """Facts about a run: how long stages took, how images were made, and whatever else was noted."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)

    time_s: dict[str, float] = {}
    images: dict[str, Making] = {}
    warnings: list[str] = []
    versions: dict[str, str] = {}


class _Book(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    format: Annotated[int, Field(ge=1, le=FORMAT)] = 1
    program: str = ""
    made: str = ""
    notes: Notes = Notes()
    files: dict[str, Entry] = {}
    coming: dict[str, list[Digest]] = {}


class Ledger:
    """`run.json`: for each file of a run, the key of its inputs and the digest of its bytes; and notes on the run.

    What the ledger did not write is somebody else's, and is never written over. So that this holds even when the
    process is killed between putting a file in its place and entering it, the digest of a file that is about to come
    is written first.
    """

    def __init__(self, folder: Path):
        self.folder, self.path = folder, folder / "run.json"
        self.damaged = False
        """Whether there was a ledger that nobody can read: nothing is known to be good, so everything is made again."""
        try:
            book = _Book.model_validate_json(read_text(self.path))
        except (FileNotFoundError, NotADirectoryError):
            book = _Book()
        except (ValidationError, ValueError):
            book, self.damaged = _Book(), True
        self.files, self.coming = book.files, book.coming
        self.notes: dict[str, Any] = book.notes.model_dump(exclude_unset=True)

    def fresh(self, name: str, key: str) -> bool:
        """Whether the file was made from these inputs and is undamaged."""
        entry = self.files.get(name)
        return entry is not None and entry.key == key and self.undamaged(name)

    def undamaged(self, name: str) -> bool:
        """Whether the file's bytes are those that were entered."""
        entry, path = self.files.get(name), self.folder / name
        return entry is not None and path.is_file() and file_digest(path) == entry.sha256

    def foreign(self, name: str) -> bool:
        """Whether a sound file lies here that this ledger did not write."""
        path, entry = self.folder / name, self.files.get(name)
        if not path.is_file():
            return False
        sha = file_digest(path)
        ours = sha in self.coming.get(name, []) or (entry is not None and sha == entry.sha256)
        return not ours and looks_whole(path)

    def place(self, parts: dict[str, Path], key: str, inputs: list[Path] | None = None, world: str = "") -> None:
        """Put finished parts in the places of the files they are named after, and enter them.

        Raises `TestfieldError` where somebody else's file lies there with other bytes.
        """
        sha = {name: file_digest(part) for name, part in parts.items()}
        for name, part in parts.items():
            settle(part)
            target = self.folder / name
            inside(self.folder, target)
            if self.foreign(name) and file_digest(target) != sha[name]:
                raise TestfieldError(
                    "a file that was not made here, or was changed since, would be written over",
                    str(target),
                    "move it away, or delete it to have it made again",
                )
        for name in parts:
            self.coming.setdefault(name, []).append(sha[name])
        self.save()
        made_from = {str(path.relative_to(self.folder)): file_digest(path) for path in inputs or []}
        for name, part in parts.items():
            part.replace(self.folder / name)
            del self.coming[name]
            self.files[name] = Entry(key=key, sha256=sha[name], inputs=made_from, world=world)
        self.save()

    def make(
        self,
        name: str,
        key: str,
        write: Callable[[Path], None],
        inputs: list[Path] | None = None,
        world: str = "",
    ) -> bool:
        """Have `write` make the file unless it is fresh; returns whether it was made. Raises as `place` does."""
        if self.fresh(name, key):
            self.shows(name, world)
            return False
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        inside(self.folder, path)
        with ExitStack() as after:
            part = part_path(path)
            after.callback(part.unlink, missing_ok=True)
            write(part)
            self.place({name: part}, key, inputs, world)
        return True

    def shows(self, name: str, world: str) -> None:
        """Enter which world a fresh file shows: the same image may be right for more than one scene."""
        if self.files[name].world != world:
            self.files[name].world = world
            self.save()

    def note(self, **notes: Any) -> None:
        """Record facts about the run."""
        self.notes.update(notes)
        self.save()

    def save(self) -> None:
        """Write the ledger."""
        files = {name: entry.model_dump(exclude_defaults=True) for name, entry in sorted(self.files.items())}
        with whole(self.path) as path:
            write_text(
                path, json.dumps(stamp() | {"notes": self.notes, "files": files, "coming": self.coming}, indent=1)
            )


def inside(folder: Path, path: Path) -> None:
    """Raise `TestfieldError` where a path leads out of its folder by a symbolic link."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise TestfieldError(
            f"this is a link out of the run's folder, to {path.resolve()}", str(path), "put the file itself here"
        )
