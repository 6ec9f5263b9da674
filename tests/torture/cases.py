"""Mutated inputs: what may be damaged, by which strategy, and the command that reads it."""

import io
import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from hypothesis import strategies as st
from own import of_csv

WEIRD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.floats(-10, 10),
    st.sampled_from([1e300, -1e300, 1e-300, 2.0**63, 2**63, 10**30, 0.0, -0.0]),
    st.text(max_size=20),
    st.sampled_from(["", "$5^$ a", "../x", "a\nb", "x" * 5000, "station01", "nan", "\ud800"]),
    st.just([]),
    st.just({}),
    st.lists(st.floats(), max_size=4),
    st.lists(st.text(max_size=3), max_size=3),
    st.integers(50, 1500).map(lambda n: [json.loads("[" * min(n, 900) + "]" * min(n, 900))]),
)
"""Values that nobody expects."""


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Every container of a document with each of its keys or places."""
    found, left = [], [tree]
    while left:
        here = left.pop()
        for key in list(here) if isinstance(here, dict) else range(len(here)):
            found.append((here, key))
            if isinstance(here[key], (dict, list)):
                left.append(here[key])
    return found


def changed_tree(draw: Callable[[Any], Any], tree: Any) -> Any:
    """A document with one to three changes: a value replaced, taken away, doubled, or put where another was."""
    for _ in range(draw(st.integers(1, 3))):
        all_places = places(tree)
        if not all_places:
            break
        here, key = draw(st.sampled_from(range(len(all_places))).map(all_places.__getitem__))
        act = draw(st.sampled_from(["replace", "replace", "delete", "swap", "double", "rename"]))
        if act == "delete":
            del here[key]
        elif act == "swap":
            other, at = draw(st.sampled_from(range(len(all_places))).map(all_places.__getitem__))
            if other is not here[key] and at in (other if isinstance(other, dict) else range(len(other))):
                here[key] = json.loads(json.dumps(other[at], default=str))
        elif act == "double" and isinstance(here, list):
            here.append(here[key])
        elif act == "rename" and isinstance(here, dict):
            here[draw(st.text(max_size=8))] = here.pop(key)
        else:
            here[key] = draw(WEIRD)
    return tree


def changed_bytes(draw: Callable[[Any], Any], data: bytes) -> bytes:
    """Bytes with one to four changes: flipped, cut off, filled with zeros, doubled, or made up."""
    out = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        if not out:
            break
        at = draw(st.integers(0, len(out) - 1))
        at = draw(st.sampled_from([at, min(at, 200), len(out) - 1 - min(at, 200)]))
        length = draw(st.integers(1, 64))
        act = draw(st.sampled_from(["flip", "cut", "zero", "double", "new"]))
        if act == "flip":
            out[at] ^= draw(st.integers(1, 255))
        elif act == "cut":
            del out[at:]
        elif act == "zero":
            out[at : at + length] = bytes(length)
        elif act == "double":
            out[at:at] = out[at : at + length]
        else:
            out[at : at + length] = draw(st.binary(min_size=length, max_size=length))
    return bytes(out)


def of_toml(draw: Callable[[Any], Any], data: bytes) -> bytes:
    """A changed TOML document, now and then changed as text."""
    if draw(st.integers(0, 4)) == 0:
        return changed_bytes(draw, data)
    tree = changed_tree(draw, tomllib.loads(data.decode()))
    try:
        return tomli_w.dumps(_without_none(tree)).encode(errors="surrogatepass")
    except (RecursionError, TypeError, ValueError):
        return changed_bytes(draw, data)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _without_none(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_without_none(v) for v in value]
    return "none" if value is None else value


def of_json(draw: Callable[[Any], Any], data: bytes) -> bytes:
    """A changed JSON document, now and then changed as text."""
    if draw(st.integers(0, 4)) == 0:
        return changed_bytes(draw, data)
    return json.dumps(changed_tree(draw, json.loads(data))).encode()


def of_parquet(draw: Callable[[Any], Any], data: bytes) -> bytes:
    """A Parquet file with a changed column, changed notes, other rows, or changed bytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    act = draw(st.sampled_from(["bytes", "drop", "text", "null", "value", "rows", "none", "notes", "rename"]))
    if act == "bytes":
        return changed_bytes(draw, data)
    table = pq.read_table(io.BytesIO(data))
    notes, k = table.schema.metadata or {}, draw(st.integers(0, table.num_columns - 1))
    name, values = table.column_names[k], table.column(k).to_pylist()
    row = draw(st.integers(0, max(len(values) - 1, 0)))
    if act == "drop":
        table = table.drop_columns([name])
    elif act == "text":
        table = table.set_column(k, name, pa.array([str(v) for v in values]))
    elif act in ("null", "value") and values:
        number = draw(st.one_of(st.floats(), st.sampled_from([1e300, -1.0, 0.0, 1e18])))
        values[row] = None if act == "null" else "other" if isinstance(values[row], str) else number
        try:
            table = table.set_column(k, name, pa.array(values))
        except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
            return changed_bytes(draw, data)
    elif act == "rows":
        table = pa.concat_tables([table, table.slice(row, draw(st.integers(1, 3)))])
    elif act == "none":
        table = table.slice(0, draw(st.integers(0, 3)))
    elif act == "rename":
        table = table.rename_columns([*table.column_names[:k], "other", *table.column_names[k + 1 :]])
    elif act == "notes":
        notes = {key: draw(st.binary(max_size=9)) for key in notes if draw(st.booleans())}
    out = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(notes), out)
    return out.getvalue()


@dataclass(frozen=True)
class Reader:
    """A file of a sound folder, how it is changed, and the command that reads it then; `{}` is the folder."""

    file: str
    change: Callable[[Callable[[Any], Any], bytes], bytes]
    command: tuple[str, ...]
    without: tuple[str, ...] = ()
    """Files taken away first, so that the command has something to do."""


MEASURE = "measure with"
"""In the place of a command, what measures a run with a recipe (`own.measure_with`)."""
READERS = {
    "scene": Reader("scene.toml", of_toml, ("validate", "{}/scene.toml")),
    "scene of a run": Reader("scene.toml", of_toml, ("score", "{}"), ("scorecard.json",)),
    "scene with a mesh": Reader("mesh/scene.toml", of_toml, ("validate", "{}/mesh/scene.toml")),
    **{
        f"mesh, {kind}": Reader(f"mesh/body.{kind}", changed_bytes, ("validate", f"{{}}/mesh/{kind}.toml"))
        for kind in ("stl", "obj", "ply", "glb")
    },
    "field file": Reader(
        "photo/field.toml", of_toml, ("measure", "{}/photo/a.png", "--field", "{}/photo/field.toml", "--out", "{}/out")
    ),
    **{
        f"photograph, {kind}": Reader(
            f"photo/a.{kind}",
            changed_bytes,
            ("detect", f"{{}}/photo/a.{kind}", "--target", "ring14", "--out", "{}/out"),
        )
        for kind in ("png", "jpg", "tif", "exr", "bmp")
    },
    "radiance": Reader(
        "radiance/station01.exr",
        changed_bytes,
        ("expose", "{}", "--jobs", "1"),
        ("frames/station01.png", "frames/station01.json"),
    ),
    "frame": Reader("frames/station01.png", changed_bytes, ("detect", "{}", "--jobs", "1"), ("observations.parquet",)),
    "sensor sheet": Reader(
        "frames/station01.json", of_json, ("detect", "{}", "--jobs", "1"), ("observations.parquet",)
    ),
    "observations": Reader("observations.parquet", of_parquet, ("calibrate", "{}"), ("calibration.json",)),
    "observations, twice": Reader("observations.parquet", of_parquet, ("reconstruct", "{}"), ("points.parquet",)),
    "calibration": Reader("calibration.json", of_json, ("reconstruct", "{}"), ("points.parquet",)),
    "calibration, scored": Reader("calibration.json", of_json, ("score", "{}"), ("scorecard.json",)),
    "field sheet": Reader("field.json", of_json, ("reconstruct", "{}"), ("points.parquet",)),
    "points": Reader("points.parquet", of_parquet, ("score", "{}"), ("scorecard.json",)),
    "points, accepted": Reader("points.parquet", of_parquet, ("accept", "{}", "--a-mm", "1")),
    "scorecard": Reader("scorecard.json", of_json, ("report", "{}"), ("report.html",)),
    "ledger": Reader("run.json", of_json, ("report", "{}"), ("report.html",)),
    "recipe": Reader("own/recipe.toml", of_toml, ("validate", "{}/own/recipe.toml")),
    "comparison": Reader("own/comparison.toml", of_toml, ("validate", "{}/own/comparison.toml")),
    "algorithm of one's own": Reader("own/brightest.py", changed_bytes, ("validate", "{}/own/recipe.toml")),
    "centres of a program": Reader("own/centres.csv", of_csv, (MEASURE, "{}", "{}/own/program.toml")),
    "centres made elsewhere": Reader("own/detector/station01.csv", of_csv, (MEASURE, "{}", "{}/own/detector.toml")),
    "export sheet": Reader("own/detector/export.json", of_json, (MEASURE, "{}", "{}/own/detector.toml")),
    "camera of a program": Reader("own/calibrator/camera.json", of_json, (MEASURE, "{}", "{}/own/calibrating.toml")),
    "camera made elsewhere": Reader("own/calibrator/camera.json", of_json, (MEASURE, "{}", "{}/own/calibrator.toml")),
    "points of a program": Reader(
        "own/reconstructor/points.csv", of_csv, (MEASURE, "{}", "{}/own/reconstructing.toml")
    ),
    "points made elsewhere": Reader(
        "own/reconstructor/points.csv", of_csv, (MEASURE, "{}", "{}/own/reconstructor.toml")
    ),
}


def sound(reader: Reader, folder: Path) -> bytes:
    """The bytes of a reader's file before anything is changed."""
    return (folder / reader.file).read_bytes()
