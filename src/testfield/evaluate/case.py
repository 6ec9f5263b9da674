"""A table of cases: plain data that say which scene with which changes, which noise, and how it is measured."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError
from testfield.measure.recipe import Recipe
from testfield.scene import codes
from testfield.scene.document import load_document
from testfield.scene.meshes import COPIES as MESHES
from testfield.scene.sky import COPY as SKY

MEASURE = "testfield.evaluate.measured:scorecard_row"


@dataclass(frozen=True)
class Case:
    """One case.

    `labels` name it and are the first columns of its rows; `work` is the "module:function" that measures it, given the
    case and its run; `scene` is a scene file as a plain table (None: the work needs none) and `options` are what the
    work is told besides (methods, subsets, exposures). `noise_seed` draws the frames' noise anew (None: the scene's
    own), in memory: such a case leaves its run's folder as rendering made it. `recipe` says how they are measured
    (None: as the scene asks). `folder` is what files are relative to that the scene names; where it lies does not
    count, what is in the files does. `weight` is the work in units of the table's own, for progress. `copies` are
    where these files lie on this machine, by the names of their copies, where that is not in `folder`.
    """

    labels: dict[str, Any]
    work: str = MEASURE
    scene: dict[str, Any] | None = None
    options: dict[str, Any] = field(default_factory=dict)
    weight: float = 1.0
    noise_seed: int | None = None
    recipe: Recipe | None = None
    folder: Path | None = None
    copies: Mapping[str, Path] | None = None

    @property
    def files(self) -> dict[str, Path]:
        """Files that the scene names, by where a run's folder keeps its copy of each; none of a scene without
        folder."""
        if self.copies is not None:
            return dict(self.copies)
        if self.scene is None or self.folder is None:
            return {}
        meshes, around = self.scene.get("meshes"), (self.scene.get("room") or {}).get("environment")
        named = [(f"{MESHES}/{one['name']}", one["file"]) for one in meshes or [] if {"name", "file"} <= one.keys()]
        named += [(SKY, around["file"])] if isinstance(around, dict) and "file" in around else []
        files = {f"{copy}{Path(file).suffix}": self.folder / file for copy, file in named}
        if isinstance(table := self.scene.get("code_table"), str):
            files[codes.copy_name(table)] = codes.codes_path(table, self.folder)
        return files


def case(
    scene: Path | dict[str, Any],
    changes: Mapping[str, Any] | None = None,
    *,
    noise_seed: int | None = None,
    recipe: Recipe | None = None,
    labels: dict[str, Any] | None = None,
) -> Case:
    """The case of a scene, from its file or as a plain table, with `changes` as `changed` takes them.

    It is labelled by the scene's name, the changes, the noise and the recipe's name where nobody names it otherwise.
    Raises `TestfieldError` where the file is no scene, or a change names no place in it.
    """
    changes = changes or {}
    whole = changed(scene_table(scene) if isinstance(scene, Path) else scene, changes)
    named = {"scene": whole.get("name", ""), **changes}
    named |= {} if noise_seed is None else {"noise_seed": noise_seed}
    named |= {} if recipe is None else {"recipe": recipe.name}
    folder = scene.parent if isinstance(scene, Path) else None
    labels = named if labels is None else labels
    return Case(labels=labels, scene=whole, noise_seed=noise_seed, recipe=recipe, folder=folder)


def scene_table(path: Path) -> dict[str, Any]:
    """A scene file as a plain table, with all that it includes."""
    return load_document(path).data


def changed(scene: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scene with some values set, each named by its path: `sensor.read_noise_e`, `boards.0.bend_mm`.

    Tables on the way are made where they are missing. Raises `TestfieldError` where a path leads through a value or
    past the end of a list.
    """
    copy = deepcopy(scene)
    for path, value in changes.items():
        place: Any = copy
        *way, last = path.split(".")
        try:
            for step in way:
                place = place[int(step)] if isinstance(place, list) else place.setdefault(step, {})
            place[int(last) if isinstance(place, list) else last] = deepcopy(value)
        except (TypeError, ValueError, IndexError, AttributeError) as error:
            raise TestfieldError("the scene has no such place", path, "name tables and places of lists") from error
    return copy
