"""Worst cases of a comparison: where each recipe erred most or missed a target, as crops of the images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.camera.images import Frame, Radiance
from testfield.chain.run import Run
from testfield.evaluate.case import Case
from testfield.evaluate.execute import run_of
from testfield.scene.exposure import sensor_of
from testfield.sensor.expose import expose

FRAME = ["scene", "factor", "level", "draw"]
"""Labels of the cases that see the same frames."""
MOST = 24
"""Crops of a page at most."""
LEAST_HALF_PX = 10.0
AROUND = 1.1
"""Half the width of a crop over the target's diameter."""


@dataclass(frozen=True)
class Worst:
    """Where `recipe` erred by `error_px`, or missed a target (not a number): the case's place in its table, the numbers
    of image and mark, and what each recipe found there, (2,) error in px by name."""

    recipe: str
    place: int
    station: int
    mark: int
    error_px: float
    found: dict[str, np.ndarray]


@dataclass(frozen=True)
class Crop:
    """A piece of a frame about a target: `pixels_dn` (h, w); the true centre `xy_px` (2,) in it; what it shows, in
    `worst`, and in words in `where`."""

    worst: Worst
    pixels_dn: np.ndarray
    xy_px: np.ndarray
    where: str


def worst_of(rows: pd.DataFrame, recipes: Sequence[str]) -> list[Worst]:
    """For each recipe its largest centre error, and a target that it missed and the most others found.

    `rows` are a comparison's, in the order of its cases, numbered from 0.
    """
    errors = [worst for name in recipes if (worst := _largest(rows, name, recipes))]
    missed: dict[tuple, Worst] = {}
    for name in recipes:
        if worst := _missed(rows, name, recipes):  # a target that several missed is shown once
            missed.setdefault((worst.place, tuple(worst.found), worst.station, worst.mark), worst)
    return [*errors, *missed.values()][:MOST]


def crops_of(rows: pd.DataFrame, recipes: Sequence[str], cases: Sequence[Case], folder: Path) -> list[Crop]:
    """Those places cut out of their frames, which are exposed again from the radiance in a comparison's folder."""
    found = []
    for worst in sorted(worst_of(rows, recipes), key=lambda one: one.place):  # cases of one scene share what they load
        case = cases[worst.place]
        run = run_of(case, folder)
        frame = exposed(case, run, worst.station)
        if frame is None:
            continue
        true = run.views.disc_px[worst.station, worst.mark]
        half = max(LEAST_HALF_PX, AROUND * float(run.views.diameter_px[worst.station, worst.mark]))
        pixels, corner = cut(frame.pixels_dn, true, half)
        found.append(Crop(worst, pixels, true - corner, _where(case, run, worst)))
    order = {name: k for k, name in enumerate(recipes)}
    return sorted(found, key=lambda crop: (np.isnan(crop.worst.error_px), order[crop.worst.recipe]))


def exposed(case: Case, run: Run, station: int) -> Frame | None:
    """One frame of a case by its number; None where its radiance is no longer there."""
    for number, (part, _, _, name) in enumerate(run.truth.images()):
        source = run.folder / f"radiance/{name}.exr"
        if number == station and source.is_file():
            sensor = sensor_of(part.scene)
            return expose(Radiance.load(source), sensor, part.sensor_seed, noise_seed=case.noise_seed or 0)
    return None


def cut(pixels: np.ndarray, xy_px: np.ndarray, half_px: float) -> tuple[np.ndarray, np.ndarray]:
    """The pixels (h, w) around a place (x, y), as far as the image (H, W) goes, and the place (2,) of their first."""
    low = np.maximum(np.floor(xy_px - half_px).astype(int), 0)
    high = np.minimum(np.ceil(xy_px + half_px).astype(int) + 1, pixels.shape[::-1])
    return pixels[low[1] : high[1], low[0] : high[0]], low.astype(float)


def _largest(rows: pd.DataFrame, name: str, recipes: Sequence[str]) -> Worst | None:
    best: tuple[float, int, int, int] | None = None
    for place, row in _with_centres(rows, name):
        size = np.hypot(row["dx_px"], row["dy_px"])
        k = int(np.argmax(size))
        if best is None or size[k] > best[0]:
            best = float(size[k]), place, int(row["station"][k]), int(row["mark"][k])
    if best is None:
        return None
    error, place, station, mark = best
    return Worst(name, place, station, mark, error, _found(rows, place, station, mark, recipes))


def _missed(rows: pd.DataFrame, name: str, recipes: Sequence[str]) -> Worst | None:
    best: Worst | None = None
    for place, row in rows[rows.recipe == name].to_dict("index").items():
        if isinstance(row.get("missed_station"), (list, np.ndarray)) and len(row["missed_station"]):
            station, mark = int(row["missed_station"][0]), int(row["missed_mark"][0])
            first = _first_of(rows, int(place))
            worst = Worst(name, first, station, mark, np.nan, _found(rows, first, station, mark, recipes))
            best = worst if best is None or len(worst.found) > len(best.found) else best
    return best


def _first_of(rows: pd.DataFrame, place: int) -> int:
    """The first case that saw the same frames."""
    return int(rows.index[(rows[FRAME] == rows.loc[place, FRAME]).all(axis=1)][0])


def _found(rows: pd.DataFrame, place: int, station: int, mark: int, recipes: Sequence[str]) -> dict[str, np.ndarray]:
    """What each recipe found of a mark in the same frame."""
    same = rows[(rows[FRAME] == rows.loc[place, FRAME]).all(axis=1) & rows.recipe.isin(recipes)]
    found = {}
    for name in recipes:
        for _, row in _with_centres(same, name):
            here = np.flatnonzero((np.asarray(row["station"]) == station) & (np.asarray(row["mark"]) == mark))
            if len(here):
                found[name] = np.array([row["dx_px"][here[0]], row["dy_px"][here[0]]], float)
    return found


def _with_centres(rows: pd.DataFrame, name: str) -> list[tuple[int, Mapping[str, Any]]]:
    own = rows[rows.recipe == name].to_dict("index")
    kept = [(place, row) for place, row in own.items() if isinstance(row.get("dx_px"), (list, np.ndarray))]
    return [(int(place), row) for place, row in kept if len(row["dx_px"])]


def _where(case: Case, run: Run, worst: Worst) -> str:
    marks, labels = run.world.marks, case.labels
    code, board, point = (int(values[worst.mark]) for values in (marks.code, marks.board, marks.point))
    target = f"code {code}" if code > 0 else f"{run.world.field.boards[board].name}, mark {point}"
    factor = f", {labels['factor']} no. {labels['level'] + 1}" if labels["factor"] else ""
    return f"{labels['scene']}{factor}, draw {labels['draw']}, {run.stations[worst.station]}, {target}"
