"""Detections in photographs that are kept as they are finished: a kill loses the images at hand, a second run none.

Each stands in a file named after the digest of all that it depends on: the image's bytes, what was asked for, and what
the code does. The same image under another name, or in another job with the same folder, is never looked at again.
"""

import json
import os
import shutil
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from testfield.camera.photograph import Photograph, read_photograph
from testfield.detect.observations import Observations
from testfield.detect.photograph import Found
from testfield.errors import DAMAGE, TestfieldError
from testfield.store.atomic import sweep, whole
from testfield.store.code import code_digest
from testfield.store.digests import digest, file_digest
from testfield.store.work import as_done


@dataclass(frozen=True)
class Look:
    """How every photograph is looked at: `function(photograph, *arguments)`, a function of a module, its arguments
    values that have a digest; `bayer` as of `read_photograph`."""

    function: Callable[..., Found]
    arguments: tuple
    bayer: str | None = None

    def key(self, path: Path) -> str:
        """The digest of all that a detection depends on. Raises `OSError` where there is no such file."""
        module = self.function.__module__
        code = code_digest(module, read_photograph.__module__)
        return digest(file_digest(path), module, self.function.__qualname__, self.arguments, self.bayer or "", code)


@dataclass(frozen=True)
class Kept:
    """What is known of one photograph: what was `found`, or the `trouble` for which it cannot be read; its
    `size_px` (width, height), the `notes` on reading it, and the `picture` of what was found."""

    found: Found | None
    size_px: tuple[int, int]
    notes: tuple[str, ...]
    picture: Path
    trouble: TestfieldError | None = None


Draw = Callable[[Photograph, Found, Path], None]


def detect_each(
    paths: Sequence[Path],
    look: Look,
    folder: Path,
    draw: Draw,
    jobs: int = 1,
    tell: Callable[[int, Kept, bool], None] = lambda *_: None,
) -> list[Kept]:
    """Detections in photographs, those that are not in `folder` yet by so many processes.

    `draw`, a function of a module, draws the picture of what was found. `tell` hears a photograph's number, what is
    known of it, and whether that was kept from before, as they become known. Raises `TestfieldError` where a process
    was ended from outside; all that was finished is kept.
    """
    sweep(folder)
    known: dict[int, Kept] = {}
    wanted: dict[Path, list[int]] = {}
    for k, path in enumerate(paths):
        try:
            file = folder / f"{look.key(path)[:32]}.npz"
        except OSError as error:
            trouble = TestfieldError(f"cannot be read ({error.strerror})", str(path), "give an image file")
            known[k] = Kept(None, (0, 0), (), path, trouble)
            tell(k, known[k], False)
            continue
        kept = _read(file, path)
        if kept is None:
            wanted.setdefault(file, []).append(k)
        else:
            known[k] = kept
            tell(k, kept, True)
    items = [(paths[rows[0]], file) for file, rows in wanted.items()]
    for number, _ in as_done(partial(_look, look, draw), items, jobs):
        file = items[number][1]
        for k in wanted[file]:
            kept = _read(file, paths[k])
            if kept is None:
                raise TestfieldError("what was just written cannot be read", str(file), "see to the disk")
            known[k] = kept
            tell(k, kept, False)
    return [known[k] for k in range(len(paths))]


def _look(look: Look, draw: Draw, item: tuple[Path, Path]) -> None:
    """Read, detect, draw, keep: what a process of the pool does with one photograph."""
    path, file = item
    try:
        photograph = read_photograph(path, look.bayer)
    except TestfieldError as error:
        _write(file, Kept(None, (0, 0), (), file, error))
        return
    found = look.function(photograph, *look.arguments)
    picture = file.with_suffix(".png")
    with whole(picture) as part:
        draw(photograph, found, part)
    height, width = photograph.pixels.shape
    _write(file, Kept(found, (width, height), photograph.notes, picture))


def _write(file: Path, kept: Kept) -> None:
    said: dict[str, Any] = {"size_px": kept.size_px, "notes": kept.notes, "trouble": None}
    if kept.trouble is not None:
        said["trouble"] = (kept.trouble.what, kept.trouble.do)
    arrays: dict[str, np.ndarray] = {}
    if kept.found is not None:
        o, values = kept.found.observations, {}
        for column in fields(o):
            value = getattr(o, column.name)
            if isinstance(value, np.ndarray):
                arrays[column.name] = value.astype(str) if value.dtype == object else value
            else:
                values[column.name] = value
        arrays["place"] = kept.found.place
        said["found"] = {"notes": kept.found.notes, "passed_over": kept.found.passed_over, "observations": values}
    with whole(file) as part, part.open("wb") as to:
        np.savez_compressed(to, said=np.array(json.dumps(said)), **arrays)  # type: ignore[arg-type]


def _read(file: Path, path: Path) -> Kept | None:
    """What was kept of the photograph at `path`, under that one's name; None where nothing sound is."""
    picture = file.with_suffix(".png")
    try:
        with np.load(file, allow_pickle=False) as arrays:
            columns: dict[str, Any] = dict(arrays)
        said = json.loads(str(columns.pop("said")))
        size, notes = (int(said["size_px"][0]), int(said["size_px"][1])), tuple(said["notes"])
        if said["trouble"]:
            # The same bytes under another name have the same fault.
            what, do = said["trouble"]
            return Kept(None, size, notes, path, TestfieldError(what, str(path), do))
        if not picture.is_file():
            return None
        place, of_found = columns.pop("place"), said["found"]
        columns |= {name: tuple(v) if isinstance(v, list) else v for name, v in of_found["observations"].items()}
        columns["status"] = columns["status"].astype(object)
        observations = replace(Observations(**columns), stations=(path.stem,))
    except (zipfile.BadZipFile, *DAMAGE):
        return None
    found = Found(observations, place, tuple(of_found["notes"]), of_found["passed_over"])
    return Kept(found, size, notes, picture)


def put_picture(kept: Kept, path: Path) -> None:
    """The picture of what was found, under a name for people: a link to the same file where the disk has such."""
    if path.exists() and path.samefile(kept.picture):
        return
    with whole(path) as part:
        part.unlink(missing_ok=True)
        try:
            os.link(kept.picture, part)
        except OSError:
            shutil.copyfile(kept.picture, part)
