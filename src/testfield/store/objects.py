"""Files by name, in a folder or in object storage: whole or absent, seen by all who work on the same table.

A folder is reached without any package; a URL with a protocol, as s3://bucket/place, through fsspec. Object storage
puts an object in its place at once, a folder does by renaming, so that nobody ever reads half a file.
"""

import os
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from testfield.errors import TestfieldError
from testfield.store.atomic import whole
from testfield.store.disk import GOES_ON

T = TypeVar("T")
FOLDERS = frozenset({"local", "file", "memory", "sftp", "ssh", "smb", "hdfs", "webhdfs", "ftp"})
"""Protocols of storage whose folders are more than a part of names. Elsewhere a misspelt URL would make a bucket."""


@dataclass(frozen=True)
class Objects:
    """Files below `where`, a folder or a URL; names have slashes. Travels to other processes and machines."""

    where: str

    @property
    def folder(self) -> Path | None:
        """The folder, None of object storage."""
        scheme, _, rest = self.where.partition("://")
        return Path(self.where) if not rest else Path(rest) if scheme == "file" else None

    def names(self, under: str) -> set[str]:
        """Names of the files right below a folder `under`, without it. One request for every thousand in object
        storage, so ask for all at once rather than for each."""
        if self.folder is not None:
            try:
                with os.scandir(self.folder / under) as found:
                    return {one.name for one in found if not one.name.startswith(".")}
            except FileNotFoundError:
                return set()
        try:
            found = self._asked(lambda: self._system.ls(self._at(under), detail=False, refresh=True))
        except FileNotFoundError:
            return set()
        names = {str(one).rstrip("/").rpartition("/")[2] for one in found}
        return {name for name in names if not name.startswith(".")}

    def there(self, name: str) -> bool:
        """Whether there is such a file."""
        if self.folder is not None:
            return (self.folder / name).is_file()
        return bool(self._asked(lambda: self._system.exists(self._at(name))))

    def read(self, name: str) -> bytes:
        """A file's bytes. Raises `FileNotFoundError`."""
        if self.folder is not None:
            return (self.folder / name).read_bytes()
        return bytes(self._asked(lambda: self._system.cat_file(self._at(name))))

    def write(self, name: str, content: bytes) -> None:
        """Put a file in its place. Raises `TestfieldError` where object storage refuses, `OSError` where a folder
        does."""
        if self.folder is not None:
            with whole(self.folder / name) as path:
                path.write_bytes(content)
            return
        self._asked(lambda: self._put(self._at(name), content))

    def remove(self, name: str) -> None:
        """Take a file away where there is one."""
        if self.folder is not None:
            (self.folder / name).unlink(missing_ok=True)
        else:
            with suppress(FileNotFoundError):
                self._asked(lambda: self._system.rm_file(self._at(name)))

    def check(self) -> None:
        """Raises as `write` does where nothing can be written."""
        name = f".asked-{uuid.uuid4().hex}"
        self.write(name, b"")
        self.remove(name)

    def _put(self, path: str, content: bytes) -> None:
        try:
            self._system.pipe_file(path, content)
        except FileNotFoundError as error:
            spoken = self._system.protocol  # one name or several
            if not FOLDERS.intersection([spoken] if isinstance(spoken, str) else spoken):
                raise OSError(f"there is no such bucket: {error}") from error
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
            self._system.pipe_file(path, content)

    def _at(self, name: str) -> str:
        return f"{self._root}/{name}"

    def _asked(self, ask: Callable[[], T]) -> T:
        """What object storage answers; what it says no to, in a sentence."""
        try:
            return ask()
        except (FileNotFoundError, TestfieldError):
            raise
        except Exception as error:  # each kind of storage has errors of its own
            said = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise TestfieldError(
                f"the storage refuses this ({said})", self.where, f"mend it or choose another place; {GOES_ON}"
            ) from error

    @property
    def _root(self) -> str:
        return self._reached[1].rstrip("/")

    @property
    def _system(self) -> Any:
        return self._reached[0]

    @cached_property
    def _reached(self) -> tuple[Any, str]:
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise TestfieldError(
                "object storage needs fsspec", self.where, "install it: pip install 'testfield[cluster]'"
            ) from error
        try:
            return url_to_fs(self.where, use_listings_cache=False)
        except ImportError as error:  # of a protocol whose package is missing
            raise TestfieldError(f"{error}", self.where, "install it here and where workers run") from error
        except ValueError as error:
            raise TestfieldError(f"{error}", self.where, "give a folder, or a URL like s3://bucket/place") from error

    def __getstate__(self) -> dict[str, str]:
        return {"where": self.where}  # a connection does not travel
