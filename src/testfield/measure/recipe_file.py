"""A recipe's file: tables that name an algorithm, a command or a folder, checked and made a `Recipe`."""

from pathlib import Path
from typing import Annotated, Any

import pydantic

from testfield.errors import TestfieldError, nearest
from testfield.measure.outside import CALIBRATOR_GETS, DETECTOR_GETS, RECONSTRUCTOR_GETS, TIME_LIMIT_S, Program, Results
from testfield.measure.recipe import SMALLEST_DIAMETER_PX, Algorithm, Loaded, Recipe
from testfield.registry import load_file
from testfield.store.digests import file_digest
from testfield.store.toml import parse_toml, read_toml


def read_recipe(path: Path) -> Recipe:
    """The recipe in a TOML file; paths in it are told from its folder. Raises `TestfieldError` as `Recipe.load`."""
    data = parse_toml(read_toml(path, "recipe"), str(path))
    try:
        sheet = _RecipeFile.model_validate(data)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        said = "unknown field" if first["type"] == "extra_forbidden" else first["msg"]
        said = said.removeprefix("Value error, ")
        raise TestfieldError(
            f"{said[0].lower()}{said[1:]}", f"{path}, {place}", nearest(str(first["loc"][-1]), list(_FIELDS))
        ) from error
    folder = path.resolve().parent
    files = []
    for name in [sheet.load] if isinstance(sheet.load, str) else sheet.load:
        if not (folder / name).is_file():
            raise TestfieldError(f"there is no file '{name}'", f"{path}, load", "name a Python file beside the recipe")
        load_file(folder / name)
        files.append(Loaded((folder / name).resolve(), file_digest(folder / name)))
    packages = tuple(sheet.environment.packages) if sheet.environment else ()
    recipe = Recipe(
        name=sheet.name or path.stem,
        centroid=_algorithm(sheet.centroid, path, "centroid"),
        calibrator=Algorithm("stitched") if _outside(sheet.calibrator) else _algorithm(sheet.calibrator, path, ""),
        reconstructor=Algorithm("gls") if _outside(sheet.reconstructor) else _algorithm(sheet.reconstructor, path, ""),
        smallest_diameter_px=sheet.smallest_diameter_px,
        detector=_part(sheet.detector, path, "detector", DETECTOR_GETS, packages),
        finder=_algorithm(sheet.finder, path, "finder") if sheet.finder else None,
        decoder=_algorithm(sheet.decoder, path, "decoder") if sheet.decoder else None,
        calibrated_by=_from_outside(sheet.calibrator, path, "calibrator", CALIBRATOR_GETS, packages),
        points_from=_from_outside(sheet.reconstructor, path, "reconstructor", RECONSTRUCTOR_GETS, packages),
        files=tuple(files),
    )
    recipe.check(str(path))
    return recipe


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
