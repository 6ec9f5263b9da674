"""A suite's baseline: figures of every draw with their intervals, as a JSON file that a person can review.

Every figure has a line of its own, so that a change in a pull request reads as a change of figures. Numbers are written
in full, since an unchanged program must show no difference at all.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from testfield.errors import TestfieldError, nearest
from testfield.evaluate.regress.cases import Setup
from testfield.evaluate.regress.machine import machine
from testfield.evaluate.regress.suite import Suite
from testfield.statistics.clusters import mean_of_clusters
from testfield.store.atomic import whole
from testfield.store.digests import digest
from testfield.store.stamp import stamp
from testfield.store.text import read_text, write_text

BASELINE_FORMAT = 1
WHAT = "regression baseline"
NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""How numbers are written that JSON cannot hold, so that no reader takes them for something else."""


@dataclass(frozen=True)
class Recorded:
    """The values (draws,) of a figure of a scene measured by a recipe."""

    scene: str
    recipe: str
    key: str
    values: np.ndarray


@dataclass(frozen=True)
class Baseline:
    """What a suite's figures were: by (scene, recipe, key); the digest of each scene by its title; and where they come
    from: `made` (program, time, commit, machine, versions, renderer)."""

    suite: str
    draws: int
    scenes: Mapping[str, str]
    figures: Mapping[tuple[str, str, str], np.ndarray]
    made: Mapping[str, Any]

    def save(self, path: Path) -> None:
        """Write the file whole."""
        with whole(path) as part:
            write_text(part, _text(_content(self)))

    @staticmethod
    def load(path: Path) -> "Baseline":
        """The baseline in a file. Raises `TestfieldError` where it is none, of another format, or was edited by hand:
        its figures are no longer those of the digest that was written with them."""
        try:
            data = json.loads(read_text(path))
        except (ValueError, RecursionError) as error:
            raise TestfieldError(
                f"this is no JSON ({' '.join(str(error).split())[:120]})", str(path), _again(path)
            ) from error
        if not isinstance(data, dict) or data.get("what") != WHAT:
            raise TestfieldError(f"this is no {WHAT}", str(path), _again(path))
        if data.get("format") != BASELINE_FORMAT:
            raise TestfieldError(
                f"format {data.get('format')!r} is not known, only {BASELINE_FORMAT}", f"{path}, format", _again(path)
            )
        try:
            sheet = _Sheet.model_validate(data)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            raise TestfieldError(
                f"{first['msg'][0].lower()}{first['msg'][1:]}", f"{path}, {place}", _again(path)
            ) from error
        told = data.pop("digest")
        if _digest(data) != told:
            raise TestfieldError(
                f"it was edited by hand: its figures are not those of its digest ({told[:12]})",
                f"{path}, digest",
                _again(path),
            )
        figures = {}
        for one in sheet.figures:
            values = np.array([NOT_FINITE[v] if isinstance(v, str) else v for v in one.draws], float)
            if len(values) != sheet.draws:
                raise TestfieldError(
                    f"{len(values)} draws instead of {sheet.draws}",
                    f"{path}, figures, {one.scene}, {one.key}",
                    _again(path),
                )
            figures[one.scene, one.recipe, one.key] = values
        return Baseline(sheet.suite, sheet.draws, sheet.scenes, figures, sheet.made)

    def belongs_to(self, suite: Suite, setups: Sequence[Setup], path: Path) -> None:
        """Raise `TestfieldError` where it is another suite's, or of a scene that has changed since."""
        if self.suite != suite.name:
            raise TestfieldError(
                f"this is the baseline of suite '{self.suite}', not of '{suite.name}'", f"{path}, suite", _again(path)
            )
        here = {setup.title: setup.scene_digest for setup in setups}
        for title, told in self.scenes.items():
            if title not in here:
                raise TestfieldError(
                    f"it holds a scene '{title}' that the suite does not", f"{path}, scenes", nearest(title, here)
                )
            if here[title] != told:
                raise TestfieldError(
                    f"scene '{title}' has changed since it was recorded ({told[:12]}, now {here[title][:12]})",
                    f"{path}, scenes",
                    _again(path),
                )


def _again(path: Path) -> str:
    return f"record the suite again, or take {path.name} from where it was made"


def _content(baseline: Baseline) -> dict[str, Any]:
    figures = []
    for (scene, recipe, key), values in baseline.figures.items():
        low, high = mean_of_clusters(values).interval() if np.isfinite(values).all() else (math.nan, math.nan)
        figures.append(
            {
                "scene": scene,
                "recipe": recipe,
                "key": key,
                "mean": _short(float(np.mean(values))),
                "low": _short(low),
                "high": _short(high),
                "draws": [_written(float(value)) for value in values],
            }
        )
    data = {
        "what": WHAT,
        "format": BASELINE_FORMAT,
        "suite": baseline.suite,
        "draws": baseline.draws,
        "scenes": dict(baseline.scenes),
        "made": dict(baseline.made),
        "figures": figures,
    }
    return {**data, "digest": _digest(data)}


def _digest(data: dict[str, Any]) -> str:
    return digest(json.dumps(data, sort_keys=True))


def _written(value: float) -> float | int | str:
    if math.isnan(value):
        return "nan"
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return int(value) if value == int(value) and abs(value) < 2**53 else value


def _short(value: float) -> float | int | str:
    """For the eye: six digits."""
    return _written(float(f"{value:.6g}"))


def _text(data: dict[str, Any]) -> str:
    """The document, with one line for each figure."""
    head = {key: value for key, value in data.items() if key not in ("figures", "digest")}
    text = json.dumps(head, indent=1, ensure_ascii=False)
    rows = ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in data["figures"])
    return f'{text[:-2]},\n "figures": [\n{rows}\n ],\n "digest": "{data["digest"]}"\n}}\n'


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _FigureSheet(_Strict):
    scene: str
    recipe: str
    key: str
    mean: float | str
    low: float | str
    high: float | str
    draws: list[float | str]


class _Sheet(_Strict):
    what: str
    format: int
    suite: str
    draws: int
    scenes: dict[str, str]
    made: dict[str, Any]
    figures: list[_FigureSheet]
    digest: str


def made_here(suite: Suite) -> dict[str, Any]:
    """Where a suite's figures come from."""
    return made_at(suite.source.resolve().parent)


def made_at(folder: Path) -> dict[str, Any]:
    """Where figures come from that belong to a folder: program, time, and what `machine` says."""
    said = stamp()
    return {"program": said["program"], "made": said["made"], **machine(folder)}
