"""Cases that go to machines which share no folder with this one: their files go through object storage."""

import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

from testfield.evaluate.case import Case
from testfield.store.atomic import whole
from testfield.store.digests import file_digest
from testfield.store.objects import Objects

UNDER = "files"


def packed(case: Case, place: Objects) -> Case:
    """The case with the files that its scene names in object storage, under the digests of their bytes."""
    if not case.files:
        return case
    return replace(case, copies={name: Path(_sent(source, place)) for name, source in case.files.items()}, folder=None)


@cache
def _sent(source: Path, place: Objects) -> str:
    name = f"{UNDER}/{file_digest(source)}{source.suffix}"
    if not place.there(name):
        place.write(name, source.read_bytes())
    return name


def unpacked(case: Case, place: Objects, folder: Path) -> Case:
    """The case with its files in a folder of this machine."""
    if not case.copies:
        return case
    here = {name: folder / sent for name, sent in case.copies.items()}
    for name, path in here.items():
        if not path.is_file():
            with whole(path) as part:
                part.write_bytes(place.read(case.copies[name].as_posix()))
    return replace(case, copies=here)


def scratch_of(run: str | None) -> Path:
    """A folder of this process' own, gone when it ends, in which no other run than this one is left."""
    folder = Path(_scratch().name)
    for other in (folder / "runs").glob("*"):
        if other.name != run:
            shutil.rmtree(other, ignore_errors=True)
    return folder


@cache
def _scratch() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="testfield-")
