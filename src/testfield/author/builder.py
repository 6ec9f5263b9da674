"""A scene written in Python, part by part, in the order and with the names in which its file reads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import tomlkit
from pydantic import BaseModel

from testfield.author.station_lists import Stations
from testfield.errors import Faults, TestfieldError, faults_in, nearest
from testfield.scene.board_parts import BoardPart
from testfield.scene.camera_parts import CameraPart, ExposurePart, NamedCameraPart, RigPart, SensorPart
from testfield.scene.changes import Change, locate
from testfield.scene.declared import FIELD
from testfield.scene.document import Document, files_seen_from, load_document, read_document
from testfield.scene.load import scene_from
from testfield.scene.room_parts import AreaLightPart, MeshPart, PaintPart, PointLightPart, RoomPart, SurfacePart
from testfield.scene.schema import MeasurePart, RenderPart, SceneFile, VolumePart
from testfield.scene.shipped import find_scene
from testfield.scene.target_parts import CheckGrid, CheckOnBoard, CheckOnMesh, CheckRandom, CheckSingle, ScaleBarPart
from testfield.store.faults import place_of
from testfield.store.text import write_text
from testfield.store.toml_lines import Location

Point = Sequence[float]
TARGETS: dict[str, type[BaseModel]] = {
    "single": CheckSingle,
    "on_board": CheckOnBoard,
    "grid": CheckGrid,
    "random": CheckRandom,
    "on_mesh": CheckOnMesh,
}

LIGHT_PARTS: dict[str, type[BaseModel]] = {"area": AreaLightPart, "point": PointLightPart}


@dataclass
class SceneText:
    """The text of a scene that is being written: `document`, with comments where it was loaded; files that it names are
    relative to `folder`, and `path` is where it came from. Every method of a part returns the scene itself.

    A field that does not exist raises `TestfieldError` at once, with the nearest name, and `set` refuses a value that
    is wrong for itself; all values are checked together by `check`, `save` and whatever uses the scene.
    """

    document: tomlkit.TOMLDocument
    folder: Path
    path: Path | None = None

    def __init__(self, name: str, description: str = "", **fields: Any) -> None:
        self.document, self.folder, self.path = tomlkit.document(), Path(), None
        self._fill(self.document, SceneFile, {"name": name, "description": description or None, **fields})

    @classmethod
    def load(cls, scene: str | Path) -> Self:
        """The scene at a path, or the one of that name that comes along. Raises `TestfieldError` where none is."""
        path = find_scene(scene)
        content = load_document(path).parts[0].text
        made = cls.__new__(cls)
        made.document, made.folder, made.path = tomlkit.parse(content), path.parent, path
        return made

    @property
    def name(self) -> str:
        """The scene's name."""
        return str(self.document.get("name", "scene"))

    # ---------------------------------------------------------------- parts

    def set(self, path: str, value: Any) -> Self:
        """Set a field by its path, as `--set` does: `set("boards.A.bow_mm", 2)`. Comments stay.

        Raises `TestfieldError` for a field that there is not, and for a value that it cannot have, whatever else is
        missing or wrong; the scene is as before.
        """
        location: list[Any] = list(locate(self.document, Change(path, value), f"{self.name}.set"))
        self._refuse(tuple(location), value, f"{self.name}.set {path}")
        inside: Any = self.document
        for step in location[:-1]:
            inside = inside.setdefault(step, tomlkit.table()) if isinstance(inside, dict) else inside[step]
        if not isinstance(inside, (dict, list)):
            raise TestfieldError("the scene has no such place", f"{self.name}.set {path}", "name tables and entries")
        inside[location[-1]] = value
        return self

    def include(self, *files: str) -> Self:
        """Include other files, relative to where the scene is saved."""
        self.document["include"] = [*self.document.get("include", []), *files]
        return self

    def kind(self, name: str, **fields: Any) -> Self:
        """Declare a kind that parts may be of."""
        self._fill(self._table("kinds").setdefault(name, tomlkit.table()), None, fields)
        return self

    def volume(self, size_mm: Point) -> Self:
        """The measuring volume."""
        return self._one("volume", VolumePart, {"size_mm": size_mm})

    def camera(
        self, name: str | None = None, *, kind: str | None = None, focal_length_mm: float | None = None, **fields: Any
    ) -> Self:
        """The camera or, with a `name`, one of several; a `kind` is declared here or in the catalogue."""
        given = {FIELD: kind, "focal_length_mm": focal_length_mm, **fields}
        if name is None:
            return self._one("camera", CameraPart, given)
        return self._entry("cameras", NamedCameraPart, {"name": name, **given})

    def sensor(self, preset: str | None = None, **fields: Any) -> Self:
        """The sensor."""
        return self._one("sensor", SensorPart, {"preset": preset, **fields})

    def exposure(self, time_ms: float, **fields: Any) -> Self:
        """The exposure."""
        return self._one("exposure", ExposurePart, {"time_ms": time_ms, **fields})

    def rig(self, name: str, cameras: Sequence[dict[str, Any]]) -> Self:
        """What holds cameras together: `[{"camera": "left", "position_mm": [-300, 0, 0]}, ...]`."""
        return self._entry("rigs", RigPart, {"name": name, "cameras": cameras})

    def paint(self, **fields: Any) -> Self:
        """What marks are made of."""
        return self._one("paint", PaintPart, fields)

    def room(self, ambient_w_m2_sr: float | None = None, **fields: Any) -> Self:
        """What is around."""
        return self._one("room", RoomPart, {"ambient_w_m2_sr": ambient_w_m2_sr, **fields})

    def surface(self, name: str, size_mm: Point, position_mm: Point, normal: Point, **fields: Any) -> Self:
        """A floor, a wall, a screen."""
        given = {"name": name, "size_mm": size_mm, "position_mm": position_mm, "normal": normal, **fields}
        return self._entry("surfaces", SurfacePart, given, self._table("room"))

    def light(self, position_mm: Point, *, kind: str = "area", **fields: Any) -> Self:
        """A light: an area, a point, or a kind of the catalogue."""
        model = LIGHT_PARTS.get(kind)
        return self._entry("lights", model, {FIELD: kind, "position_mm": position_mm, **fields}, self._table("room"))

    def board(
        self,
        name: str,
        position_mm: Point | None = None,
        *,
        kind: str | None = None,
        first_code: int | None = None,
        **fields: Any,
    ) -> Self:
        """A board; `first_code` is that of its recognition zone."""
        zone = {**fields.pop("recognition_zone", {}), **({"first_code": first_code} if first_code else {})}
        given = {"name": name, FIELD: kind, "position_mm": position_mm, **fields}
        return self._entry("boards", BoardPart, given | ({"recognition_zone": zone} if zone else {}))

    def bar(
        self,
        name: str,
        length_mm: float | None = None,
        codes: tuple[int, int] | None = None,
        position_mm: Point | None = None,
        *,
        role: str | None = "control",
        **fields: Any,
    ) -> Self:
        """A scale bar with a coded target at either end."""
        given = {"name": name, "role": role, "length_mm": length_mm, "codes": codes, "position_mm": position_mm}
        return self._entry("scale_bars", ScaleBarPart, {**given, **fields})

    def mesh(self, name: str, file: str, **fields: Any) -> Self:
        """A body from a mesh file."""
        return self._entry("meshes", MeshPart, {"name": name, "file": file, **fields})

    def target(self, code: int, position_mm: Point, **fields: Any) -> Self:
        """One check target."""
        return self._entry("check_targets", CheckSingle, {"code": code, "position_mm": position_mm, **fields})

    def targets(self, generator: str, **fields: Any) -> Self:
        """Check targets by a generator: grid, random, on_mesh, on_board."""
        if generator not in TARGETS:
            raise TestfieldError(
                f"no generator is called '{generator}'", f"{self.name}.targets", nearest(generator, TARGETS)
            )
        return self._entry("check_targets", TARGETS[generator], {"generator": generator, **fields})

    def stations(self, *lists: Stations) -> Self:
        """Where cameras stand: `ring`, `arc`, `grid`, `station`, ..."""
        for one in lists:
            self._entry("stations", one.model, {"generator": one.generator, **one.fields})
        return self

    def measure(self, **fields: Any) -> Self:
        """Which algorithms measure."""
        return self._one("measure", MeasurePart, fields)

    def render(self, **fields: Any) -> Self:
        """How images are computed."""
        return self._one("render", RenderPart, fields)

    # ---------------------------------------------------------------- uses

    def text(self) -> str:
        """The scene file."""
        return tomlkit.dumps(self.document)

    def described(self) -> Document:
        """The scene as it would be read from its file."""
        return read_document(self.text(), str(self.path or self.name), self.folder)

    def check(self) -> SceneFile:
        """The scene as a checked value. Raises `TestfieldError` with all that is wrong with it."""
        return scene_from(self.described())

    def save(self, path: str | Path | None = None, force: bool = False) -> Path:
        """Write the scene file; without a path, where it was loaded from. Files that it names are named from there.

        Raises `TestfieldError` where the scene is wrong or, without `force`, another file exists.
        """
        place = Path(path) if path is not None else self.path
        if place is None:
            raise TestfieldError("this scene was never saved", self.name, "give a path")
        own = self.path is not None and place.resolve() == self.path.resolve()
        if place.exists() and not own and not force:
            raise TestfieldError("this file exists", str(place), "give another name, or force=True")
        if not place.parent.is_dir():
            raise TestfieldError("no such folder", str(place.parent), "make it first")
        self.check()
        files_seen_from(self.document, self.folder, place.parent)
        write_text(place, self.text())
        self.path, self.folder = place, place.parent
        return place

    # ---------------------------------------------------------------- how

    def _refuse(self, location: Location, value: Any, where: str) -> None:
        """Raise `TestfieldError` for what is wrong at a location, or below, if it has this value."""
        place = place_of(location)
        try:
            scene_from(self.described().with_values({location: _plain(value)}, {}))
        except TestfieldError as error:
            own = [one for one in faults_in(error) if _is_at(one.where.rpartition(", ")[2], place)]
            if own and location[-1] != FIELD:  # a kind may be declared later
                told = [TestfieldError(one.what, where, one.do) for one in own]
                raise (told[0] if len(told) == 1 else Faults(told)) from error

    def _one(self, key: str, model: type[BaseModel], fields: dict[str, Any]) -> Self:
        self._fill(self._table(key), model, fields)
        return self

    def _table(self, key: str) -> Any:
        return self.document.setdefault(key, tomlkit.table())

    def _entry(self, key: str, model: type[BaseModel] | None, fields: dict[str, Any], inside: Any = None) -> Self:
        """Add an entry of a list or, where one has its name, change that."""
        table = self.document if inside is None else inside
        listed = table.setdefault(key, tomlkit.aot())
        there = [one for one in listed if fields.get("name") is not None and one.get("name") == fields["name"]]
        if there:
            self._fill(there[0], model, fields)
            return self
        entry: Any = tomlkit.inline_table() if isinstance(listed, tomlkit.items.Array) else tomlkit.table()
        self._fill(entry, model, fields)
        listed.append(entry)
        return self

    def _fill(self, table: Any, model: type[BaseModel] | None, fields: dict[str, Any]) -> None:
        known = None if model is None else {*model.model_fields, FIELD}
        for name, value in fields.items():
            if known is not None and name not in known:
                raise TestfieldError(f"unknown field '{name}'", f"{self.name}, {_called(model)}", nearest(name, known))
            if value is not None:
                table[name] = _plain(value)


def _is_at(found: str, place: str) -> bool:
    return found == place or found.startswith((f"{place}.", f"{place}["))


def _called(model: Any) -> str:
    return str(model.__name__).removesuffix("Part")


def _plain(value: Any) -> Any:
    """Lists of lists and tables in the place of tuples, arrays and NumPy's numbers."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update({key: _plain(one) for key, one in value.items() if one is not None})
        return inline
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return value
