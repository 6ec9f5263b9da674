"""Photographs as commands look at them: each detected once and kept, a line each, its picture under its own name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from testfield.detect.photograph import Found
    from testfield.measure.kept_detections import Kept, Look

KEPT = "detections"
"""The folder below a command's own in which detections are kept."""


@dataclass
class Looks:
    """What is seen in photographs that could be read, in their order: their `names`, which differ, what was `given` for
    each and its file, what was `found`, sizes (width, height), and `notes` on reading each; `unreadable` are files that
    could not be read."""

    names: list[str] = field(default_factory=list)
    given: list[Path] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    found: "list[Found]" = field(default_factory=list)
    sizes_px: list[tuple[int, int]] = field(default_factory=list)
    notes: list[tuple[str, ...]] = field(default_factory=list)
    unreadable: list[Path] = field(default_factory=list)


def look_at(
    files: Sequence[tuple[Path, Path]],
    look: "Look",
    out: Path,
    jobs: int,
    say: TextIO,
    name_of: Callable[[str, Path], str] = lambda stem, _: stem,
) -> Looks:
    """What is seen in `files` (folder as given, file), by so many processes; `name_of` a stem and a folder is what a
    photograph is called. Raises `TestfieldError` where a picture would be written over a photograph."""
    from testfield.measure.kept_detections import put_picture

    seen = Looks()
    for (folder, path), one in zip(files, _kept([path for _, path in files], look, out / KEPT, jobs, say), strict=True):
        if one.found is None:
            seen.unreadable.append(path)
            continue
        name = name_of(path.stem, folder)
        if name in seen.names:
            count = next(k for k in range(2, len(seen.names) + 3) if f"{name}-{k}" not in seen.names)
            name = f"{name}-{count}"
        refuse_over([file for _, file in files], out / f"{name}.png")
        put_picture(one, out / f"{name}.png")
        seen.names.append(name)
        seen.given.append(folder)
        seen.files.append(path)
        seen.found.append(one.found)
        seen.sizes_px.append(one.size_px)
        seen.notes.append(one.notes)
    return seen


def _kept(paths: Sequence[Path], look: "Look", folder: Path, jobs: int, say: TextIO) -> list["Kept"]:
    import sys

    from testfield.measure.kept_detections import detect_each
    from testfield.report.photograph import draw_found

    done = 0

    def tell(number: int, kept: "Kept", before: bool) -> None:
        nonlocal done
        done += 1
        if kept.found is None:
            print(f"testfield: {kept.trouble}", file=sys.stderr, flush=True)
            return
        head = f"{done} of {len(paths)}, {paths[number].name}: "
        print(f"{head}{kept.found.summary}{' (kept from before)' if before else ''}", file=say, flush=True)

    return detect_each(paths, look, folder, draw_found, jobs, tell)


def refuse_over(photographs: Sequence[Path], target: Path) -> None:
    """Raise `TestfieldError` where a picture would be written over one of the photographs."""
    from testfield.errors import TestfieldError

    if target.exists() and any(target.samefile(path) for path in photographs if path.exists()):
        raise TestfieldError("this photograph would be written over", str(target), "choose another folder with --out")


def images_in(what: Sequence[Path]) -> list[tuple[Path, Path]]:
    """The files named, and those in the folders named, in order, each with what was named.

    Raises `TestfieldError` for a folder without one.
    """
    from testfield.errors import TestfieldError

    kinds = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr", ".pgm", ".webp", ".jp2"}
    files: list[tuple[Path, Path]] = []
    for path in what:
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if p.suffix.lower() in kinds)
            if not inside:
                raise TestfieldError("no image in this folder", str(path), "give images or a folder of them")
            files += [(path, file) for file in inside]
        else:
            files.append((path, path))
    return files


def held_of(text: str, lens: str) -> tuple[str, ...]:
    """Lens coefficients that a command line holds at zero. Raises `TestfieldError` where the lens has no such one."""
    from testfield.camera.interior import check_held

    hold = tuple(name.strip() for name in text.split(",") if name.strip())
    check_held(hold, lens, "--hold")
    return hold


def check_shown(bayer: str | None, smallest_px: float, jobs: int) -> None:
    """Raise `TestfieldError` where an option that all commands of photographs have is wrong."""
    from testfield.camera.mosaic import ORDERS
    from testfield.errors import TestfieldError

    if bayer is not None and bayer not in ORDERS:
        raise TestfieldError(f"no Bayer order is called '{bayer}'", "--bayer", f"choose one of {', '.join(ORDERS)}")
    if not 2 <= smallest_px <= 200:
        raise TestfieldError(f"value {smallest_px}", "--smallest-px", "give 2 to 200")
    if jobs < 1:
        raise TestfieldError(f"value {jobs}", "--jobs", "give 1 or more")
