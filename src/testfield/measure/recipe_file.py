"""A recipe's file: tables that name an algorithm, a command or a folder, checked and made a `Recipe`."""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import pydantic

from testfield.errors import TestfieldError, gather
from testfield.measure.outside import CALIBRATOR_GETS, DETECTOR_GETS, RECONSTRUCTOR_GETS, TIME_LIMIT_S, Program, Results
from testfield.measure.recipe import SMALLEST_DIAMETER_PX, Algorithm, Loaded, Recipe
from testfield.registry import load_file
from testfield.store.digests import file_digest
from testfield.store.faults import faults_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml

SEE = "see FORMATS.md, a recipe's file"


def read_recipe(path: Path) -> Recipe:
    """The recipe in a TOML file; paths in it are told from its folder. Raises `TestfieldError` as `Recipe.load`, of all
    faults together."""
    content = read_toml(path, "recipe")
    data = parse_toml(content, str(path))
    try:
        sheet = _RecipeFile.model_validate(data)
    except pydantic.ValidationError as error:
        raise faults_of(error, _RecipeFile, data, decoded(content), str(path), SEE) from error
    packages = tuple(sheet.environment.packages) if sheet.environment else ()
    names = [sheet.load] if isinstance(sheet.load, str) else sheet.load
    files = tuple(gather(*(partial(_loaded, path, name) for name in names)))
    found: dict[str, Any] = {}

    def take(part: str, make: Callable[[], Any]) -> Callable[[], None]:
        return lambda: found.update({part: make()})

    by_name = {"calibrator": Algorithm("stitched"), "reconstructor": Algorithm("gls")}
    outside = {
        "calibrator": ("calibrated_by", CALIBRATOR_GETS),
        "reconstructor": ("points_from", RECONSTRUCTOR_GETS),
    }
    checks = [
        take("centroid", lambda: _algorithm(sheet.centroid, path, "centroid")),
        take("detector", lambda: _part(sheet.detector, path, "detector", DETECTOR_GETS, packages)),
        take("finder", lambda: _algorithm(sheet.finder, path, "finder") if sheet.finder else None),
        take("decoder", lambda: _algorithm(sheet.decoder, path, "decoder") if sheet.decoder else None),
    ]
    for stage, (part, gets) in outside.items():
        table: _Table = getattr(sheet, stage)
        found[stage] = by_name[stage] if _outside(table) else _algorithm(table, path, stage)
        checks.append(take(part, partial(_from_outside, table, path, stage, gets, packages)))
    gather(*checks)
    recipe = Recipe(name=sheet.name or path.stem, smallest_diameter_px=sheet.smallest_diameter_px, files=files, **found)
    recipe.check(str(path))
    return recipe


def is_recipe(data: Mapping[str, Any], others: Collection[str]) -> bool:
    """Whether a TOML document is rather a recipe's than one of the kind that has the fields `others`."""
    own = set(_FIELDS) - set(others)
    return bool(own & data.keys()) and not (data.keys() & set(others)) - set(_FIELDS)


def _loaded(path: Path, name: str) -> Loaded:
    folder = path.resolve().parent
    if not (folder / name).is_file():
        raise TestfieldError(f"there is no file '{name}'", f"{path}, load", "name a Python file beside the recipe")
    load_file(folder / name)
    return Loaded((folder / name).resolve(), file_digest(folder / name))


class _Table(pydantic.BaseModel):
    """One of `name` (with options), `command` and `folder`."""

    model_config = pydantic.ConfigDict(extra="allow")
    name: str | None = None
    command: str | None = None
    folder: str | None = None
    time_limit_s: float | None = None

    @pydantic.model_validator(mode="after")
    def _one(self) -> "_Table":
        given = [key for key in ("name", "command", "folder") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of name, command and folder, not {' and '.join(given) or 'none'}")
        if self.name is None and self.model_extra:
            raise ValueError(f"a {given[0]} has no option '{next(iter(self.model_extra))}'")
        if self.command is None and self.time_limit_s is not None:
            raise ValueError("only a command has a time limit")
        return self


def _named(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


_Part = Annotated[_Table, pydantic.BeforeValidator(_named)]


class _EnvironmentTable(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    packages: Annotated[list[str], pydantic.Field(min_length=1)]


class _RecipeFile(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    name: str = ""
    load: str | list[str] = []
    environment: _EnvironmentTable | None = None
    detector: _Part | None = None
    finder: _Part | None = None
    centroid: _Part = _Table(name="forward_model")
    decoder: _Part | None = None
    calibrator: _Part = _Table(name="stitched")
    reconstructor: _Part = _Table(name="gls")
    smallest_diameter_px: float = pydantic.Field(SMALLEST_DIAMETER_PX, ge=3, le=1000)


_FIELDS = tuple(_RecipeFile.model_fields)


def _algorithm(table: _Table, path: Path, stage: str) -> Algorithm:
    if table.name is None:
        raise TestfieldError(
            f"a {stage} is an algorithm by name", f"{path}, {stage}", "a command or a folder can be the [detector]"
        )
    options = {key: tuple(v) if isinstance(v, list) else v for key, v in (table.model_extra or {}).items()}
    return Algorithm(table.name, options)


def _outside(table: _Table) -> bool:
    return table.name is None


def _part(
    table: _Table | None, path: Path, stage: str, gets: tuple[str, ...], packages: tuple[str, ...]
) -> Algorithm | Program | Results | None:
    if table is None:
        return None
    return _algorithm(table, path, stage) if table.name else _from_outside(table, path, stage, gets, packages)


def _from_outside(
    table: _Table, path: Path, stage: str, gets: tuple[str, ...], packages: tuple[str, ...]
) -> Program | Results | None:
    folder = path.resolve().parent
    if table.command is not None:
        limit = TIME_LIMIT_S if table.time_limit_s is None else table.time_limit_s
        return Program.of(table.command, folder, f"{path}, {stage}.command", gets, limit, packages)
    return None if table.folder is None else Results.of(folder / table.folder, f"{path}, {stage}.folder")
