"""The study on the flexible stitched board: its cases, and how one of them is measured.

Two kinds of evidence stand side by side. *Rendered*: images with real noise, detected and measured. *Drawn*: pixels
drawn from the truth at the physical bound, no images, so that hundreds of worlds cost little; what detection does wrong
is missing there. In both, every world draws print errors, the boards' common scale and the control bar anew.
"""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from testfield.bench.drawn import draw_observations
from testfield.calibrate.calibration import Calibration
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import find
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.score.align import rigid_fit
from testfield.score.camera import score_boards, score_camera, true_in_datum
from testfield.score.points import score_points
from testfield.seeds import generator
from testfield.study import stitching_scenes as scenes
from testfield.study.cases import Case
from testfield.study.chain_growth import chain_errors

HERE = "testfield.study.stitching"
CELLS = (8, 6)
"""Parts of the image, across and down, in which coverage is counted."""
WINDOWS = (0.35, 0.5, 0.65, 0.8, 1.0)
"""Middle parts of the image, by side, to which observations are confined."""
CHAIN, LONG_CHAIN, PER_CASE = 8, 16, 10
PRINT_MM = 0.01
"""Print errors of the boards; a chain's are drawn without them too, for the growth law knows none."""
MADE: dict[str, Callable[..., scenes.Table]] = {"field": scenes.field, "full": scenes.full, "close": scenes.close}
Row = dict[str, Any]


# ------------------------------------------------------------------------------------------------- cases


def cases(quick: bool) -> list[Case]:
    """All cases; the quick setting has fewer counts, placements and worlds."""
    return [*_counts(quick), *_opponents(quick), *_faults(quick), *_chains(quick)]


def _counts(quick: bool) -> list[Case]:
    """How many boards, how placed, and how much of the image they cover."""
    found = []
    plan = {"planned": (1, 3, 12), "random": (3,)} if quick else {
        "planned": (1, 2, 3, 4, 6, 9, 12), "flat": (3, 6, 12), "random": (3, 6, 12)}  # fmt: skip
    rendered = [("planned", 3), ("planned", 12)] if quick else [
        *(("planned", n) for n in (1, 3, 6, 12)), *product(("flat", "random"), (3, 12))]  # fmt: skip
    for placement, counts in plan.items():
        for count in counts:
            labels = {"experiment": "count", "target": placement, "boards": count, "level": 0.0}
            methods = ["stitched", "stitched_given" if count > 1 else "zhang"]
            for seed in range(1, 2 if quick else 3) if (placement, count) in rendered else ():
                options = {"methods": sorted({*methods, "zhang"}), "windows": _windows(placement, count)}
                found.append(_rendered(labels, seed, scenes.field(placement, count, seed), options))
            found += _drawn(labels, 10 if quick else 20, methods, ("field", placement, count))
    labels = {"experiment": "coverage", "target": "planned", "boards": 12, "level": 0.0}
    return found + _drawn(labels, 5 if quick else 10, [], ("field", "planned", 12), windows=_windows("planned", 12))


def _windows(placement: str, count: int) -> tuple[float, ...]:
    return WINDOWS if (placement, count) == ("planned", 12) else ()


def _opponents(quick: bool) -> list[Case]:
    """An ideal full-size board, ChArUco of the same area, and one small board close by."""
    found = []
    worlds, drawn = range(1, 2 if quick else 3), 10 if quick else 20
    for count in (3, 12) if quick else (3, 6, 12):
        labels = {"experiment": "count", "target": "full-size", "boards": count, "level": 0.0}
        found += _drawn(labels, drawn, ["stitched"], ("full", count))
        for seed in worlds if count == 3 or not quick else ():
            found.append(_rendered(labels, seed, scenes.full(count, seed), {"methods": ["stitched"]}))
            table, methods = scenes.charuco(count, seed), ["opencv", "stitched"]
            found.append(_rendered(labels | {"target": "charuco"}, seed, table, {"methods": methods}))
    for board, method in (("sub-board", "zhang"), ("charuco", "opencv"))[: 1 if quick else 2]:
        labels = {"experiment": "count", "target": f"{board}, close", "boards": 1, "level": 0.0}
        found += [_rendered(labels, seed, scenes.close(board, seed), {"methods": [method]}) for seed in worlds]
        found += _drawn(labels, drawn, [method], ("close", board)) if board == "sub-board" else []
    return found


def _faults(quick: bool) -> list[Case]:
    """Bent boards and boards with scale errors of their own; six planned boards."""
    found = []
    bows, scales = ((1.0,), (200.0,)) if quick else ((0.1, 0.3, 1.0, 3.0), (50.0, 200.0, 800.0))
    for fault, levels in (("bent", bows), ("scale", scales)):
        for level in levels:
            labels = {"experiment": fault, "target": "planned", "boards": 6, "level": level}
            value = {"bow_mm" if fault == "bent" else "scale_ppm": level}
            for seed in range(1, 3) if level in (1.0, 200.0) and not quick else ():
                table = scenes.field("planned", 6, seed, **value)
                found.append(_rendered(labels, seed, table, {"methods": ["stitched"]}))
            found += _drawn(labels, 5 if quick else 20, ["stitched"], ("field", "planned", 6), value)
    for level in bows:
        # Of a sheet as stiff as the small one, bent with the same curvature, the bow grows with the square of its size.
        bow = level * (scenes.BOW_SIZE_MM / scenes.SIZE_MM[0]) ** 2
        labels = {"experiment": "bent", "target": "full-size", "boards": 6, "level": level}
        found += _drawn(labels, 5 if quick else 20, ["stitched"], ("full", 6), {"bow_mm": bow})
    return found


def _chains(quick: bool) -> list[Case]:
    """Rows of boards, without and with wide views."""
    found = []
    for seed in range(1, 2 if quick else 5):
        labels = {"experiment": "chain", "target": "chain", "boards": CHAIN, "level": PRINT_MM}
        table = scenes.chain(CHAIN, 4, seed)
        found.append(_rendered(labels, seed, table, {"wide": (0, 1, 2, 4)}, "measure_chain", 1.8))
    plan = [(CHAIN, 10)] if quick else [(CHAIN, 100), (LONG_CHAIN, 40)]
    for (count, worlds), sigma in product(plan, (PRINT_MM, 0.0)):
        wide = (0, 1, 2, 4) if count == CHAIN else (0, 1, 4)
        for first in range(0, worlds, PER_CASE):
            labels = {"experiment": "chain", "target": "chain", "boards": count, "level": sigma}
            options = {"seeds": list(range(1001 + first, 1001 + min(first + PER_CASE, worlds))), "wide": wide}
            found.append(_case(labels, "draw_chain", options, 0.015 * count * len(options["seeds"])))
    return found


def _rendered(
    labels: Row, seed: int, table: scenes.Table, options: Row, work: str = "measure_field", weight: float = 1.0
) -> Case:
    return Case(labels | {"evidence": "rendered", "world": seed}, f"{HERE}:{work}", table, options, weight)


def _drawn(
    labels: Row, worlds: int, methods: list[str], scene: tuple, values: Row | None = None,
    windows: tuple[float, ...] = (),
) -> list[Case]:  # fmt: skip
    found = []
    for first in range(0, worlds, PER_CASE):
        seeds = list(range(1001 + first, 1001 + min(first + PER_CASE, worlds)))
        options = {"scene": scene, "values": values or {}, "methods": methods, "seeds": seeds, "windows": windows}
        work = 0.005 * labels["boards"] * len(seeds) * (len(methods) + 2 * len(windows))
        found.append(_case(labels, "draw_field", options, work))
    return found


def _case(labels: Row, work: str, options: Row, weight: float) -> Case:
    name = {"evidence": "drawn", "first_world": options["seeds"][0]}
    return Case(labels | name, f"{HERE}:{work}", None, options, weight)


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
        for cut, kept in (("middle", inside), ("spread", _as_many(observations, inside, scene.seed))):
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
    return scene, world, draw_observations(scene, world, see(world), generator(scene.seed, "stitching/pixels"))


def confined(observations: Observations, scene: SceneFile, part: float) -> Observations:
    """The boards' marks in the middle `part` of the image, by side."""
    size = np.array([scene.camera.width_px, scene.camera.height_px])
    inside = (np.abs(observations.xy_px - (size - 1) / 2) <= part * size / 2).all(axis=1)
    return observations.take(np.asarray(inside & (observations.board >= 0)))


def _as_many(observations: Observations, other: Observations, seed: int) -> Observations:
    """As many of the boards' marks as `other` has, drawn from all over the image."""
    rng = generator(seed, f"stitching/as many/{len(other)}")
    chosen = np.zeros(len(observations), bool)
    chosen[rng.choice(np.flatnonzero(observations.board >= 0), len(other), replace=False)] = True
    return observations.take(chosen)


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
    camera = scene.camera
    # One sub-board alone: the one in the middle, for of a board in a corner the rest of the image is a guess.
    away = np.linalg.norm(world.world_from_board.t_mm - scenes.MIDDLE_MM, axis=1)
    which = {"board": world.field.boards[int(away.argmin())].name} if method == "zhang" else {}
    return find("calibrators", method)(
        observations, world.field, camera.width_px, camera.height_px, camera.lens, (), **which
    )


def _judged(scene: SceneFile, world: World, observations: Observations, method: str) -> Row:
    """The scores of one method. Where it fails, why, and no numbers."""
    empty: Row = {"method": method, "failed": "", "cut": "", "window": 1.0, "world": scene.seed}
    try:
        calibration = _calibrated(scene, world, observations, method)
    except TestfieldError as error:
        return empty | {"failed": error.what}
    camera, boards = score_camera(world, calibration), score_boards(world, calibration)
    corners = np.array(camera["corner_errors_px"])
    row = empty | {
        "corner_px": float(corners.max()), "corner_rms_px": float(np.sqrt((corners**2).mean())),
        "interior_nees": camera["interior_anees"], "sigma0": calibration.sigma0, "test_passed": _passed(calibration),
        "observations": calibration.used, "rejected": len(calibration.rejected),
        "coverage": coverage(calibration), "joined": boards["joined"],
        "mother_rms_mm": mother_rms_mm(world, calibration), "boards_nees": boards["anees"],
    }  # fmt: skip
    if not scene.check_targets:
        return row
    try:
        points = find("reconstructors", scene.measure.reconstructor)(observations, calibration, world.field)
    except np.linalg.LinAlgError:  # rays that pass a wild lens twice have no covariance
        return row
    score = score_points(world, calibration, points)
    n = len(score.code)
    return row | {
        "check_points": n, "check_nees": score.anees, "check_expected": score.expected,
        "check_rmse_mm": float(np.sqrt((score.fitted_mm**2).mean())) if n >= 3 else float("nan"),
        "check_unfitted_mm": float(np.sqrt((score.error_mm**2).mean())) if n else float("nan"),
    }  # fmt: skip


def _passed(calibration: Calibration) -> bool:
    return bool(calibration.test.get("variance", 0.0) <= calibration.test.get("high", np.inf))


def coverage(calibration: Calibration) -> float:
    """Part of the image's cells in which any image of the calibration has an observation."""
    size = np.array([calibration.interior.width_px, calibration.interior.height_px])
    cell = np.clip((calibration.residual_at_px + 0.5) / size * CELLS, 0, np.array(CELLS) - 1).astype(int)
    return len(np.unique(cell, axis=0)) / (CELLS[0] * CELLS[1])


def mother_rms_mm(world: World, calibration: Calibration) -> float:
    """The mother board as a user has it (the sheets' marks, at the calibrated scale and poses) against its true marks,
    each coordinate's root mean square after a fit of six parameters."""
    datum, _ = true_in_datum(world, calibration.board_names)
    place = {sheet.name: k for k, sheet in enumerate(world.field.boards)}
    measured, true = [], []
    for b, name in enumerate(calibration.board_names):
        here = world.marks.board == place[name]
        xy = world.field.boards[place[name]].marks.xy_mm[world.marks.point[here]] * calibration.scale
        local = np.column_stack([xy, np.zeros(len(xy))])
        measured.append(local @ calibration.boards.R[b].T + calibration.boards.t_mm[b])
        true.append((world.mark_world_mm[here] - datum.t_mm[0]) @ datum.R[0])
    found, right = np.vstack(measured), np.vstack(true)
    R, t = rigid_fit(found, right)
    return float(np.sqrt(((found @ R.T + t - right) ** 2).mean()))


def _links(scene: SceneFile, world: World, observations: Observations, wide: int) -> list[Row]:
    """Of every board but the first, and of the link that leads to it, the errors."""
    calibration = _calibrated(scene, world, chained(observations, world, wide), "stitched")
    if len(calibration.board_names) < len(world.field.boards):
        raise TestfieldError("the chain is broken", calibration.notes[0] if calibration.notes else "", "look at it")
    found, camera = chain_errors(world, calibration), score_camera(world, calibration)
    common = {
        "method": "stitched", "wide": wide, "sigma0": calibration.sigma0, "corner_px": camera["corner_error_px"],
        "mother_rms_mm": mother_rms_mm(world, calibration), "world": scene.seed,
    }  # fmt: skip
    return [
        common | {
            "links": k + 1, "nees": float(found.nees[k]),
            **{f"{axis}_mm": float(found.place_mm[k, i]) for i, axis in enumerate(("along", "out", "up"))},
            **{f"u_{axis}_mm": float(found.u_place_mm[k, i]) for i, axis in enumerate(("along", "out", "up"))},
            **{f"shift_{axis}_mm": float(found.shift_mm[k, i]) for i, axis in enumerate(("out", "up"))},
            **{f"turn_{axis}_rad": float(found.turn_rad[k, i]) for i, axis in enumerate(("out", "up"))},
        }
        for k in range(len(found.nees))
    ]  # fmt: skip
