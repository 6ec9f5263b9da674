"""A recipe: how frames become results, as a value."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from testfield.camera.interior import check_held
from testfield.errors import TestfieldError, gather, nearest
from testfield.measure.outside import Program, Results
from testfield.measure.signature import check_signature, options_of
from testfield.registry import KINDS, load_file, names

__all__ = ["Algorithm", "Loaded", "Recipe", "options_of"]

SMALLEST_DIAMETER_PX = 5.0


@dataclass(frozen=True)
class Algorithm:
    """An algorithm of the registry by name, with options by keyword."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Loaded:
    """A Python file that a recipe loads, and the digest that it had."""

    path: Path
    digest: str


@dataclass(frozen=True)
class Recipe:
    """Centroid estimator, calibrator and reconstructor; dots of less than `smallest_diameter_px` are not looked for.

    Of the calibrator's options, `lens` (absent: what the field sheet says of each camera) and `hold` (parameters at
    zero) are common to all; `board` names the one board of those that use a single one.

    A `detector` of one's own, a program, or observations that were made elsewhere take the place of everything that
    happens to a frame; a `finder` or `decoder` only that of this project's. `calibrated_by` takes the calibrator's
    place, `points_from` the reconstructor's. `files` are Python files that are imported before names are looked up.
    """

    name: str = "default"
    centroid: Algorithm = Algorithm("forward_model")
    calibrator: Algorithm = Algorithm("stitched")
    reconstructor: Algorithm = Algorithm("gls")
    smallest_diameter_px: float = SMALLEST_DIAMETER_PX
    detector: Algorithm | Program | Results | None = None
    finder: Algorithm | None = None
    decoder: Algorithm | None = None
    calibrated_by: Program | Results | None = None
    points_from: Program | Results | None = None
    files: tuple[Loaded, ...] = ()

    @staticmethod
    def load(path: Path) -> "Recipe":
        """The recipe in a TOML file. Raises `TestfieldError` where a field, an algorithm, an option, a program or a
        file is unknown."""
        from testfield.measure.recipe_file import read_recipe

        return read_recipe(path)

    def check(self, source: str) -> None:
        """Raise `TestfieldError`, of all faults, where an algorithm is unknown, does not take an option, or not what it
        is given; `source` is what the message calls the recipe."""
        self.prepare()
        checks: list[Callable[[], None]] = [
            partial(_check_stage, stage, one, source) for stage, one in self.stages.items()
        ]
        checks.append(partial(self._check_lens, f"{source}, calibrator"))
        gather(*checks)

    def _check_lens(self, where: str) -> None:
        """The options that every calibrator is given, whatever their defaults."""
        options, known = self.calibrator.options, names("lenses")
        lens, hold = options.get("lens"), options.get("hold", ())
        if not isinstance(hold, (tuple, list)) or not all(isinstance(name, str) for name in hold):
            raise TestfieldError(f"value {str(hold)[:60]!r}: a list of texts is wanted", f"{where}.hold", "as ['k3']")
        if lens is not None and lens not in known:
            do = nearest(lens, known) if isinstance(lens, str) else f"known here: {', '.join(known)}"
            raise TestfieldError(f"no lens model is called {str(lens)[:60]!r}", f"{where}.lens", do)
        if lens is not None:
            check_held(hold, lens, f"{where}.hold")

    def prepare(self) -> None:
        """Import what the recipe loads, in whatever process it has come to."""
        for file in self.files:
            load_file(file.path)

    @property
    def stages(self) -> dict[str, Algorithm]:
        """The algorithms that are used, by their stage in the registry."""
        by_name = {"centroids": self.centroid, "calibrators": self.calibrator, "reconstructors": self.reconstructor}
        by_name |= {"finders": self.finder} if self.finder else {}
        by_name |= {"decoders": self.decoder} if self.decoder else {}
        return by_name | ({"detectors": self.detector} if isinstance(self.detector, Algorithm) else {})

    @property
    def parts(self) -> dict[str, str]:
        """What is done by what, in a person's words, stage by stage."""
        outside = {"calibrator": self.calibrated_by, "reconstructor": self.points_from}
        found = {stage.removesuffix("s"): one.name for stage, one in self.stages.items()}
        if self.detector is not None:
            found = {name: said for name, said in found.items() if name not in ("finder", "centroid", "decoder")}
            outside["detector"] = self.detector if not isinstance(self.detector, Algorithm) else None
        for stage, one in outside.items():
            if one is not None:
                found[stage] = f"program {one.name}" if isinstance(one, Program) else f"files in {one.folder}"
        return found

    @property
    def lens(self) -> str | None:
        """The lens model to calibrate, None for that of the camera's sheet."""
        return self.calibrator.options.get("lens")

    @property
    def hold(self) -> tuple[str, ...]:
        """Parameters of the calibrated lens that are held at zero."""
        return tuple(self.calibrator.options.get("hold", ()))


def _check_stage(stage: str, one: Algorithm, source: str) -> None:
    where = f"{source}, {stage.removesuffix('s')}"
    known = names(stage)
    if one.name not in known:
        do = nearest(one.name, known) if known else "register one, and load its file"
        raise TestfieldError(f"no {KINDS[stage]} is called '{one.name}'", where, do)
    check_signature(stage, one.name, one.options, where)
