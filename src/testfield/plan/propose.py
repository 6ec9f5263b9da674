"""A scene file with the proposed stations: the text as it was, comments and all, with new stations at its end."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError
from testfield.plan.candidates import Candidates
from testfield.scene.document import load_document
from testfield.store.atomic import whole
from testfield.store.text import write_text


def write_proposal(
    source: Path, out: Path, candidates: Candidates, chosen: tuple[int, ...], force: bool, alone: bool = False
) -> None:
    """Write the scene at `source` with the chosen candidates as stations, beside its own ones or `alone`. Files that it
    names are found from there.

    Raises `TestfieldError` where `out` exists and is not to be overwritten.
    """
    if out.exists() and not force:
        raise TestfieldError("this file exists", str(out), "give another name, or --force")
    if not out.parent.is_dir():
        raise TestfieldError("no such folder", str(out.parent), "make it first")
    document = load_document(source)
    elsewhere = alone and any(part.lines.at(("stations",)) for part in document.parts[1:])
    text = (document.content if elsewhere else source.read_bytes()).decode()
    text = with_stations(text, candidates, chosen, source.parent, out.parent, alone)
    with whole(out) as part:
        write_text(part, text)


def with_stations(
    text: str,
    candidates: Candidates,
    chosen: tuple[int, ...],
    here: Path = Path(),
    there: Path = Path(),
    alone: bool = False,
) -> str:
    """A scene's text with stations added, or in the place of its own where they are to stand `alone`, its comments
    kept; relative files are named from the folder `there`."""
    import tomlkit

    document = tomlkit.parse(text)
    if "stations" not in document:  # all of them are in files that it includes
        document["stations"] = tomlkit.aot()
    stations: Any = document["stations"]
    inline = isinstance(stations, tomlkit.items.Array)
    if alone:
        stations = document["stations"] = tomlkit.array() if inline else tomlkit.aot()
    ends_on_a_line = inline and stations.as_string()[:-1].rstrip(" ").endswith("\n")
    for name, k in zip(_names(text, len(chosen)), chosen, strict=True):
        one: Any = tomlkit.inline_table() if inline else tomlkit.table()
        place = candidates.poses[k : k + 1].origin_mm[0]
        one["name"] = name
        one["position_mm"] = np.round(place, 1).tolist()
        one["look_at_mm"] = np.round(candidates.look_at_mm[k], 1).tolist()
        one["roll_deg"] = [float(candidates.roll_deg[k])]
        if inline:
            stations.add_line(one, indent="  ")  # each on a line of its own, however many there are
        else:
            stations.append(one)
    if inline and chosen and not ends_on_a_line:
        stations.add_line(indent="")
    if here.resolve() != there.resolve():
        if "include" in document:
            document["include"] = [os.path.relpath(here / str(name), there) for name in document["include"]]
        room: Any = document.get("room", {})
        for part in (*document.get("meshes", []), room.get("environment")):
            if isinstance(part, dict) and "file" in part and not Path(str(part["file"])).is_absolute():
                part["file"] = os.path.relpath(here / str(part["file"]), there)
    return tomlkit.dumps(document)


def _names(text: str, count: int) -> list[str]:
    """Names that the text does not contain."""
    free = (f"planned{k:02d}" for k in range(1, 10_000))
    return [name for name, _ in zip((name for name in free if name not in text), range(count), strict=False)]
