"""Where frames come from: a folder whose names tell, a table (CSV or TOML), or an EMVA 1288 descriptor file."""

import csv
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from testfield.characterise.camera_raw import CAMERA_RAW, read_camera_raw
from testfield.characterise.series import Level, Series
from testfield.errors import TestfieldError
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml

IMAGES = (".png", ".tif", ".tiff", ".bmp", ".pgm", ".raw", *CAMERA_RAW)
PER_MS = {"ns": 1e-6, "us": 1e-3, "µs": 1e-3, "ms": 1.0, "s": 1e3}
TIME = re.compile(r"(?<![\dA-Za-z.])(\d+(?:\.\d+)?)\s*(ns|us|µs|ms|s)(?![A-Za-z])")
PHOTONS = re.compile(r"(?<![\dA-Za-z.])(\d+(?:\.\d+)?)\s*photons?(?![A-Za-z])", re.IGNORECASE)
DARK = re.compile(r"(?<![A-Za-z])(dark|darks|bias)(?![A-Za-z])", re.IGNORECASE)
SHORTEST_LONGEST_MS = 0.02
"""A series of exposures whose longest is shorter than this is in another unit of time, most likely."""
OF_SERIES = ("bits", "bayer", "width_px", "height_px", "wavelength_nm", "pixel_pitch_um", "levels")
OF_LEVEL = ("images", "time_ms", "light", "photons")


def series_of(path: Path, time_unit: str | None = None) -> Series:
    """The frames that a path names. `time_unit` of a descriptor's exposure times, ns where absent as its reference
    implementation has it. Camera raw files tell the order of their colour filters.

    Raises `TestfieldError` where the path is none of the forms, or frames are missing.
    """
    found = _series_of(path, time_unit)
    first = found.levels[0].images[0]
    if found.bayer is None and first.suffix.lower() in CAMERA_RAW:
        return replace(found, bayer=read_camera_raw(first)[1])
    return found


def _series_of(path: Path, time_unit: str | None) -> Series:
    if path.is_dir():
        tables = [path / name for name in ("sensor_frames.toml", "sensor_frames.csv") if (path / name).is_file()]
        return _series_of(tables[0], time_unit) if tables else _of_folder(path)
    if not path.exists():
        raise TestfieldError("no such file or folder", str(path), "name a folder of frames, or a table of them")
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return _of_toml(path)
    try:
        text = decoded(path.read_bytes())
    except UnicodeDecodeError as error:
        raise TestfieldError("this is no text", str(path), "name a folder, a .toml, a .csv, or a descriptor") from error
    return _of_csv(text, path) if suffix == ".csv" else _of_descriptor(text, path, time_unit)


def _of_folder(folder: Path) -> Series:
    """Frames below a folder: `dark` in a name or in a folder's says that no light fell, `10ms` how long, `1500photons`
    how much light. Without photons the light is taken as steady, so that it goes with the time."""
    groups: dict[tuple, list[Path]] = {}
    for file in sorted(p for p in folder.rglob("*") if p.suffix.lower() in IMAGES and not p.name.startswith(".")):
        name = str(file.relative_to(folder).with_suffix("")).replace("_", " ")
        time, photons = TIME.search(name), PHOTONS.search(name)
        time_ms = float(time[1]) * PER_MS[time[2]] if time else None
        counted = float(photons[1]) if photons else None
        key = (str(file.parent), bool(DARK.search(name)), time_ms, counted)
        groups.setdefault(key, []).append(file)
    if not groups:
        raise TestfieldError("no frames here", str(folder), f"give images ({', '.join(IMAGES)})")
    bright = [key for key in groups if not key[1]]
    photons_given = bool(bright) and all(key[3] is not None for key in bright)
    timed = all(key[2] is not None for key in bright)
    levels = []
    for (_, dark, time_ms, counted), images in groups.items():
        light = 0.0 if dark else float("nan")
        if not dark and photons_given:
            light = float(counted or 0.0)
        elif not dark and timed:
            light = float(time_ms or 0.0)
        levels.append(Level(tuple(images), time_ms, light))
    notes = () if photons_given else ("the light is taken as steady: its amount goes with the exposure time",)
    if not photons_given and not timed:
        notes = ("nothing says how much light fell, so nothing is said of linearity",)
    return Series(tuple(levels), photons_given, str(folder), notes=notes)


def _of_csv(text: str, path: Path) -> Series:
    """A table with a row for each image: `image`, `time_ms`, and `photons` or `light` (0 for dark)."""
    rows = list(csv.DictReader(text.splitlines()))
    fields = set(rows[0]) if rows else set()
    kind = "photons" if "photons" in fields else "light"
    if not {"image", kind} <= fields:
        raise TestfieldError(
            f"columns are {', '.join(sorted(str(f) for f in fields)) or 'none'}",
            f"{path}:1",
            "give image, time_ms, and photons (or light, in any unit; 0 for dark)",
        )
    groups: dict[tuple[float | None, float], list[Path]] = {}
    for number, row in enumerate(rows, 2):
        where = f"{path}:{number}"
        time = row.get("time_ms") or ""
        key = (_number(time, f"{where}, time_ms") if time else None, _number(row[kind] or "", f"{where}, {kind}"))
        groups.setdefault(key, []).append(_there(path.parent, row["image"] or "", where))
    return Series(tuple(Level(tuple(images), *key) for key, images in groups.items()), kind == "photons", str(path))


def _of_toml(path: Path) -> Series:
    """`[[levels]]` of `images` (names or patterns), `time_ms`, and `photons` or `light`; what is said of the camera."""
    data = parse_toml(read_toml(path, "table of frames"), str(path))
    _known(data, OF_SERIES, str(path))
    listed = data.get("levels")
    if not isinstance(listed, list) or not listed or not all(isinstance(one, dict) for one in listed):
        raise TestfieldError("no [[levels]]", str(path), "give a [[levels]] for each light and exposure time")
    kinds = {"photons" if "photons" in one else "light" for one in listed}
    if len(kinds) > 1:
        raise TestfieldError("photons in some levels and light in others", f"{path}, levels", "give one of them")
    kind, levels = kinds.pop(), []
    for k, one in enumerate(listed):
        where = f"{path}, levels[{k}]"
        _known(one, OF_LEVEL, where)
        names = one.get("images", [])
        names = [names] if isinstance(names, str) else names
        images: list[Path] = []
        for name in names:
            found = sorted(path.parent.glob(str(name))) if any(c in str(name) for c in "*?[") else []
            images += found or [_there(path.parent, str(name), f"{where}.images")]
        time = one.get("time_ms")
        light = _number(one.get(kind, ""), f"{where}.{kind}")
        levels.append(Level(tuple(images), None if time is None else _number(time, f"{where}.time_ms"), light))
    size = (data.get("height_px"), data.get("width_px"))
    return Series(
        tuple(levels),
        kind == "photons",
        str(path),
        bits=_whole(data.get("bits"), f"{path}, bits"),
        bayer=data.get("bayer"),
        shape=(int(size[0]), int(size[1])) if all(isinstance(v, int) for v in size) else None,  # type: ignore[arg-type]
        wavelength_nm=data.get("wavelength_nm"),
        pixel_pitch_um=data.get("pixel_pitch_um"),
    )


def _of_descriptor(text: str, path: Path, time_unit: str | None) -> Series:
    """The EMVA 1288 descriptor format: `n` bits width height, `b` time photons, `d` time, `i` image, `v` version; times
    in ns. Public reference data sets have it (github.com/EMVA1288/datasets); the standard itself leaves files open, and
    one of these three sets has times that make no sense in ns."""
    levels: list[Level] = []
    bits, shape = None, None
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        where, (mark, _, rest) = f"{path}:{number}", line.partition(" ")
        words = rest.replace(",", ".").split()
        if mark == "i" and levels:
            image = _there(path.parent, str(PurePosixPath(rest.strip().replace("\\", "/"))), where)
            levels[-1] = replace(levels[-1], images=(*levels[-1].images, image))
        elif mark == "n" and len(words) == 3:
            bits, width, height = (int(_number(word, where)) for word in words)
            shape = (height, width)
        elif (mark == "b" and len(words) == 2) or (mark == "d" and len(words) == 1):
            numbers = [_number(word, where) for word in words]
            levels.append(Level((), numbers[0] * PER_MS[time_unit or "ns"], numbers[1] if mark == "b" else 0.0))
        elif mark not in ("v", "l"):
            raise TestfieldError(f"'{line[:60]}' is no line of an EMVA 1288 descriptor", where, "see FORMATS.md")
    longest = max((level.time_ms or 0.0 for level in levels), default=0.0)
    notes: tuple[str, ...] = ()
    if time_unit is None and 0 < longest < SHORTEST_LONGEST_MS:
        notes = (
            f"the longest exposure is {1000 * longest:.3g} µs with times in ns, as descriptors have them, which few "
            "cameras can: where the file means µs (--time-unit us), the dark current is a thousandth of what is stated",
        )
    return Series(tuple(levels), True, str(path), bits, None, shape, notes=notes)


def _there(folder: Path, name: str, where: str) -> Path:
    image = folder / name
    if not name or not image.is_file():
        raise TestfieldError(f"image '{name}' is not there", where, f"put it into {folder}, or mend the name")
    return image


def _number(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not 0 <= number < float("inf"):
        raise TestfieldError(f"'{value}' is no number of 0 or more", where, "give a number")
    return number


def _whole(value: Any, where: str) -> int | None:
    if value is not None and (not isinstance(value, int) or not 1 <= value <= 16):
        raise TestfieldError(f"value {value}", where, "give 1 to 16")
    return value


def _known(data: dict[str, Any], known: Iterable[str], where: str) -> None:
    for name in data:
        if name not in known:
            raise TestfieldError(f"no field is called '{name}'", where, f"known here: {', '.join(known)}")
