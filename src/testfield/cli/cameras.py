"""Which of several cameras took which photograph: by folder, or by a table in the field file."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from testfield.camera.exif import Exif, read_exif
from testfield.errors import TestfieldError, nearest
from testfield.measure.one_camera import Header
from testfield.measure.photographs import Taken
from testfield.targets.camera_sheet import CameraSheet, RigSheet
from testfield.targets.field_file import FieldFile


@dataclass(frozen=True)
class Owners:
    """Names of cameras by the folder of their photographs, each camera's lens, and the rigs that hold them."""

    by_folder: dict[Path, str]
    lens: dict[str, str]
    rigs: tuple[RigSheet, ...]

    def name_of(self, photograph: str, folder: Path) -> str:
        """What a photograph is called: photographs of one file name in several folders are several."""
        return f"{photograph}-{self.by_folder[folder]}"


def owners_of(given: list[Path], field: FieldFile, source: str, lens: str, by_folder: bool, rig: bool) -> Owners | None:
    """The cameras of the folders given; None where there is one camera.

    Raises `TestfieldError` where folders and the field file's [[cameras]] do not fit together.
    """
    if not (field.cameras or by_folder or rig):
        return None
    for path in given:
        if not path.is_dir():
            raise TestfieldError("this is no folder", str(path), "give one folder of photographs for each camera")
    if field.cameras:
        named = {one.folder or one.name: one for one in field.cameras}
        for path in given:
            if path.resolve().name not in named and str(path) not in named:
                raise TestfieldError(
                    f"no camera of {source} has its photographs in a folder '{path.resolve().name}'",
                    str(path),
                    nearest(path.resolve().name, named),
                )
        of = {path: named.get(str(path)) or named[path.resolve().name] for path in given}
        if missing := set(named) - {one.folder or one.name for one in of.values()}:
            raise TestfieldError(
                f"camera folder '{min(missing)}' was not given", f"{source}, cameras", "give the folders of all cameras"
            )
        rigs = tuple(RigSheet(one.name, one.cameras, (None,) * len(one.cameras)) for one in field.rigs)
        lenses = {one.name: one.lens or lens for one in field.cameras}
        return Owners({path: one.name for path, one in of.items()}, lenses, rigs)
    names = {path: path.resolve().name for path in given}
    if twice := [name for name, count in Counter(names.values()).items() if count > 1]:
        raise TestfieldError(f"two folders are called '{twice[0]}'", "--by-folder", "rename one: it names its camera")
    if len(names) < 2:
        raise TestfieldError(
            "one folder is one camera", "--by-folder", "give a folder for each camera, or leave it out"
        )
    held = tuple(names.values())
    rigs = (RigSheet("rig", held, (None,) * len(held)),) if rig else ()
    return Owners(names, dict.fromkeys(held, lens), rigs)


def taken_of(owners: Owners, folders: list[Path], places: list[str], sizes: list[tuple[int, int]]) -> Taken:
    """How photographs of these folders, file names and sizes were taken; each camera's size is its most common one."""
    names = [owners.by_folder[folder] for folder in folders]
    sheets = []
    for name in dict.fromkeys(names):
        width, height = Counter(s for s, own in zip(sizes, names, strict=True) if own == name).most_common(1)[0][0]
        sheets.append(CameraSheet(name, width, height, owners.lens[name]))
    return Taken(tuple(sheets), owners.rigs, tuple(names), tuple(places))


def headers_of(files: list[tuple[Path, Path]], owners: Owners | None) -> list[Header]:
    """What the headers of image files (their folder as it was given, their path) tell, of those that can be read."""
    return [
        Header(path.name, owners.by_folder[folder] if owners else "", exif)
        for folder, path in files
        if (exif := read_exif(path)) is not None
    ]


def decoded_of(names: list[str], cameras: tuple[str, ...] | None, sizes: list[tuple[int, int]]) -> list[Header]:
    """The same of images as they were decoded: their sizes alone."""
    owned = cameras or ("",) * len(names)
    return [Header(name, camera, Exif(size)) for name, camera, size in zip(names, owned, sizes, strict=True)]
