"""`study fitting_point`, the experiment: a rig of known lengths, exposed and measured anew in every trial.

The world is made without errors, and the measuring side's sheet declares uncertainties: so what certificates leave
open can be drawn anew in every trial, like the noise, and trials are independent of each other. A trial exposes the
same radiance with new noise, detects, calibrates, reconstructs, and fits the vertex in every layout.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.chain.trials import reexposed
from testfield.evaluate.case import Case, changed, scene_table
from testfield.measure.pipeline import measure as measure_all
from testfield.reconstruct.points import Points
from testfield.scene.world import CHECK, World
from testfield.score.camera import true_in_datum
from testfield.seeds import normals, seed_of
from testfield.targets.field import Field
from testfield.uncertainty.certificates import draw_certificates
from testfield.uncertainty.fitting_point import Weights, fit_point, without_correlation

SCENE = Path("scenes/fitting_point.toml")
WORK = f"{__name__}:measure"
VERTEX = 200
LAYOUTS = {
    "symmetric": (211, 212, 213, 214, 215, 216, 221, 222, 223, 224, 225, 226),
    "one-sided": (211, 212, 213, 214, 215, 216),
}
ALL = LAYOUTS["symmetric"]
U_LENGTH_MM, U_PRINT_MM, U_SCALE, U_BAR_MM = 0.005, 0.01, 20e-6, 0.005
SCALE_ERROR = 1e-3
BLIND_U_SCALE, BLIND_U_BAR_MM = 0.01, 1e-3
"""Where the bar is told wrong: it alone makes the scale, so that its error is the scale's."""


def cases(quick: bool) -> list[Case]:
    """Independent trials, in cases short enough to lose little by a kill; then some with a scale bar that is wrong.

    A process does all cases of one scene. Scenes differ in their seed and in how the boards are turned, so that what
    light and detector do alike in every exposure differs between them.
    """
    seeds, each, per_seed = (2, 10, 20) if quick else (8, 25, 125)
    found = []
    for k in range(seeds):
        turned = {"seed": 88 + k, "boards.0.spin_deg": 2 + 3 * k, "boards.1.spin_deg": 94 + 3 * k}
        scene = changed(scene_table(SCENE), turned)
        for first in range(0, per_seed, each):
            labels = {"bar": "right", "seed": 88 + k, "first": first}
            found.append(Case(labels, WORK, scene, {"trials": each, "scale_error": 0.0}, each))
        if k < 2:
            labels = {"bar": "wrong", "seed": 88 + k, "first": 0}
            found.append(Case(labels, WORK, scene, {"trials": each, "scale_error": SCALE_ERROR}, each))
    return found


def measure(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """Rows of all trials of a case: one for each layout and weighting."""
    assert run is not None
    for stage in ("render", "expose", "detect", "calibrate"):
        run_stage(run, stage)
    start = Calibration.load(run.need("calibration.json", "calibrate"))
    told = sheet(run.field, case.options["scale_error"])
    recipe = recipe_of(run.scene)
    first, rows = int(case.labels["first"]), []
    for number in range(first, first + case.options["trials"]):
        name = f"fitting_point/{case.labels['bar']}/{number}"
        workshop = seed_of(run.scene.seed, name)
        lengths_off = normals(workshop, "lengths", len(ALL))[:, 0]
        seen = reexposed(run, seed_of(run.scene.seed, f"{name}/noise"))
        observations, field = draw_certificates(seen, start, told, workshop)
        found = measure_all(observations, field, recipe)
        rows_of_trial = fits(
            found.points, run.world, found.calibration.board_names, lengths_off, case.options["scale_error"]
        )
        rows += [{"trial": number} | row for row in rows_of_trial]
    return rows


def fits(
    points: Points, world: World, boards: tuple[str, ...], lengths_off: np.ndarray, scale_error: float = 0.0
) -> list[dict[str, Any]]:
    """A row for every layout and way to fit; known lengths err by `lengths_off` (len(ALL),) standard uncertainties.

    `equal` and `covariance` weights with the bundle's whole covariance, and `alone`: the latter without the
    correlations between points. `boards` are those of the calibration, the first of which is the datum. A layout of
    which a target is missing gives no row.
    """
    true, rows = true_positions(world, boards), []
    known = {int(code) for code in points.code}
    draws = {code: U_LENGTH_MM * z for code, z in zip(ALL, lengths_off, strict=True)}
    for layout, codes in LAYOUTS.items():
        if not {VERTEX, *codes} <= known:
            continue
        place = points.rows([*codes, VERTEX])
        ends, vertex, joint = points.xyz_mm[place[:-1]], points.xyz_mm[place[-1]], points.covariance_of(place)
        lengths = np.array([np.linalg.norm(true[code] - true[VERTEX]) + draws[code] for code in codes])
        error = np.concatenate(
            [points.xyz_mm[row] - true[code] for row, code in zip(place, (*codes, VERTEX), strict=True)]
        )
        anees = float(error @ np.linalg.solve(joint, error) / len(error))
        ways: tuple[tuple[str, Weights, np.ndarray], ...] = (
            ("equal", "equal", joint),
            ("covariance", "covariance", joint),
            ("alone", "covariance", without_correlation(joint)),
        )
        for way, weights, covariance in ways:
            fit = fit_point(ends, lengths, vertex, covariance, np.full(len(codes), U_LENGTH_MM), weights)
            off = fit.xyz_mm - true[VERTEX]
            rows.append(
                {
                    "layout": layout,
                    "way": way,
                    "bias_chi2": fit.bias_chi2,
                    "point_chi2": float(off @ np.linalg.solve(fit.cov_mm2, off)),
                    "points_anees": anees,
                    "s0": fit.s0,
                    "s_sys_mm": fit.s_sys_mm,
                    "expected_s_sys_mm": fit.expected_s_sys_mm,
                    "u_radial_mm": float(np.sqrt(np.diag(fit.cov_length_mm2).mean())),
                    "mean_relative_ppm": 1e6 * fit.mean_relative,
                    "u_mean_relative_ppm": 1e6 * fit.u_mean_relative,
                    **_axes("bias", fit.bias_mm),
                    **_axes("u_bias", np.sqrt(np.diag(fit.cov_bias_mm2))),
                    **_axes("off", off),
                    **_axes("u_off", np.sqrt(np.diag(fit.cov_mm2))),
                    **_axes("dispersion", fit.dispersion),
                    **_axes("dop", fit.dop),
                    **_axes("scale_bias", fit.scale_bias_mm(scale_error, lengths)),
                }
            )
    return rows


def true_positions(world: World, boards: tuple[str, ...]) -> dict[int, np.ndarray]:
    """True positions (3,) of the check targets in the frame of the first of some boards, by code."""
    datum, _ = true_in_datum(world, boards)
    here = np.flatnonzero(world.marks.role == CHECK)
    local = (world.mark_world_mm[here] - datum.t_mm[0]) @ datum.R[0]
    return {int(world.marks.code[k]): xyz for k, xyz in zip(here, local, strict=True)}


def _axes(name: str, values: np.ndarray) -> dict[str, float]:
    return {f"{name}_{axis}_mm": float(value) for axis, value in zip("xyz", values, strict=True)}


def sheet(field: Field, scale_error: float) -> Field:
    """What the measuring side is told: nominal values with uncertainties, and the bar's length, right or wrong."""
    blind = scale_error != 0
    return replace(
        field,
        u_scale=BLIND_U_SCALE if blind else U_SCALE,
        boards=tuple(replace(board, u_xy_mm=U_PRINT_MM) for board in field.boards),
        scale_bars=tuple(
            replace(bar, length_mm=bar.length_mm * (1 + scale_error), u_length_mm=BLIND_U_BAR_MM if blind else U_BAR_MM)
            for bar in field.scale_bars
        ),
    )
