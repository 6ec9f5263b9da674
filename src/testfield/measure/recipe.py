"""A recipe: how frames become results, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

import pydantic

from testfield.camera.interior import check_held
from testfield.errors import TestfieldError, nearest
from testfield.registry import find, names
from testfield.store.toml import parse_toml, read_toml

SMALLEST_DIAMETER_PX = 5.0
GIVEN = {"centroids": 4, "calibrators": 4, "reconstructors": 3}
"""How many arguments the pipeline gives by position; everything else that an algorithm takes is an option."""
INTERNAL = ("cameras", "misfit")
"""Arguments that only the pipeline gives."""


@dataclass(frozen=True)
class Algorithm:
    """An algorithm of the registry by name, with options by keyword."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Recipe:
    """Centroid estimator, calibrator and reconstructor; dots of less than `smallest_diameter_px` are not looked for.

    Of the calibrator's options, `lens` (absent: what the field sheet says of each camera) and `hold` (parameters at
    zero) are common to all; `board` names the one board of those that use a single one.
    """

    name: str = "default"
    centroid: Algorithm = Algorithm("forward_model")
    calibrator: Algorithm = Algorithm("stitched")
    reconstructor: Algorithm = Algorithm("gls")
    smallest_diameter_px: float = SMALLEST_DIAMETER_PX

    @staticmethod
    def load(path: Path) -> "Recipe":
        """The recipe in a TOML file. Raises `TestfieldError` where a field, an algorithm or an option is unknown."""
        data = parse_toml(read_toml(path, "recipe"), str(path))
        try:
            sheet = _RecipeFile.model_validate(data)
        except pydantic.ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            said = "unknown field" if first["type"] == "extra_forbidden" else first["msg"]
            raise TestfieldError(
                f"{said[0].lower()}{said[1:]}", f"{path}, {place}", nearest(str(first["loc"][-1]), list(_FIELDS))
            ) from error
        recipe = Recipe(
            name=sheet.name or path.stem,
            centroid=sheet.centroid.algorithm,
            calibrator=sheet.calibrator.algorithm,
            reconstructor=sheet.reconstructor.algorithm,
            smallest_diameter_px=sheet.smallest_diameter_px,
        )
        recipe.check(str(path))
        return recipe

    def check(self, source: str) -> None:
        """Raise `TestfieldError` where an algorithm is unknown or does not take an option; `source` is what the
        message calls the recipe."""
        for stage, one in self.stages.items():
            where = f"{source}, {stage.removesuffix('s')}"
            if one.name not in names(stage):
                raise TestfieldError(
                    f"no {stage.removesuffix('s')} is called '{one.name}'", where, nearest(one.name, names(stage))
                )
            known = options_of(stage, one.name)
            for option in one.options:
                if known is not None and option not in known:
                    raise TestfieldError(
                        f"'{one.name}' takes no option '{option}'", f"{where}.{option}", nearest(option, known)
                    )
        if self.lens is not None:
            check_held(self.hold, self.lens, f"{source}, calibrator.hold")

    @property
    def stages(self) -> dict[str, Algorithm]:
        """The algorithms by their stage in the registry."""
        return {"centroids": self.centroid, "calibrators": self.calibrator, "reconstructors": self.reconstructor}

    @property
    def lens(self) -> str | None:
        """The lens model to calibrate, None for that of the camera's sheet."""
        return self.calibrator.options.get("lens")

    @property
    def hold(self) -> tuple[str, ...]:
        """Parameters of the calibrated lens that are held at zero."""
        return tuple(self.calibrator.options.get("hold", ()))


def options_of(stage: str, name: str) -> list[str] | None:
    """Names of the options that an algorithm takes; None for one that takes any."""
    taken = signature(find(stage, name)).parameters.values()
    if any(one.kind is Parameter.VAR_KEYWORD for one in taken):
        return None
    return [one.name for one in list(taken)[GIVEN[stage] :] if one.name not in INTERNAL]


class _AlgorithmTable(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="allow")
    name: str

    @property
    def algorithm(self) -> Algorithm:
        options = {key: tuple(v) if isinstance(v, list) else v for key, v in (self.model_extra or {}).items()}
        return Algorithm(self.name, options)


def _named(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


_Named = Annotated[_AlgorithmTable, pydantic.BeforeValidator(_named)]


class _RecipeFile(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid")
    name: str = ""
    centroid: _Named = _AlgorithmTable(name="forward_model")
    calibrator: _Named = _AlgorithmTable(name="stitched")
    reconstructor: _Named = _AlgorithmTable(name="gls")
    smallest_diameter_px: float = pydantic.Field(SMALLEST_DIAMETER_PX, ge=3, le=1000)


_FIELDS = tuple(_RecipeFile.model_fields)
