"""The study on the flexible stitched board: how one of its cases is measured.

A case that is rendered and one that is drawn go the same way from the observations on.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from testfield.calibrate.calibration import Calibration
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.measure.pipeline import calibrate, reconstruct
from testfield.measure.recipe import Algorithm
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.score.camera import score_boards, score_camera
from testfield.score.chain_growth import chain_errors
from testfield.score.mother_board import fitted_rms_mm, mother_marks, mother_scores
from testfield.score.points import score_points
from testfield.seeds import normals_of_marks, seed_of
from testfield.simulate.observations import draw_observations
from testfield_studies.stitching import scenes

CELLS = (8, 6)
"""Parts of the image, across and down, in which coverage is counted."""
NO_BAR = "stitched_no_bar"
"""`stitched` where no bar was seen, as OpenCV, which has no use for one, calibrates."""
MADE: dict[str, Callable[..., scenes.Table]] = {"field": scenes.field, "full": scenes.full, "close": scenes.close}
Row = dict[str, Any]


# ------------------------------------------------------------------------------------------------- work


def measure_field(case: Case, run: Run | None) -> list[Row]:
    """Render and detect a field, calibrate with each method; one row a method and window of the image."""
    assert run is not None
    return _field_rows(run.scene, run.world, _observed(run), case.options)


def draw_field(case: Case, run: Run | None) -> list[Row]:
    """The same without images, for every seed in the case's options."""
    kind, *arguments = case.options["scene"]
    make = MADE[kind]
    rows = []
    for seed in case.options["seeds"]:
        rows += _field_rows(*_pixels(make(*arguments, seed, **case.options["values"])), case.options)
    return rows


def _field_rows(scene: SceneFile, world: World, observations: Observations, options: Row) -> list[Row]:
    rows = [_judged(scene, world, observations, method) for method in options["methods"]]
    for part in options.get("windows", ()):
        inside = confined(observations, scene, part)
        for cut, kept in (("middle", inside), ("spread", _as_many(observations, inside, world, scene.seed))):
            rows.append(_judged(scene, world, kept, "stitched") | {"cut": cut, "window": part})
    return rows


def measure_chain(case: Case, run: Run | None) -> list[Row]:
    """Render and detect a chain; one row a board for each number of wide views."""
    assert run is not None
    observations = _observed(run)
    return [row for wide in case.options["wide"] for row in _links(run.scene, run.world, observations, wide)]


def draw_chain(case: Case, run: Run | None) -> list[Row]:
    """The same without images."""
    rows = []
    for seed in case.options["seeds"]:
        table = scenes.chain(case.labels["boards"], max(case.options["wide"]), seed, case.labels["level"])
        scene, world, observations = _pixels(table)
        for wide in case.options["wide"]:
            rows += _links(scene, world, observations, wide)
    return rows


def _observed(run: Run) -> Observations:
    for stage in ("render", "expose", "detect"):
        run_stage(run, stage)
    return Observations.load(run.need("observations.parquet", "detect"))


def _pixels(table: scenes.Table) -> tuple[SceneFile, World, Observations]:
    scene = parse_scene(tomli_w.dumps(table), table["name"], Path())
    world = build_world(scene)
    return scene, world, draw_observations(scene, world, see(world), seed_of(scene.seed, "stitching/pixels"))


def confined(observations: Observations, scene: SceneFile, part: float) -> Observations:
    """The boards' marks in the middle `part` of the image, by side."""
    size = np.array([scene.camera.width_px, scene.camera.height_px])
    inside = (np.abs(observations.xy_px - (size - 1) / 2) <= part * size / 2).all(axis=1)
    return observations.take(np.asarray(inside & (observations.board >= 0)))


def _as_many(observations: Observations, other: Observations, world: World, seed: int) -> Observations:
    """As many of the boards' marks as `other` has, drawn from all over the image: those of the lowest lots."""
    o, names = observations, tuple(board.name for board in world.field.boards)
    drawing = seed_of(seed, f"stitching/as many/{len(other)}")
    lot = normals_of_marks(drawing, o.stations, names, o.station, o.board, o.point, o.code)[:, 0]
    marks = np.flatnonzero(o.board >= 0)
    return o.take(np.sort(marks[np.argsort(lot[marks], kind="stable")[: len(other)]]))


def without_bars(observations: Observations, world: World) -> Observations:
    """The observations without those of the scale bars' ends."""
    ends = [code for bar in world.field.scale_bars for code in bar.codes]
    return observations.take(~((observations.board < 0) & np.isin(observations.code, ends)))


def chained(observations: Observations, world: World, wide: int) -> Observations:
    """A chain's observations: of a close view only the two boards it is aimed at, and so many wide views."""
    keep = np.ones(len(observations), bool)
    for s, name in enumerate(observations.stations):
        here = observations.station == s
        if name.startswith("link"):
            first = int(name[4:-1]) - 1
            keep[here] = ~np.isin(observations.board[here], [*range(first), *range(first + 2, len(world.field.boards))])
        else:
            keep[here] = "abcd".index(name[-1]) < wide
    return observations.take(keep)


# ------------------------------------------------------------------------------------------------- scores


def _calibrated(scene: SceneFile, world: World, observations: Observations, method: str) -> Calibration:
    recipe = recipe_of(scene)
    # One sub-board alone: the one in the middle, for of a board in a corner the rest of the image is a guess.
    away = np.linalg.norm(world.world_from_board.t_mm - scenes.MIDDLE_MM, axis=1)
    which = {"board": world.field.boards[int(away.argmin())].name} if method == "zhang" else {}
    if method == NO_BAR:
        observations, method = without_bars(observations, world), "stitched"
    asked = Algorithm(method, {**recipe.calibrator.options, **which})
    return calibrate(observations, world.field, replace(recipe, calibrator=asked))


def _judged(scene: SceneFile, world: World, observations: Observations, method: str) -> Row:
    """The scores of one method. Where it fails, why, and no numbers."""
    empty: Row = {"method": method, "failed": "", "cut": "", "window": 1.0, "world": scene.seed}
    try:
        calibration = _calibrated(scene, world, observations, method)
    except TestfieldError as error:
        return empty | {"failed": error.what}
    camera, boards = score_camera(world, calibration), score_boards(world, calibration)
    corners = np.array(camera["corner_errors_px"])
    row = (
        empty
        | {
            "corner_px": float(corners.max()),
            "corner_rms_px": float(np.sqrt((corners**2).mean())),
            "interior_nees": camera["interior_anees"],
            "sigma0": calibration.sigma0,
            "test_passed": _passed(calibration),
            "observations": calibration.used,
            "rejected": len(calibration.rejected),
            "coverage": coverage(calibration),
            "joined": boards["joined"],
            "boards_nees": boards["anees"],
        }
        | mother_scores(world, calibration)
    )
    if not scene.check_targets:
        return row
    try:
        points = reconstruct(observations, calibration, world.field, recipe_of(scene))
    except TestfieldError:  # rays that pass a wild lens twice have no covariance
        return row
    score = score_points(world, calibration, points)
    n = len(score.code)
    return row | {
        "check_points": n,
        "check_nees": score.anees,
        "check_expected": score.expected,
        "check_rmse_mm": float(np.sqrt((score.fitted_mm**2).mean())) if n >= 3 else float("nan"),
        "check_unfitted_mm": float(np.sqrt((score.error_mm**2).mean())) if n else float("nan"),
    }


def _passed(calibration: Calibration) -> bool:
    return bool(calibration.test.get("variance", 0.0) <= calibration.test.get("high", np.inf))


def coverage(calibration: Calibration) -> float:
    """Part of the image's cells in which any image of the calibration has an observation."""
    size = np.array([calibration.interior.width_px, calibration.interior.height_px])
    cell = np.clip((calibration.residual_at_px + 0.5) / size * CELLS, 0, np.array(CELLS) - 1).astype(int)
    return len(np.unique(cell, axis=0)) / (CELLS[0] * CELLS[1])


def _links(scene: SceneFile, world: World, observations: Observations, wide: int) -> list[Row]:
    """Of every board but the first, and of the link that leads to it, the errors. Where it fails, why."""
    empty: Row = {"method": "stitched", "failed": "", "wide": wide, "world": scene.seed}
    try:
        calibration = _calibrated(scene, world, chained(observations, world, wide), "stitched")
    except TestfieldError as error:
        return [empty | {"failed": error.what}]
    if len(calibration.board_names) < len(world.field.boards):
        return [empty | {"failed": "the chain is broken"}]
    found, camera = chain_errors(world, calibration), score_camera(world, calibration)
    common = empty | {
        "sigma0": calibration.sigma0,
        "corner_px": camera["corner_error_px"],
        "mother_rms_mm": fitted_rms_mm(*mother_marks(world, calibration)),
    }
    return [
        common
        | {
            "links": k + 1,
            "nees": float(found.nees[k]),
            **{f"{axis}_mm": float(found.place_mm[k, i]) for i, axis in enumerate(("along", "out", "up"))},
            **{f"u_{axis}_mm": float(found.u_place_mm[k, i]) for i, axis in enumerate(("along", "out", "up"))},
            **{f"shift_{axis}_mm": float(found.shift_mm[k, i]) for i, axis in enumerate(("out", "up"))},
            **{f"turn_{axis}_rad": float(found.turn_rad[k, i]) for i, axis in enumerate(("out", "up"))},
        }
        for k in range(len(found.nees))
    ]
